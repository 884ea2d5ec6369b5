#include "rig/capture_session.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "rig/aravis_camera.h"
#include "rig/camera_discovery.h"
#include "rig/sim/socket_trigger.h"
#include "tests/support/simulated_rig.h"

namespace rotunda::rig {
namespace {

using namespace std::chrono_literals;
using sim::FaultKind;
using test::SimulatedRig;

constexpr auto kReadyPatience = 60s;

SimulatedRig::Options RigOf(const std::string& block, int cameras) {
  SimulatedRig::Options options;
  options.block = block;
  options.cameras = cameras;
  options.like.width_px = 300;
  options.like.height_px = 400;
  options.source = sim::PatternSource(300, 400);
  return options;
}

/// Ramps as PatternSource has them, of which neither the cameras nor the test need a copy a frame.
sim::FrameSource FullSizeSource(int cameras, int shots) {
  auto images = std::make_shared<std::vector<std::shared_ptr<const sim::ServedImage>>>();
  const auto pattern = sim::PatternSource(1200, 1600);
  for (int shot = 0; shot < shots; ++shot) {
    for (int i = 0; i < cameras; ++i) {
      images->push_back(pattern({i, shot, sim::PixelFormat::kBayerRG8, 0, 0}));
    }
  }
  return [=](const sim::Exposure& exposure) {
    return (*images)[static_cast<size_t>(exposure.shot % shots * cameras + exposure.camera)];
  };
}

TEST(CaptureSession, NinetyCamerasTwentyPulsesEveryByteAsServed) {
  constexpr int kCameras = 90;
  constexpr int kShots = 2;  // different pictures a camera
  constexpr int kWithoutLoss = 20;
  constexpr int kWithLoss = 2;
  SimulatedRig::Options options = RigOf("127.32.1", kCameras);
  options.like = {};  // 1200x1600
  options.source = FullSizeSource(kCameras, kShots);
  options.restart_frame_ids = false;  // so that each frame's number tells which pulse it is of
  SimulatedRig rig(options);
  rig.capture().retries = 0;
  rig.capture().timing.deadline_ms = 20000;  // other tests may have the machine
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), size_t{kCameras});
  const std::vector<CameraState> warmed_up = (*session)->States();
  for (int pulse = 0; pulse < kWithoutLoss + kWithLoss; ++pulse) {
    const bool lossy = pulse >= kWithoutLoss;
    for (int i = 0; lossy && i < kCameras; ++i) {
      ASSERT_TRUE(rig.server().SetFault(i, {FaultKind::kDropPackets, 0.05, 0}));
    }
    rig.server().SetShot(pulse);
    const auto shot = (*session)->Capture();
    ASSERT_TRUE(shot) << shot.error().ToString();
    ASSERT_TRUE(shot->complete()) << "pulse " << pulse << ": " << shot->Summary();
    for (size_t i = 0; i < kCameras; ++i) {
      const CameraFrame& frame = *shot->cameras[i].frame;
      EXPECT_EQ(frame.width_px, 1200);
      EXPECT_EQ(frame.height_px, 1600);
      EXPECT_EQ(frame.frame_id, *warmed_up[i].last_frame_id + 1 + static_cast<uint64_t>(pulse));
    }
    EXPECT_EQ(rig.ExactFrames(*shot, pulse), kCameras) << "pulse " << pulse;
    if (lossy) {
      EXPECT_GT(shot->ResentPackets(), 500u) << "5 % of 90 x 217 packets are 976";
    }
  }
}

/// What the cameras were set to when they exposed.
struct Seen {
  std::mutex mutex;
  std::vector<sim::Exposure> exposures;
};

/// The first camera's state once it has been refused.
CameraState StateOfRefused(const CaptureSession& session) {
  for (int i = 0; i < 2000 && session.States().front().problem.empty(); ++i) {
    std::this_thread::sleep_for(10ms);
  }
  const CameraState state = session.States().front();
  EXPECT_EQ(state.condition, CameraCondition::kLost);
  return state;
}

TEST(CaptureSession, ASizeThatTheSensorDoesNotHaveIsRefusedWithTheOnesItHas) {
  SimulatedRig::Options options = RigOf("127.32.21", 1);
  SimulatedRig rig(options);
  rig.capture().settings.width_px = options.like.width_px + 1;
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  EXPECT_EQ((*session)->WaitUntilReady(std::chrono::seconds(2)), 0u);
  const std::string problem = (*session)->States()[0].problem;
  EXPECT_NE(problem.find("picture size " + std::to_string(options.like.width_px + 1)),
            std::string::npos)
      << problem;
  EXPECT_NE(problem.find("width_px 1 to " + std::to_string(options.like.width_px) + " and height"),
            std::string::npos)
      << problem;
}

/// A setting that the cameras refuse, and what they say of it.
struct RefusedSetting {
  const char* name;
  const char* block;
  std::function<void(CameraSettings&)> change;
  const char* setting;
  const char* allowed;
};

void PrintTo(const RefusedSetting& setting, std::ostream* out) { *out << setting.name; }

class RefusedSettings : public testing::TestWithParam<RefusedSetting> {};

TEST_P(RefusedSettings, AreToldWithTheRangeThatIsAllowed) {
  SimulatedRig rig(RigOf(GetParam().block, 1));
  GetParam().change(rig.capture().settings);
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  const std::string problem = StateOfRefused(**session).problem;
  EXPECT_NE(problem.find(GetParam().setting), std::string::npos) << problem;
  EXPECT_NE(problem.find(GetParam().allowed), std::string::npos) << problem;
}

