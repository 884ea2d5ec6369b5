#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <optional>

#include "rig/frame_set_writer.h"
#include "sfm/core/file_io.h"
#include "tests/support/process.h"
#include "tests/support/simulated_rig.h"

namespace rotunda::rig {
namespace {

using namespace std::chrono_literals;
using sim::Fault;
using sim::FaultKind;

constexpr int kCameras = 6;
constexpr auto kReadyPatience = 40s;

/// What goes wrong with camera 2 in one shot, and what the shot has to say of it.
struct FaultCase {
  const char* name;
  const char* block;
  std::vector<Fault> faults;
  Verdict verdict;
  const char* reason;  // part of it
  bool keeps_frame;    // the faulty camera's own picture is kept
  std::function<void(CaptureOptions&)> change = nullptr;
  bool ids_count_on = false;  // else they begin at 1 whenever a camera is armed
  std::optional<uint64_t> frame_id = std::nullopt;  // of the faulty camera's frame
};

void PrintTo(const FaultCase& fault, std::ostream* out) { *out << fault.name; }

const std::vector<FaultCase>& FaultCases() {
  const auto quick = [](CaptureOptions& options) { options.timing.deadline_ms = 500; };
  static const std::vector<FaultCase> cases = {
      {"LostPackets",
       "127.31.1",
       {{FaultKind::kDropPackets, 0.3, 0}, {FaultKind::kNoResend, 0, 0}},
       Verdict::kIncomplete,
       "packets lost: ",
       false},
      {"LeaderLost",
       "127.31.2",
       {{FaultKind::kDropLeader, 0, 1}},
       Verdict::kIncomplete,
       "its first packet, the leader, was lost",
       false},
      {"TrailerLost",
       "127.31.3",
       {{FaultKind::kDropTrailer, 0, 1}},
       Verdict::kIncomplete,
       "packets lost: 1",
       false},
      // Before Aravis gives the frame up.
      {"LeaderLostAndNoTimeLeft",
       "127.31.18",
       {{FaultKind::kDropLeader, 0, 1}},
       Verdict::kIncomplete,
       "packets had come by the deadline",
       false,
       [](CaptureOptions& options) {
         options.timing.deadline_ms = 500;
         options.timing.late_ms = 0;
       }},
      {"Late",
       "127.31.4",
       {{FaultKind::kLate, 800, 1}},
       Verdict::kLate,
       "allowed are 500",
       true,
       quick},
      {"WrongId",
       "127.31.5",
       {{FaultKind::kWrongFrameId, 7, 1}},
       Verdict::kWrongId,
       "has number 8, expected 1",
       true},
      {"TriggerCableCut",
       "127.31.6",
       {{FaultKind::kMute, 0, 0}},
       Verdict::kMissing,
       "trigger cable",
       false,
       quick},
      {"UnpluggedBefore",
       "127.31.7",
       {{FaultKind::kUnplug, 0, 0}},
       Verdict::kDisconnected,
       "does not answer",
       false},
      {"UnpluggedInFrame",
       "127.31.8",
       {{FaultKind::kUnplugInFrame, 0.5, 1}},
       Verdict::kDisconnected,
       "does not answer",
       false},
      {"ControlStolen",
       "127.31.9",
       {{FaultKind::kStealControl, 0, 0}},
       Verdict::kControlLost,
       "control",
       false},
      {"ControlStolenInSilence",
       "127.31.16",
       {{FaultKind::kStealControl, 1, 0}},
       Verdict::kControlLost,
       "control",
       false},
      {"Rebooted",
       "127.31.10",
       {{FaultKind::kReboot, 300, 0}},
       Verdict::kControlLost,
       "control",
       false},
      // The warm-up frame has id 1, that of the shot before 2: this one would have 3.
      {"IdsRestart",
       "127.31.11",
       {{FaultKind::kRestartIds, 0, 1}},
       Verdict::kOk,
       "",
       true,
       nullptr,
       true,
       1},
      {"PtpMasterGone",
       "127.31.17",
       {{FaultKind::kNoPtp, 0, 0}},
       Verdict::kNoClock,
       "PtpStatus: is Listening, expected Slave",
       true,
       [](CaptureOptions& options) { options.settings.ptp = true; }},
      {"Skewed",
       "127.31.12",
       {{FaultKind::kSkew, 2.5, 1}},
       Verdict::kSkewed,
       "after the others",
       true},
      {"SecondPulse",
       "127.31.13",
       {{FaultKind::kSecondPulse, 20, 1}},
       Verdict::kSecondFrame,
       "second pulse",
       true},
      {"FirstFrameLost",
       "127.31.14",
       {{FaultKind::kFirstFrameLost, 0, 1}},
       Verdict::kMissing,
       "no frame came",
       false,
       quick},
  };
  return cases;
}

class CaptureFaults : public testing::TestWithParam<FaultCase> {
 protected:
  CaptureFaults() : rig_(Options(GetParam())) {
    rig_.capture().retries = 0;
    rig_.capture().settings.packet_size_bytes = 1500;
    if (GetParam().change) GetParam().change(rig_.capture());
  }
  static test::SimulatedRig::Options Options(const FaultCase& row) {
    test::SimulatedRig::Options options;
    options.block = row.block;
    options.restart_frame_ids = !row.ids_count_on;
    options.cameras = kCameras;
    options.like.width_px = 320;
    options.like.height_px = 240;
    options.source = sim::PatternSource(320, 240);
    return options;
  }

