#include "rig/capture_session.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
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
            "c000: serial SIM00002 expected at 127.32.7.1, found SIM00001 (which belongs to c001: "
            "cables swapped?)");
  EXPECT_NE(states[3].problem.find("127.32.7.90: no camera answers"), std::string::npos)
      << states[3].problem;
  const auto shot = (*session)->Capture();
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_EQ(shot->OkCount(), 1u);
  EXPECT_STREQ(VerdictName(shot->cameras[1].verdict), "wrong camera");
  EXPECT_STREQ(VerdictName(shot->cameras[3].verdict), "disconnected");
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
  Result<bool> WaitArmed(Clock::time_point deadline) override { return real_->WaitArmed(deadline); }
  Status SoftwareTrigger() override { return real_->SoftwareTrigger(); }
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

TEST(CaptureSession, AnErrorThatIsNotUnderstoodIsNotCalledLostControl) {
  SimulatedRig rig(RigOf("127.32.17", 3));
  rig.capture().retries = 0;
  const Meddling broken{[] {}, Error{ErrorCode::kFailed, "sensor too hot", "AcquisitionStart"}};
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

/// The first camera's state once it has been refused.
CameraState StateOfRefused(const CaptureSession& session) {
  for (int i = 0; i < 2000 && session.States().front().problem.empty(); ++i) {
    std::this_thread::sleep_for(10ms);
  }
  const CameraState state = session.States().front();
  EXPECT_STREQ(ConditionName(state.condition), "lost");
  return state;
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
  SimulatedRig rig(RigOf("127.32.19", 2));
  // 300x400 pixels of two cameras over 9 Mbit/s take 0.2 s; how large they are, only they know.
  rig.capture().uplinks = {{"loop", 10, 10}};
  rig.capture().timing.deadline_ms = 100;
  ASSERT_EQ(rig.capture().settings.width_px, 0);
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  const CameraState state = StateOfRefused(**session);
  EXPECT_NE(state.problem.find("frames of 0.12 MB need 2"), std::string::npos) << state.problem;
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