INSTANTIATE_TEST_SUITE_P(
    CaptureSession, RefusedSettings,
    testing::Values(RefusedSetting{"Exposure", "127.32.43",
                                   [](CameraSettings& settings) { settings.exposure_us = 2e6; },
                                   "exposure_us = 2000000: ", "; allowed are 10 to 1000000"},
                    RefusedSetting{"Gain", "127.32.44",
                                   [](CameraSettings& settings) { settings.gain_db = 30; },
                                   "gain_db = 30: ", "; allowed are 0 to 24"}),
    [](const auto& info) { return std::string(info.param.name); });

TEST(CaptureSession, SettingsArriveInTheCamerasAndStatesTellThem) {
  Seen seen;
  SimulatedRig::Options options = RigOf("127.32.20", 2);
  options.source = [&seen, pattern = options.source](const sim::Exposure& exposure) {
    const std::lock_guard lock(seen.mutex);
    seen.exposures.push_back(exposure);
    return pattern(exposure);
  };
  SimulatedRig rig(options);
  CameraSettings& wanted = rig.capture().settings;
  wanted.width_px = 200;
  wanted.height_px = 120;
  wanted.pixel_format = "Mono8";
  wanted.exposure_us = 2500;
  wanted.gain_db = 6;
  wanted.packet_size_bytes = 1400;
  // Two cameras on 1 Gbit/s; each may use 0.45 Gbit/s: 1438 bytes every 25.564 us, 11.504 of it the
  // packet's own.
  rig.capture().uplinks = {{"loop", 1000, 1000}};
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 2u) << (*session)->States()[0].problem;
  const auto shot = (*session)->Capture();
  ASSERT_TRUE(shot) << shot.error().ToString();
  ASSERT_TRUE(shot->complete()) << shot->Summary();
  EXPECT_EQ(shot->cameras[1].frame->width_px, 200);
  EXPECT_EQ(shot->cameras[1].frame->height_px, 120);
  EXPECT_EQ(shot->cameras[1].frame->pixel_format, "Mono8");
  const CameraState state = (*session)->States()[1];
  EXPECT_EQ(state.settings.width_px, 200);
  EXPECT_EQ(state.settings.height_px, 120);
  EXPECT_EQ(state.settings.pixel_format, "Mono8");
  EXPECT_EQ(state.settings.exposure_us, 2500);
  EXPECT_EQ(state.settings.gain_db, 6);
  EXPECT_EQ(state.settings.packet_size_bytes, 1400);
  EXPECT_NEAR(static_cast<double>(state.settings.packet_delay_ns), 25564.4 - 11504, 1);
  EXPECT_EQ(state.settings.payload_bytes, size_t{200} * 120);
  EXPECT_EQ(state.identity.address, "127.32.20.2");
  EXPECT_EQ(state.identity.serial, "SIM00002");
  EXPECT_EQ(state.identity.vendor, "Rotunda");
  EXPECT_EQ(state.identity.model, "SimulatedGigE");
  EXPECT_EQ(state.identity.firmware, "1.0.0");
  EXPECT_TRUE(state.health.control_held);
  ASSERT_TRUE(state.health.temperature_deg_c);
  EXPECT_NEAR(*state.health.temperature_deg_c, 41, 3);
  EXPECT_EQ(state.last_frame_id, shot->cameras[1].frame->frame_id);
  EXPECT_EQ(state.last_verdict, "ok");
  const std::lock_guard lock(seen.mutex);
  ASSERT_FALSE(seen.exposures.empty());
  for (const sim::Exposure& exposure : seen.exposures) {
    EXPECT_EQ(exposure.format, sim::PixelFormat::kMono8);
    EXPECT_EQ(exposure.exposure_us, 2500);
    EXPECT_EQ(exposure.gain_db, 6);
  }
}

TEST(CaptureSession, LostPacketsAreSentAgain) {
  const SimulatedRig::Options options = RigOf("127.32.2", 20);
  SimulatedRig rig(options);
  rig.capture().retries = 0;
  rig.capture().settings.packet_size_bytes = 1500;
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 20u);
  for (int i = 0; i < 20; ++i) {
    ASSERT_TRUE(rig.server().SetFault(i, {FaultKind::kDropPackets, 0.05, 0}));
  }
  uint64_t resent = 0;
  for (int pulse = 0; pulse < 5; ++pulse) {
    rig.server().SetShot(pulse);
    const auto shot = (*session)->Capture();
    ASSERT_TRUE(shot) << shot.error().ToString();
    EXPECT_TRUE(shot->complete()) << shot->Summary();
    EXPECT_EQ(rig.ExactFrames(*shot, pulse), 20);
    resent += shot->ResentPackets();
  }
  EXPECT_GT(resent, 200u);  // 5 % of 5 x 20 x 82 packets are 410
  uint64_t told = 0;
  for (const CameraState& state : (*session)->States()) told += state.counters.resent_packets;
  EXPECT_GE(told, resent);
}

