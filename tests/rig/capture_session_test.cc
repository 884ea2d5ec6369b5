#include "rig/capture_session.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstring>

#include "rig/aravis_camera.h"
#include "rig/camera_discovery.h"
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

/// How many cameras of a shot have exactly the bytes that they were served.
int ExactFrames(const SimulatedRig::Options& options, sim::CameraServer& server, const Shot& shot,
                int shown) {
  int exact = 0;
  for (size_t i = 0; i < shot.cameras.size(); ++i) {
    const int index = static_cast<int>(i);
    const auto bytes = test::ServedBytes(options.source, server.camera(index), index, shown);
    const auto& frame = shot.cameras[i].frame;
    exact += frame && std::memcmp(frame->memory.data(), bytes.data(), bytes.size()) == 0;
  }
  return exact;
}

TEST(CaptureSession, NinetyCamerasTwentyPulsesEveryByteAsServed) {
  constexpr int kCameras = 90;
  const SimulatedRig::Options options = RigOf("127.32.1", kCameras);
  SimulatedRig rig(options);
  rig.capture().retries = 0;
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), size_t{kCameras});
  for (int pulse = 0; pulse < 20; ++pulse) {
    rig.server().SetShot(pulse);
    const auto shot = (*session)->Capture();
    ASSERT_TRUE(shot) << shot.error().ToString();
    EXPECT_TRUE(shot->complete()) << shot->Summary();
    EXPECT_EQ(ExactFrames(options, rig.server(), *shot, pulse), kCameras) << "pulse " << pulse;
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
    EXPECT_EQ(ExactFrames(options, rig.server(), *shot, pulse), 20);
    resent += shot->ResentPackets();
  }
  EXPECT_GT(resent, 200u);  // 5 % of 5 x 20 x 82 packets are 410
}

TEST(CaptureSession, CamerasThatCountOnAreAsGoodAsThoseThatRestart) {
  SimulatedRig::Options options = RigOf("127.32.3", 4);
  options.restart_frame_ids = false;
  SimulatedRig rig(options);
  rig.capture().retries = 0;
  const auto session = rig.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), 4u);
  uint64_t last = 0;
  for (int pulse = 0; pulse < 3; ++pulse) {
    const auto shot = (*session)->Capture();
    ASSERT_TRUE(shot) << shot.error().ToString();
    EXPECT_TRUE(shot->complete()) << shot->Summary();
    EXPECT_GT(shot->cameras[0].frame->frame_id, last);
    last = shot->cameras[0].frame->frame_id;
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
  const auto bytes = test::ServedBytes(options.source, rig.server().camera(1), 1, 0);
  EXPECT_EQ(std::memcmp(frame->memory.data(), bytes.data(), bytes.size()), 0);
  EXPECT_FALSE((*session)->Preview("c099"));
  const auto shot = (*session)->Capture();
  ASSERT_TRUE(shot);
  EXPECT_TRUE(shot->complete()) << shot->Summary();
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