  test::SimulatedRig rig_;
};

TEST_P(CaptureFaults, AreNamedTheOthersAreKeptAndTheNextShotWorks) {
  constexpr int kFaulty = 2;
  constexpr int kFaultyShot = 1;  // every pulse shows the cameras another one
  const FaultCase& row = GetParam();
  const auto session = rig_.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), size_t{kCameras});
  const auto before = (*session)->Capture();
  ASSERT_TRUE(before) << before.error().ToString();
  ASSERT_TRUE(before->complete()) << before->Summary();

  for (const Fault& fault : row.faults) {
    ASSERT_TRUE(rig_.server().SetFault(kFaulty, fault));
  }
  auto shot = (*session)->Capture();
  ASSERT_TRUE(shot) << shot.error().ToString();
  ASSERT_EQ(shot->cameras.size(), size_t{kCameras});
  for (int i = 0; i < kCameras; ++i) {
    const CameraShot& camera = shot->cameras[i];
    if (camera.frame) {
      EXPECT_TRUE(rig_.IsAsServed(*camera.frame, i, kFaultyShot)) << camera.camera;
    }
    if (i != kFaulty) {
      EXPECT_EQ(camera.verdict, Verdict::kOk) << shot->Summary();
      EXPECT_TRUE(camera.frame);
      continue;
    }
    EXPECT_STREQ(VerdictName(camera.verdict), VerdictName(row.verdict)) << shot->Summary();
    EXPECT_NE(camera.reason.find(row.reason), std::string::npos) << camera.reason;
    EXPECT_EQ(camera.frame.has_value(), row.keeps_frame);
    if (row.frame_id && camera.frame) {
      EXPECT_EQ(camera.frame->frame_id, *row.frame_id);
    }
  }

  const test::TemporaryFolder folder;
  const bool complete = row.verdict == Verdict::kOk;
  {
    FrameSetWriter writer(2);
    FrameSetOrder order;
    order.out = folder / "set";
    order.id = row.name;
    order.captured_at = "2026-01-01T00:00:00Z";
    order.trigger_source = "simulated";
    const auto written = writer.Wait(writer.Submit(order, std::move(*shot)));
    ASSERT_TRUE(written) << written.error().ToString();
  }
  const auto set = ReadFrameSet(folder / "set");
  ASSERT_TRUE(set) << set.error().ToString();
  EXPECT_EQ(set->trigger.at("complete"), TriggerValue(complete));
  ASSERT_EQ(set->frames.size(), size_t{kCameras});
  for (int i = 0; i < kCameras; ++i) {
    EXPECT_EQ(set->frames[i].status, i == kFaulty ? VerdictName(row.verdict) : "ok");
    EXPECT_EQ(set->frames[i].file.empty(), i == kFaulty && !row.keeps_frame);
  }

  rig_.server().ClearFaults();
  ASSERT_EQ((*session)->WaitUntilReady(kReadyPatience), size_t{kCameras})
      << (*session)->States()[kFaulty].problem;
  const auto after = (*session)->Capture();
  ASSERT_TRUE(after) << after.error().ToString();
  EXPECT_TRUE(after->complete()) << after->Summary();
  EXPECT_EQ(rig_.ExactFrames(*after, kFaultyShot + 1), kCameras);
}

INSTANTIATE_TEST_SUITE_P(Table, CaptureFaults, testing::ValuesIn(FaultCases()),
                         [](const auto& info) { return std::string(info.param.name); });

}  // namespace
}  // namespace rotunda::rig