TEST(CaptureSession, CamerasThatCountOnAreAsGoodAsThoseThatRestart) {
  for (const bool restart : {false, true}) {
    SimulatedRig::Options options = RigOf(restart ? "127.32.12" : "127.32.3", 4);
    options.restart_frame_ids = restart;
    SimulatedRig rig(options);
    rig.capture().retries = 0;
    const auto session = rig.Open();
    ASSERT_TRUE(session) << session.error().ToString();
    ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 4u);
    for (uint64_t pulse = 0; pulse < 3; ++pulse) {
      const auto shot = (*session)->Capture();
      ASSERT_TRUE(shot) << shot.error().ToString();
      EXPECT_TRUE(shot->complete()) << shot->Summary();
      // The warm-up frame was the first.
      for (const CameraShot& camera : shot->cameras) {
        ASSERT_TRUE(camera.frame) << shot->Summary();
        EXPECT_EQ(camera.frame->frame_id, restart ? 1 : pulse + 2);
      }
    }
  }
}

TEST(CaptureSession, FiresAgainWhenACameraSleptThroughThePulse) {
  SimulatedRig rig(RigOf("127.32.4", 4));
  rig.capture().retries = 1;
  rig.capture().timing.deadline_ms = 700;
  rig.capture().timing.late_ms = 300;
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 4u);
  ASSERT_TRUE(rig.server().SetFault(1, {FaultKind::kFirstFrameLost, 60000, 0}));
  const auto shot = (*session)->Capture();
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_TRUE(shot->complete()) << shot->Summary();
  EXPECT_EQ(shot->pulses, 2);
  EXPECT_NE(shot->first_try.find("c001 missing"), std::string::npos) << shot->first_try;
}

TEST(CaptureSession, ACameraThatSwallowsTheFirstTriggerAfterArmingCanBeUsed) {
  for (const bool restart : {true, false}) {
    SimulatedRig::Options options = RigOf(restart ? "127.32.32" : "127.32.33", 2);
    options.restart_frame_ids = restart;
    SimulatedRig rig(options);
    rig.capture().timing.deadline_ms = 700;
    rig.capture().timing.late_ms = 300;
    ASSERT_TRUE(rig.server().SetFault(1, {FaultKind::kFirstFrameLost, 60000, 0}));
    const auto session = rig.Open();
    ASSERT_TRUE(session) << session.error().ToString();
    ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 2u) << (*session)->States()[1].problem;
    const auto shot = (*session)->Capture();
    ASSERT_TRUE(shot) << shot.error().ToString();
    EXPECT_TRUE(shot->complete()) << shot->Summary();
    EXPECT_EQ(shot->pulses, 2);
    const auto preview = (*session)->Preview("c001");
    EXPECT_TRUE(preview) << preview.error().ToString();
  }
}

TEST(CaptureSession, ACameraWhoseNumbersGoBackHasSeenThePulse) {
  SimulatedRig rig(RigOf("127.32.34", 2));
  rig.capture().retries = 1;
  rig.capture().timing.deadline_ms = 700;
  rig.capture().timing.late_ms = 300;
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 2u);
  ASSERT_TRUE(rig.server().SetFault(1, {FaultKind::kWrongFrameId, 7, 1}));
  const auto shot = (*session)->Capture();
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_EQ(shot->Summary(),
            "1/2 ok; c001 wrong id (packets came, but with the number of an earlier frame)");
}

TEST(CaptureSession, ALateFrameOfTheFirstPulseIsNotTakenForThatOfTheSecond) {
  const SimulatedRig::Options options = RigOf("127.32.13", 4);
  SimulatedRig rig(options);
  rig.capture().retries = 1;
  rig.capture().timing.deadline_ms = 600;
  rig.capture().timing.late_ms = 100;
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 4u);
  rig.server().SetShot(0);  // each pulse shows another picture
  // 700 ms after the first pulse it is given up and fired again: its frame comes after that.
  ASSERT_TRUE(rig.server().SetFault(1, {FaultKind::kLate, 1000, 1}));
  const auto shot = (*session)->Capture();
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_TRUE(shot->complete()) << shot->Summary();
  EXPECT_EQ(shot->pulses, 2);
  EXPECT_EQ(rig.ExactFrames(*shot, 1), 4);
}

/// A second pulse's frame comes when the line is free: long after the camera's own, while others
/// still send.
TEST(CaptureSession, ASecondFrameIsSeenAsLongAsAnyCameraSends) {
  SimulatedRig rig(RigOf("127.32.40", 3));
  rig.capture().retries = 0;
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 3u);
  constexpr int kSecond_ms = 300;
  ASSERT_GT(kSecond_ms, 2 * rig.capture().timing.settle_ms);
  ASSERT_TRUE(rig.server().SetFault(0, {FaultKind::kSecondPulse, kSecond_ms, 1}));
  ASSERT_TRUE(rig.server().SetFault(1, {FaultKind::kLate, 2.0 * kSecond_ms, 1}));
  const auto shot = (*session)->Capture();
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_EQ(shot->cameras[0].verdict, Verdict::kSecondFrame) << shot->Summary();
  EXPECT_EQ(shot->OkCount(), 2u) << shot->Summary();
}

TEST(CaptureSession, AFrameOfTheWarmUpIsNotTakenForThatOfThePulse) {
  for (const bool restart : {true, false}) {
    SimulatedRig::Options options = RigOf(restart ? "127.32.21" : "127.32.22", 3);
    options.restart_frame_ids = restart;
    SimulatedRig rig(options);
    rig.capture().retries = 0;
    rig.capture().timing.deadline_ms = 2000;
    rig.capture().timing.late_ms = 20000;
    // Later than a warm-up waits: the frame of its second trigger comes after the pulse, and before
    // that of the pulse.
    constexpr int kLate_ms = 3000;
    ASSERT_TRUE(rig.server().SetFault(1, {FaultKind::kLate, kLate_ms, 0}));
    const auto session = rig.Open();
    ASSERT_TRUE(session) << session.error().ToString();
    ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 3u) << (*session)->States()[1].problem;
    rig.server().SetShot(5);
    const auto shot = (*session)->Capture();
    ASSERT_TRUE(shot) << shot.error().ToString();
    const CameraShot& camera = shot->cameras[1];
    EXPECT_STREQ(VerdictName(camera.verdict), "late") << shot->Summary();
    ASSERT_TRUE(camera.frame && camera.arrival_ms && camera.skew_us) << shot->Summary();
    EXPECT_TRUE(rig.IsAsServed(*camera.frame, 1, 5));
    EXPECT_GE(*camera.arrival_ms, kLate_ms);
    EXPECT_NE(camera.reason.find("allowed are 2000"), std::string::npos) << camera.reason;
    double uncertainty_us = 0;
    for (const CameraShot& each : shot->cameras) {
      uncertainty_us = std::max(uncertainty_us, each.clock_uncertainty_us);
    }
    EXPECT_NEAR(*camera.skew_us, 0, 1 + 2 * uncertainty_us) << "it exposed with the others";
  }
}

TEST(CaptureSession, WhatHasComeIsKeptWhenTheRestIsGivenUp) {
  SimulatedRig rig(RigOf("127.32.23", 3));
  rig.capture().timing.deadline_ms = 20000;
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 3u);
  ASSERT_TRUE(rig.server().SetFault(1, {FaultKind::kMute, 0, 0}));
  rig.server().SetShot(0);
  const auto ready = (*session)->States();
  const auto has_come = [&](int i) {
    return (*session)->States()[i].last_frame_at != ready[i].last_frame_at;
  };
  std::stop_source ctrl_c;
  auto taken = std::async(std::launch::async, [&] {
    return (*session)->Capture(ctrl_c.get_token(), ctrl_c.get_token());
  });
  while (!has_come(0) || !has_come(2)) std::this_thread::sleep_for(1ms);
  ctrl_c.request_stop();
  const auto shot = taken.get();
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_TRUE(shot->interrupted);
  EXPECT_EQ(shot->pulses, 1) << "no more after that";
  EXPECT_EQ(rig.ExactFrames(*shot, 0), 2) << shot->Summary();
  EXPECT_EQ(shot->Summary(), std::string("2/3 ok; c001 interrupted (") + kGivenUp + ")");
  rig.server().ClearFaults();
  const auto next = (*session)->Capture();
  ASSERT_TRUE(next) << next.error().ToString();
  EXPECT_TRUE(next->complete()) << next->Summary();
  EXPECT_FALSE(next->interrupted);
}

TEST(CaptureSession, NothingIsLeftWhenNoFrameHadComeOrThereWasNoPulse) {
  SimulatedRig rig(RigOf("127.32.24", 2));
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 2u);
  const uint64_t frames = rig.server().counters(0).frames;
  std::stop_source ctrl_c;
  ctrl_c.request_stop();
  const auto stopped = (*session)->Capture(ctrl_c.get_token());
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, ErrorCode::kCancelled);
  EXPECT_EQ(rig.server().counters(0).frames, frames) << "there was a pulse";
  for (int i = 0; i < 2; ++i) ASSERT_TRUE(rig.server().SetFault(i, {FaultKind::kMute, 0, 0}));
  const auto given_up = (*session)->Capture({}, ctrl_c.get_token());
  ASSERT_FALSE(given_up) << given_up->Summary();
  EXPECT_EQ(given_up.error().code, ErrorCode::kCancelled);
  rig.server().ClearFaults();
  const auto next = (*session)->Capture();
  ASSERT_TRUE(next) << next.error().ToString();
  EXPECT_TRUE(next->complete()) << next->Summary();
}

TEST(CaptureSession, SaysWhyACameraCannotBeOpened) {
  SimulatedRig rig(RigOf("127.32.25", 4));
  ASSERT_TRUE(rig.server().SetFault(0, {FaultKind::kStealControl, 0, 0}));
  ASSERT_TRUE(rig.server().SetFault(1, {FaultKind::kStealControl, 1, 0}));
  ASSERT_TRUE(rig.server().SetFault(2, {FaultKind::kUnplugInFrame, 0.5, 1}));
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  const auto is_told = [&](int i) { return !(*session)->States()[i].problem.empty(); };
  while (!is_told(0) || !is_told(1) || !is_told(2)) std::this_thread::sleep_for(10ms);
  ASSERT_EQ((*session)->WaitUntilReady(0s), 1u);
  for (const int stolen : {0, 1}) {
    const CameraState state = (*session)->States()[stolen];
    EXPECT_STREQ(ConditionName(state), "control lost");
    EXPECT_NE(state.problem.find("another program controls it"), std::string::npos)
        << state.problem;
  }
  EXPECT_STREQ(ConditionName((*session)->States()[2]), "disconnected");
  const auto shot = (*session)->Capture();
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_EQ(shot->OkCount(), 1u) << shot->Summary();
  for (const int i : {0, 1, 2}) EXPECT_NE(shot->cameras[i].reason, "") << i;
  EXPECT_EQ(shot->first_try, "the same") << "a second pulse changed nothing";
  rig.server().ClearFaults();  // or closing the camera takes Aravis seconds
}

TEST(CaptureSession, ACameraThatIsStillBeingOpenedIsCalledThat) {
  SimulatedRig rig(RigOf("127.32.26", 2));
  std::promise<void> released;
  const auto release = released.get_future().share();
  const auto open = [&](const CameraPlace& place) {
    if (place.camera == "c001") release.wait();
    return OpenAravisCamera(place);
  };
  const auto session = CaptureSession::Open(
      rig.capture(), {open, std::make_unique<sim::SocketTrigger>(rig.server().socket())});
  ASSERT_TRUE(session) << session.error().ToString();
  while ((*session)->WaitUntilReady(0s) == 0) std::this_thread::sleep_for(10ms);
  EXPECT_STREQ(ConditionName((*session)->States()[1]), "opening");
  const auto shot = (*session)->Capture();
  released.set_value();
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_EQ(shot->Summary(), "1/2 ok; c001 not armed (it was still being opened)");
}

TEST(CaptureSession, ACameraWhoseClockHasNotHeardThePtpMasterSaysSoWhileItIsOpened) {
  SimulatedRig rig(RigOf("127.32.28", 2));
  rig.capture().settings.ptp = true;
  ASSERT_TRUE(rig.server().SetFault(1, {FaultKind::kNoPtp, 0, 0}));
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  const std::string lacking =
      "its clock does not follow the PTP master: PtpStatus: is Listening, expected Slave (is there "
      "a PTP master?)";
  while ((*session)->WaitUntilReady(0s) == 0 || (*session)->States()[1].problem.empty()) {
    std::this_thread::sleep_for(10ms);
  }
  const CameraState state = (*session)->States()[1];
  EXPECT_STREQ(ConditionName(state), "opening");
  EXPECT_EQ(state.problem, lacking);
  const auto shot = (*session)->Capture();
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_EQ(shot->Summary(), "1/2 ok; c001 not armed (it was still being opened: " + lacking + ")");
  rig.server().ClearFaults();
  EXPECT_EQ((*session)->WaitUntilReady(kReadyPatience), 2u) << (*session)->States()[1].problem;
}

TEST(CaptureSession, ACameraWhoseClockNeverHearsThePtpMasterHasNoClock) {
  SimulatedRig rig(RigOf("127.32.42", 2));
  rig.capture().settings.ptp = true;
  rig.capture().retries = 0;
  ASSERT_TRUE(rig.server().SetFault(1, {FaultKind::kNoPtp, 0, 0}));
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  const auto condition = [&](int i) { return (*session)->States()[i].condition; };
  while (condition(0) != CameraCondition::kReady || condition(1) != CameraCondition::kLost) {
    std::this_thread::sleep_for(10ms);
  }
  EXPECT_STREQ(ConditionName((*session)->States()[1]), "no clock");
  const auto shot = (*session)->Capture();
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_EQ(shot->Summary(),
            "1/2 ok; c001 no clock (its clock does not follow the PTP master: PtpStatus: is "
            "Listening, expected Slave (is there a PTP master?))");
}

TEST(CaptureSession, CamerasThatGiveNoWarmUpFrameSayTheSame) {
  SimulatedRig rig(RigOf("127.32.29", 3));
  for (const int i : {1, 2}) {
    ASSERT_TRUE(rig.server().SetFault(i, {FaultKind::kDropPackets, 1, 0}));
  }
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  const auto is_told = [&](int i) { return !(*session)->States()[i].problem.empty(); };
  while (!is_told(1) || !is_told(2)) std::this_thread::sleep_for(10ms);
  const auto shot = (*session)->Capture();
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_EQ(shot->Summary(),
            "1/3 ok; 2 camera error (it answers, but: no frame came when it was triggered by "
            "software): c001, c002");
}

TEST(CaptureSession, ClocksThatAreFarApartAreCompared) {
  for (const bool ptp : {false, true}) {
    SimulatedRig::Options options = RigOf(ptp ? "127.32.5" : "127.32.6", 5);
    options.like.clock_offset_ns = 5'000'000'000;
    SimulatedRig rig(options);
    rig.capture().settings.ptp = ptp;
    rig.capture().retries = 0;
    const auto session = rig.Open();
    ASSERT_TRUE(session) << session.error().ToString();
    ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 5u)
        << (*session)->States().front().problem;
    ASSERT_TRUE(rig.server().SetFault(3, {FaultKind::kSkew, 100, 1}));
    const auto shot = (*session)->Capture();
    ASSERT_TRUE(shot) << shot.error().ToString();
    EXPECT_STREQ(VerdictName(shot->cameras[3].verdict), "skewed") << shot->Summary();
    ASSERT_TRUE(shot->cameras[3].skew_us);
    // Each of the two clocks compared is known to its uncertainty; the median's no worse than the
    // worst.
    double uncertainty_us = 0;
    for (const CameraShot& camera : shot->cameras) {
      uncertainty_us = std::max(uncertainty_us, camera.clock_uncertainty_us);
    }
    EXPECT_NEAR(*shot->cameras[3].skew_us, 1e5, 1 + 2 * uncertainty_us);
    EXPECT_EQ(shot->skew.worst, "c003");
  }
}

TEST(CaptureSession, NamesCamerasThatAreNotWhereTheyShouldBe) {
  SimulatedRig rig(RigOf("127.32.7", 3));
  std::swap(rig.capture().cameras[0].serial, rig.capture().cameras[1].serial);
  rig.capture().cameras.push_back({"c900", "SIM99999", "127.32.7.90", "loop"});
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  EXPECT_EQ((*session)->WaitUntilReady(3s), 1u);
  const std::vector<CameraState> states = (*session)->States();
  EXPECT_EQ(states[0].problem,
            "serial SIM00002 expected at 127.32.7.1, found SIM00001 (which belongs to c001: "
            "cables swapped?)");
  EXPECT_STREQ(ConditionName(states[0]), "wrong camera");
  // The same sentence for all that are not there: whoever shows it says where they are looked for.
  EXPECT_EQ(states[3].problem, "no camera answers (power, cable and network of the camera?)");
  EXPECT_EQ(states[3].identity.address, "127.32.7.90");
  EXPECT_STREQ(ConditionName(states[3]), "disconnected");
  const auto shot = (*session)->Capture();
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_EQ(shot->OkCount(), 1u);
  EXPECT_STREQ(VerdictName(shot->cameras[1].verdict), "wrong camera");
  EXPECT_STREQ(VerdictName(shot->cameras[3].verdict), "disconnected");
}

TEST(CaptureSession, ACameraAtAnotherAddressIsToldWithBothAddresses) {
  SimulatedRig::Options options = RigOf("127.32.41", 2);
  options.like.serial = "ELSEWHERE";  // other tests' cameras answer too
  SimulatedRig rig(options);
  rig.capture().cameras[1].address = "127.32.41.200";
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  while ((*session)->States()[1].problem.empty()) std::this_thread::sleep_for(10ms);
  EXPECT_EQ((*session)->States()[1].problem,
            "serial " + rig.capture().cameras[1].serial +
                " is at 127.32.41.2, but configured at 127.32.41.200, where nobody answers");
  EXPECT_STREQ(ConditionName((*session)->States()[1]), "disconnected");
}

TEST(CaptureSession, FindsCamerasBySerialAlone) {
  SimulatedRig::Options options = RigOf("127.32.8", 3);
  options.like.serial = "FIND";  // other tests' cameras answer too
  SimulatedRig rig(options);
  for (int i = 0; i < 3; ++i) {
    rig.capture().cameras[i].address.clear();
  }
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  EXPECT_EQ((*session)->WaitUntilReady(kReadyPatience), 3u) << (*session)->States()[0].problem;
  EXPECT_EQ((*session)->States()[2].identity.address, "127.32.8.3");
}

TEST(CaptureSession, SaysWhenFramesOfEarlierShotsFillTheMemory) {
  SimulatedRig rig(RigOf("127.32.9", 3));
  rig.capture().sets_in_memory = 2;
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 3u);
  std::vector<Shot> kept;
  for (int i = 0; i < 2; ++i) kept.push_back((*session)->Capture().value());
  EXPECT_EQ((*session)->MemoryLimit_bytes(), 2u * 3u * 300u * 400u);
  const auto refused = (*session)->Capture();
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("memory is full"), std::string::npos);
  EXPECT_TRUE(kept[0].complete() && kept[1].complete());
  kept.pop_back();
  const auto shot = (*session)->Capture();
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_TRUE(shot->complete()) << shot->Summary();
}

TEST(CaptureSession, AStopWhileMemoryIsFullIsNoComplaintAboutIt) {
  SimulatedRig rig(RigOf("127.32.36", 2));
  rig.capture().sets_in_memory = 2;
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 2u);
  std::vector<Shot> kept;
  for (int i = 0; i < 2; ++i) kept.push_back((*session)->Capture().value());
  std::stop_source stop;
  stop.request_stop();
  const auto stopped = (*session)->Capture(stop.get_token());
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, ErrorCode::kCancelled) << stopped.error().ToString();
}

TEST(CaptureSession, PreviewsOneCamera) {
  const SimulatedRig::Options options = RigOf("127.32.10", 2);
  SimulatedRig rig(options);
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 2u);
  const auto frame = (*session)->Preview("c001");
  ASSERT_TRUE(frame) << frame.error().ToString();
  EXPECT_TRUE(rig.IsAsServed(*frame, 1, 0));
  EXPECT_FALSE((*session)->Preview("c099"));
  const auto shot = (*session)->Capture();
  ASSERT_TRUE(shot);
  EXPECT_TRUE(shot->complete()) << shot->Summary();
}

TEST(CaptureSession, PreviewsCamerasWhoseIdsCountOn) {
  SimulatedRig::Options options = RigOf("127.32.14", 2);
  options.restart_frame_ids = false;
  SimulatedRig rig(options);
  rig.capture().retries = 0;
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 2u);
  for (uint64_t round = 0; round < 3; ++round) {
    const auto frame = (*session)->Preview("c001");
    ASSERT_TRUE(frame) << frame.error().ToString();
    EXPECT_EQ(frame->frame_id, 2 + 2 * round);
    EXPECT_EQ((*session)->States()[1].last_frame_id, frame->frame_id);
    const auto shot = (*session)->Capture();
    ASSERT_TRUE(shot) << shot.error().ToString();
    EXPECT_TRUE(shot->complete()) << shot->Summary();
    EXPECT_EQ(shot->cameras[1].frame->frame_id, 3 + 2 * round);
    EXPECT_EQ(shot->cameras[0].frame->frame_id, 2 + round);
  }
}

TEST(CaptureSession, AShotWaitsForAPreviewToEnd) {
  SimulatedRig rig(RigOf("127.32.15", 2));
  rig.capture().retries = 0;
  rig.capture().timing.arm_ms = 200;
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 2u);
  // The preview takes longer than cameras are given to be armed.
  ASSERT_TRUE(rig.server().SetFault(1, {FaultKind::kLate, 1000, 1}));
  const uint64_t frames = rig.server().counters(1).frames;
  auto preview = std::async(std::launch::async, [&] { return (*session)->Preview("c001"); });
  std::this_thread::sleep_for(100ms);
  EXPECT_EQ(rig.server().counters(1).frames, frames) << "the preview is still on its way";
  const auto second = (*session)->Preview("c000");
  ASSERT_FALSE(second) << "previews do not queue up before shots";
  EXPECT_NE(second.error().message.find("busy"), std::string::npos) << second.error().ToString();
  const auto shot = (*session)->Capture();
  EXPECT_TRUE(preview.get());
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_TRUE(shot->complete()) << shot->Summary();
}

/// What a test does to calls of real cameras, by address.
struct Meddling {
  std::function<void()> before_arm = [] {};
  std::function<void()> before_software_trigger = [] {};
  std::optional<Error> arm_fails;
};

class MeddledCamera final : public Camera {
 public:
  MeddledCamera(std::unique_ptr<Camera> real, const Meddling& meddling)
      : real_(std::move(real)), meddling_(meddling) {}
  const CameraIdentity& identity() const override { return real_->identity(); }
  Result<AppliedSettings> Apply(const CameraSettings& settings) override {
    return real_->Apply(settings);
  }
  Status Arm(TriggerBy by, FrameBlock memory) override {
    if (by == TriggerBy::kSoftware) return real_->Arm(by, std::move(memory));
    if (meddling_.arm_fails) return *meddling_.arm_fails;
    meddling_.before_arm();
    return real_->Arm(by, std::move(memory));
  }
  Status Refill(FrameBlock memory) override { return real_->Refill(std::move(memory)); }
  Status StartOver(FrameBlock memory) override { return real_->StartOver(std::move(memory)); }
  Result<bool> WaitArmed(Clock::time_point deadline) override { return real_->WaitArmed(deadline); }
  Status SoftwareTrigger() override {
    meddling_.before_software_trigger();
    return real_->SoftwareTrigger();
  }
  std::optional<CameraFrame> Fetch(Clock::time_point deadline) override {
    return real_->Fetch(deadline);
  }
  Status Disarm() override { return real_->Disarm(); }
  Result<ClockSample> SampleClock() override { return real_->SampleClock(); }
  StreamCounters counters() const override { return real_->counters(); }
  Result<CameraHealth> ReadHealth() override { return real_->ReadHealth(); }
  Status CheckPtp() override { return real_->CheckPtp(); }
  bool LostControl() override { return real_->LostControl(); }

 private:
  const std::unique_ptr<Camera> real_;
  const Meddling& meddling_;
};

/// A session in which `meddling` is done to the camera at `address`.
Result<std::unique_ptr<CaptureSession>> OpenMeddled(SimulatedRig& rig, const std::string& address,
                                                    const Meddling& meddling) {
  const auto open = [&meddling, address](const CameraPlace& place) {
    Result<std::unique_ptr<Camera>> camera = OpenAravisCamera(place);
    if (!camera || place.address != address) return camera;
    return Result<std::unique_ptr<Camera>>(
        std::make_unique<MeddledCamera>(std::move(*camera), meddling));
  };
  return CaptureSession::Open(rig.capture(),
                              {open, std::make_unique<sim::SocketTrigger>(rig.server().socket())});
}

TEST(CaptureSession, ACameraArmedAfterThePulseWasArmedLate) {
  SimulatedRig rig(RigOf("127.32.16", 3));
  rig.capture().retries = 0;
  rig.capture().timing.arm_ms = 100;
  rig.capture().timing.deadline_ms = 800;
  rig.capture().timing.late_ms = 100;
  Meddling slow;
  slow.before_arm = [] { std::this_thread::sleep_for(400ms); };
  const auto session = OpenMeddled(rig, "127.32.16.2", slow);
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 3u);
  const auto shot = (*session)->Capture();
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_STREQ(VerdictName(shot->cameras[1].verdict), "armed late") << shot->Summary();
  EXPECT_EQ(shot->OkCount(), 2u) << shot->Summary();
}

TEST(CaptureSession, ACameraThatGoesBeforeItsWarmUpFrameIsDisconnectedAndComesBack) {
  SimulatedRig rig(RigOf("127.32.30", 2));
  Meddling unplugged;
  std::atomic<bool> done = false;
  unplugged.before_software_trigger = [&] {
    if (done.exchange(true)) return;
    EXPECT_TRUE(rig.server().SetFault(1, {FaultKind::kUnplug, 0, 0}));
  };
  const auto session = OpenMeddled(rig, "127.32.30.2", unplugged);
  ASSERT_TRUE(session) << session.error().ToString();
  while ((*session)->States()[1].problem.empty()) std::this_thread::sleep_for(10ms);
  EXPECT_STREQ(ConditionName((*session)->States()[1]), "disconnected");
  rig.server().ClearFaults();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 2u) << (*session)->States()[1].problem;
  const auto shot = (*session)->Capture();
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_TRUE(shot->complete()) << shot->Summary();
}

TEST(CaptureSession, AStopWhileTheCamerasAreArmedGivesNoPulse) {
  SimulatedRig rig(RigOf("127.32.27", 2));
  rig.capture().timing.arm_ms = 60000;
  std::stop_source ctrl_c;
  Meddling slow;
  std::promise<void> released;
  slow.before_arm = [&] {
    ctrl_c.request_stop();
    released.get_future().wait();
  };
  const auto session = OpenMeddled(rig, "127.32.27.2", slow);
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 2u);
  const uint64_t frames = rig.server().counters(0).frames;
  const auto shot = (*session)->Capture(ctrl_c.get_token());  // and not when all are armed
  released.set_value();
  ASSERT_FALSE(shot);
  EXPECT_EQ(shot.error().code, ErrorCode::kCancelled);
  EXPECT_EQ(rig.server().counters(0).frames, frames);
}

TEST(CaptureSession, AShotThatWaitsForAPreviewCanBeStopped) {
  SimulatedRig rig(RigOf("127.32.37", 2));
  std::atomic<bool> is_preview = false, has_ended = false;
  std::promise<void> entered, released;
  Meddling slow;
  slow.before_software_trigger = [&] {
    if (!is_preview) return;
    entered.set_value();
    released.get_future().wait();
  };
  const auto session = OpenMeddled(rig, "127.32.37.2", slow);
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 2u);
  is_preview = true;
  auto preview = std::async(std::launch::async, [&] {
    const auto frame = (*session)->Preview("c001");
    has_ended = true;
  });
  entered.get_future().wait();
  std::stop_source stop;
  stop.request_stop();
  const auto stopped = (*session)->Capture(stop.get_token());
  EXPECT_FALSE(has_ended) << "the shot waited for it";
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, ErrorCode::kCancelled);
  released.set_value();
}

TEST(CaptureSession, AnErrorThatIsNotUnderstoodIsNotCalledLostControl) {
  SimulatedRig rig(RigOf("127.32.17", 3));
  rig.capture().retries = 0;
  const Meddling broken{[] {}, [] {},
                        Error{ErrorCode::kFailed, "sensor too hot", "AcquisitionStart"}};
  const auto session = OpenMeddled(rig, "127.32.17.2", broken);
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 3u);
  const auto shot = (*session)->Capture();
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_STREQ(VerdictName(shot->cameras[1].verdict), "camera error") << shot->Summary();
  EXPECT_EQ(shot->cameras[1].reason, "it answers, but: AcquisitionStart: sensor too hot");
  EXPECT_EQ(shot->OkCount(), 2u) << shot->Summary();
  EXPECT_EQ((*session)->WaitUntilReady(kReadyPatience), 3u) << "it is opened again";
}

TEST(CaptureSession, ACameraThatDoesNotKeepItsSettingsSaysWhich) {
  SimulatedRig::Options options = RigOf("127.32.18", 2);
  options.like.max_packet_delay_ns = 5000;
  SimulatedRig rig(options);
  // Two cameras on 1 Gbit/s leave gaps as long as their packets: 73 us.
  rig.capture().uplinks = {{"loop", 1000, 1000}};
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  const CameraState state = StateOfRefused(**session);
  EXPECT_NE(state.problem.find("GevSCPD"), std::string::npos) << state.problem;
  EXPECT_NE(state.problem.find("has 5000 ns"), std::string::npos) << state.problem;
  EXPECT_STREQ(VerdictName(state.lost_as), "camera error");
}

TEST(CaptureSession, WholeSensorsThatTheNetworkIsTooSlowForAreRefused) {
  SimulatedRig::Options options = RigOf("127.32.19", 2);
  options.like.max_packet_delay_ns = 5000;  // it must not be told of the gap instead
  SimulatedRig rig(options);
  // 300x400 pixels of two cameras over 9 Mbit/s take 0.2 s; how large they are, only they know.
  rig.capture().uplinks = {{"loop", 10, 10}};
  rig.capture().timing.deadline_ms = 100;
  ASSERT_EQ(rig.capture().settings.width_px, 0);
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  const CameraState state = StateOfRefused(**session);
  EXPECT_NE(state.problem.find("uplinks.loop: with 2 cameras, frames of 0.12 MB need 2"),
            std::string::npos)
      << state.problem;
  EXPECT_NE(state.problem.find("capture.deadline_ms is 100"), std::string::npos) << state.problem;
}

class BrokenTrigger : public TriggerLine {
 public:
  Result<Clock::time_point> Pulse(std::chrono::microseconds) override {
    return Error{ErrorCode::kIo, "the chip is gone", "/dev/gpiochip9 line 1"};
  }
};

TEST(CaptureSession, ATriggerThatFailsIsAnErrorAndCamerasStayReady) {
  SimulatedRig rig(RigOf("127.32.11", 2));
  auto session =
      CaptureSession::Open(rig.capture(), {OpenAravisCamera, std::make_unique<BrokenTrigger>()});
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 2u);
  const auto shot = (*session)->Capture();
  ASSERT_FALSE(shot);
  EXPECT_EQ(shot.error().ToString(), "trigger: /dev/gpiochip9 line 1: the chip is gone");
  EXPECT_EQ((*session)->WaitUntilReady(1s), 2u);
}

}  // namespace
}  // namespace rotunda::rig
