// `rotunda capture` and `rotunda cameras` with simulated cameras of another process.

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "sfm/core/calibration.h"
#include "sfm/core/file_io.h"
#include "sfm/core/frame_set.h"
#include "tests/support/process.h"
#include "tests/support/rotunda_command.h"
#include "tests/support/served_cameras.h"
#include "tests/support/small_frame_set.h"

namespace rotunda {
namespace {

using test::Contains;
using test::ProcessOutcome;
using test::RunProcess;
using test::RunRotunda;
using test::ServedCameras;
using test::TemporaryFolder;
using Json = nlohmann::json;

size_t CountOf(const std::string& text, const std::string& part) {
  size_t count = 0;
  for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

/// Four small cameras and a configuration that fits them.
class CaptureCommand : public testing::Test {
 protected:
  static constexpr char kBlock[] = "127.42.3";

  static void SetUpTestSuite() {
    folder_ = std::make_unique<TemporaryFolder>();
    test::WriteSmallFrameSet(Served(), 4, "CAPT");
    const auto set = ReadFrameSet(Served());
    ASSERT_TRUE(set) << set.error().ToString();
    std::ofstream(*folder_ / "unread.json") << "{}";
    WriteLenses("lenses.json", set->frames);
    std::vector<Frame> other = set->frames;
    other[1].serial = "EXCHANGED";
    other[3].camera = "c00r9";
    WriteLenses("partly.json", other);
    for (Frame& frame : other) frame.camera = "elsewhere" + frame.camera;
    WriteLenses("elsewhere.json", other);
    WriteConfig("rig.toml", *set, "");
    WriteConfig("line1.toml", *set, "[trigger]\ncamera_input = \"Line1\"\n");
    WriteConfig("odd.toml", *set, "[trigger]\ncamera_input = \"Opto\"\n");
    WriteConfig("patient.toml", *set, "", 60000);
    WriteConfig("ptp.toml", *set, "", 1500, true);
    WriteMovedConfig();
    FrameSet wrong = *set;
    wrong.frames[1].serial = "OTHER";
    WriteConfig("wrong.toml", wrong, "");
    cameras_ =
        std::make_unique<ServedCameras>(ServedCameras::Options{ROTUNDA_COMMAND, Served(), kBlock});
  }
  static void WriteLenses(const std::string& name, const std::vector<Frame>& cameras) {
    Calibration lenses;
    lenses.created_at = "2026-01-01T09:00:00Z";
    for (const Frame& frame : cameras) {
      CalibratedCamera& camera = lenses.cameras.emplace_back();
      camera.camera = frame.camera;
      camera.serial = frame.serial;
      camera.intrinsics = {CameraModel::kPinhole, frame.width_px, frame.height_px, {10, 10, 4, 4}};
    }
    ASSERT_TRUE(WriteCalibration(lenses, *folder_ / name).ok());
  }
  static void WriteConfig(const std::string& name, const FrameSet& set, const std::string& more,
                          int deadline_ms = 1500, bool ptp = false) {
    std::ofstream config(*folder_ / name);
    config << more << "[capture]\nwidth_px = 0\nheight_px = 0\ndeadline_ms = " << deadline_ms
           << "\nlate_ms = 300\nptp = " << (ptp ? "true" : "false") << "\npixel_format = \""
           << set.frames.front().pixel_format << "\"\n[uplinks.u]\n";
    for (size_t i = 0; i < set.frames.size(); ++i) {
      config << "[cameras." << set.frames[i].camera << "]\nserial = \"" << set.frames[i].serial
             << "\"\naddress = \"" << kBlock << '.' << i + 1 << "\"\n";
    }
  }
  /// The last camera is not where the configuration has it.
  static void WriteMovedConfig() {
    std::string config = ReadFile(*folder_ / "rig.toml").value();
    const std::string last = std::string(kBlock) + ".4\"";
    config.replace(config.find(last), last.size(), std::string(kBlock) + ".200\"");
    std::ofstream(*folder_ / "moved.toml") << config;
  }
  static void TearDownTestSuite() {
    cameras_.reset();
    folder_.reset();
  }
  void TearDown() override { cameras_->Send({"clear"}); }

  static std::filesystem::path Served() { return *folder_ / "served"; }
  static ProcessOutcome Capture(const std::string& out, std::vector<std::string> more = {},
                                const std::string& config = "rig.toml",
                                const std::function<bool()>& interrupt_when = nullptr) {
    std::vector<std::string> arguments = {
        "capture",          "--rig", *folder_ / config, "--simulated",
        cameras_->socket(), "--out", *folder_ / out};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return RunRotunda(arguments, interrupt_when);
  }
  /// How the first camera is.
  struct Listed {
    std::string state;
    int frames = -1;  // sent
  };
  static Listed List() {
    std::istringstream list(cameras_->Send({"list"}).output);
    std::string address, name, serial, word;
    Listed first;
    list >> address >> name >> serial >> first.state >> word >> first.frames;
    return first;
  }
  static int FramesSent() { return List().frames; }
  static bool IsAcquiring() { return List().state == "acquiring"; }

  static inline std::unique_ptr<TemporaryFolder> folder_;
  static inline std::unique_ptr<ServedCameras> cameras_;
};

TEST_F(CaptureCommand, WritesThePicturesThatTheCamerasWereGiven) {
  const ProcessOutcome shot =
      Capture("shot", {"--subject", "dummy", "--calibration", *folder_ / "lenses.json"});
  ASSERT_EQ(shot.exit_code, 0) << shot.errors;
  EXPECT_TRUE(Contains(shot.output, "4/4 ok")) << shot.output;
  const auto served = ReadFrameSet(Served());
  const auto taken = ReadFrameSet(*folder_ / "shot");
  ASSERT_TRUE(taken) << taken.error().ToString();
  EXPECT_EQ(taken->subject, "dummy");
  EXPECT_EQ(taken->trigger.at("complete"), TriggerValue(true));
  EXPECT_TRUE(std::filesystem::exists(taken->folder / "calibration.json"));
  ASSERT_EQ(taken->frames.size(), served->frames.size());
  for (size_t i = 0; i < taken->frames.size(); ++i) {
    EXPECT_EQ(taken->frames[i].camera, served->frames[i].camera);
    EXPECT_EQ(taken->frames[i].serial, served->frames[i].serial);
    EXPECT_EQ(taken->frames[i].status, "ok");
    const cv::Mat a = cv::imread(served->folder / served->frames[i].file, cv::IMREAD_UNCHANGED);
    const cv::Mat b = cv::imread(taken->folder / taken->frames[i].file, cv::IMREAD_UNCHANGED);
    // Served in the frame set's own format: nothing is converted on the way.
    ASSERT_EQ(served->frames[i].pixel_format, taken->frames[i].pixel_format);
    ASSERT_EQ(a.size(), b.size());
    EXPECT_EQ(cv::norm(a, b, cv::NORM_L1), 0);
  }
}

TEST_F(CaptureCommand, ACalibrationThatCannotBeReadIsRefusedBeforeThePulse) {
  const int before = FramesSent();
  const ProcessOutcome shot = Capture("unread", {"--calibration", *folder_ / "unread.json"});
  EXPECT_EQ(shot.exit_code, 1);
  EXPECT_TRUE(Contains(shot.errors, "unread.json: format: expected")) << shot.errors;
  EXPECT_EQ(FramesSent(), before);
}

TEST_F(CaptureCommand, ACalibrationOfOtherCamerasIsRefusedBeforeThePulse) {
  const int before = FramesSent();
  const ProcessOutcome shot = Capture("elsewhere", {"--calibration", *folder_ / "elsewhere.json"});
  EXPECT_EQ(shot.exit_code, 1);
  EXPECT_TRUE(Contains(shot.errors,
                       "elsewhere.json: has none of the rig's 4 cameras by name and "
                       "serial number"))
      << shot.errors;
  EXPECT_EQ(FramesSent(), before);
  EXPECT_FALSE(std::filesystem::exists(*folder_ / "elsewhere"));
}

TEST_F(CaptureCommand, CamerasThatTheCalibrationDoesNotHaveAreNamed) {
  const std::string lacking =
      "partly.json does not have 2 of the rig's 4 cameras by name and serial number: c00r1, c00r3";
  const std::vector<std::string> partly = {"--calibration", *folder_ / "partly.json"};
  const ProcessOutcome shot = Capture("partly", partly);
  EXPECT_EQ(shot.exit_code, 0) << shot.errors;
  EXPECT_TRUE(Contains(shot.output, lacking)) << shot.output;
  EXPECT_TRUE(std::filesystem::exists(*folder_ / "partly/calibration.json"));
  const ProcessOutcome json = Capture("partly-json", {partly[0], partly[1], "--json"});
  EXPECT_TRUE(Contains(Json::parse(json.output).at("notes").at(0), lacking)) << json.output;
}

TEST_F(CaptureCommand, CamerasWhoseClocksHaveNotHeardThePtpMasterAreWaitedFor) {
  using Clock = std::chrono::steady_clock;
  ASSERT_EQ(cameras_->Send({"fault", "all", "no-ptp"}).exit_code, 0);
  // Longer than cameras are waited for that cannot be opened.
  const Clock::time_point master_comes = Clock::now() + std::chrono::seconds(7);
  bool has_come = false;
  const ProcessOutcome shot = Capture("ptp", {}, "ptp.toml", [&] {
    if (!has_come && Clock::now() > master_comes) {
      has_come = true;
      cameras_->Send({"clear"});
    }
    return false;
  });
  EXPECT_TRUE(has_come);
  EXPECT_EQ(shot.exit_code, 0) << shot.errors;
}

TEST_F(CaptureCommand, AnIncompleteShotIsWrittenAndSaysSo) {
  ASSERT_EQ(cameras_->Send({"fault", std::string(kBlock) + ".2", "mute"}).exit_code, 0);
  const ProcessOutcome shot = Capture("muted", {"--json"});
  EXPECT_EQ(shot.exit_code, 1);
  EXPECT_TRUE(Contains(shot.errors, "the set is written, but incomplete")) << shot.errors;
  EXPECT_TRUE(Contains(shot.errors, "trigger cable")) << shot.errors;
  const Json told = Json::parse(shot.output);
  EXPECT_EQ(told.at("ok"), 3);
  EXPECT_EQ(told.at("of"), 4);
  EXPECT_EQ(told.at("pulses"), 2) << "it was tried again";
  EXPECT_EQ(told.at("cameras").at(1).at("verdict"), "missing");
  const auto set = ReadFrameSet(*folder_ / "muted");
  ASSERT_TRUE(set) << set.error().ToString();
  EXPECT_EQ(set->frames[1].status, "missing");
}

TEST_F(CaptureCommand, AReasonIsSaidOnce) {
  ASSERT_EQ(cameras_->Send({"fault", std::string(kBlock) + ".2", "mute"}).exit_code, 0);
  const ProcessOutcome one = Capture("one-muted");
  const std::string told = one.output + one.errors;
  EXPECT_EQ(one.exit_code, 1);
  EXPECT_EQ(CountOf(told, "trigger cable"), 1u) << told;
  EXPECT_EQ(CountOf(told, "c00r1"), 1u) << told;
  EXPECT_TRUE(Contains(one.output, "earlier pulse: the same\n")) << told;
  ASSERT_EQ(cameras_->Send({"fault", "all", "mute"}).exit_code, 0);
  const ProcessOutcome all = Capture("all-muted");
  EXPECT_EQ(all.exit_code, 1);
  EXPECT_TRUE(Contains(all.errors, "0/4 ok, no camera gave a picture; all missing ("))
      << all.errors;
  EXPECT_EQ(CountOf(all.errors, "is the trigger cable connected?"), 1u) << all.errors;
  EXPECT_FALSE(Contains(all.output, "skew")) << "of no frame: " << all.output;
  EXPECT_TRUE(std::filesystem::exists(*folder_ / "all-muted/shot.json"));
  const auto set = ReadFrameSet(*folder_ / "all-muted");
  ASSERT_TRUE(set) << set.error().ToString();
  EXPECT_EQ(set->trigger.at("complete"), TriggerValue(false));
  for (const Frame& frame : set->frames) EXPECT_EQ(frame.file, "") << frame.camera;
}

/// A camera that never sends makes the shot wait for a minute.
TEST_F(CaptureCommand, CtrlCKeepsWhatHasComeAndSaysWhere) {
  ASSERT_EQ(cameras_->Send({"fault", std::string(kBlock) + ".2", "mute"}).exit_code, 0);
  const int before = FramesSent();
  const ProcessOutcome shot = Capture("kept", {}, "patient.toml", [&] {
    if (FramesSent() < before + 2) return false;           // the warm-up, and that of the pulse
    std::this_thread::sleep_for(std::chrono::seconds(1));  // those of the others too
    return true;
  });
  EXPECT_EQ(shot.exit_code, 130);
  const std::string out = *folder_ / "kept";
  EXPECT_TRUE(Contains(shot.errors, "rotunda: interrupted, what had come is in " + out +
                                        ", marked incomplete: 3/4 ok; c00r1 interrupted ("))
      << shot.errors;
  const auto set = ReadFrameSet(out);
  ASSERT_TRUE(set) << set.error().ToString();
  EXPECT_EQ(set->trigger.at("complete"), TriggerValue(false));
  EXPECT_EQ(set->frames[1].status, "interrupted");
  EXPECT_EQ(set->frames[2].status, "ok");
  const Json told = Json::parse(test::TextOf(*folder_ / "kept/shot.json"));
  EXPECT_EQ(told.at("interrupted"), true);
  EXPECT_TRUE(Contains(told.at("cameras").at(1).at("reason"), "interrupted"));
}

TEST_F(CaptureCommand, CtrlCBeforeAPictureHasComeLeavesNothing) {
  const std::filesystem::path place = *folder_ / "early";
  std::filesystem::create_directory(place);
  // A camera that is not there is waited for, which is long enough to be interrupted in.
  ASSERT_EQ(cameras_->Send({"fault", std::string(kBlock) + ".2", "unplug"}).exit_code, 0);
  const int before = FramesSent();
  const ProcessOutcome opening = Capture("early/set", {}, "patient.toml",
                                         [&] { return FramesSent() > before; });  // the warm-up
  EXPECT_EQ(opening.exit_code, 130);
  EXPECT_EQ(opening.errors, "rotunda: interrupted while the cameras were being opened\n");
  ASSERT_EQ(cameras_->Send({"clear"}).exit_code, 0);
  ASSERT_EQ(cameras_->Send({"fault", "all", "mute"}).exit_code, 0);
  const ProcessOutcome waiting = Capture("early/set", {}, "patient.toml", [] {
    if (!IsAcquiring()) return false;
    // For the warm-up frame it is so for a moment only.
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    return IsAcquiring();
  });
  EXPECT_EQ(waiting.exit_code, 130);
  EXPECT_EQ(waiting.errors, "rotunda: interrupted before a picture had come, nothing is left\n");
  EXPECT_TRUE(std::filesystem::is_empty(place));
}

TEST_F(CaptureCommand, FiresTheInputThatTheCamerasAreSetTo) {
  const ProcessOutcome shot = Capture("line1", {}, "line1.toml");
  EXPECT_EQ(shot.exit_code, 0) << shot.errors;
  const ProcessOutcome odd = Capture("odd", {}, "odd.toml");
  EXPECT_EQ(odd.exit_code, 1);
  EXPECT_TRUE(Contains(odd.errors, "trigger.camera_input: is \"Opto\"")) << odd.errors;
}

TEST_F(CaptureCommand, APlaceThatCannotBeWrittenIsRefusedBeforeThePulse) {
  const int before = FramesSent();
  const ProcessOutcome shot = Capture("none/shot");
  EXPECT_EQ(shot.exit_code, 1);
  EXPECT_TRUE(Contains(shot.errors, "none does not exist: make it first")) << shot.errors;
  EXPECT_EQ(FramesSent(), before);
}

TEST_F(CaptureCommand, AShotWhoseFolderGoesAwayIsKeptElsewhere) {
  // The muted camera makes the shot wait for seconds after the others' frames have come.
  ASSERT_EQ(cameras_->Send({"fault", std::string(kBlock) + ".2", "mute"}).exit_code, 0);
  const std::filesystem::path parent = *folder_ / "parent";
  const std::filesystem::path temporary = *folder_ / "temporary";
  std::filesystem::create_directory(parent);
  std::filesystem::create_directory(temporary);
  const int before = FramesSent();
  const ProcessOutcome shot = RunProcess(
      {"env", "TMPDIR=" + temporary.string(), ROTUNDA_COMMAND, "capture", "--rig",
       *folder_ / "rig.toml", "--simulated", cameras_->socket(), "--out", parent / "shot"},
      [&] {
        // The warm-up frame, and that of the pulse.
        if (FramesSent() >= before + 2) std::filesystem::remove_all(parent);
        return false;
      });
  EXPECT_EQ(shot.exit_code, 1);
  EXPECT_TRUE(Contains(shot.errors, "No such file or directory")) << shot.errors;
  EXPECT_TRUE(Contains(shot.errors, "instead: move it")) << shot.errors;
  int sets = 0;
  for (const auto& entry : std::filesystem::directory_iterator(temporary)) {
    const auto set = ReadFrameSet(entry.path());
    ASSERT_TRUE(set) << set.error().ToString();
    EXPECT_EQ(set->frames.size(), 4u);
    ++sets;
  }
  EXPECT_EQ(sets, 1) << shot.errors;
}

TEST_F(CaptureCommand, ADiskThatDoesNotAnswerIsToldAndTheShotIsKept) {
  using Clock = std::chrono::steady_clock;
  const std::string hang = *folder_ / "hang";
  std::ofstream(hang) << "";
  std::optional<Clock::time_point> waits_since;
  const ProcessOutcome shot =
      RunProcess({"env", "LD_PRELOAD=" HANGING_FSYNC, "ROTUNDA_TEST_HANG=" + hang, ROTUNDA_COMMAND,
                  "capture", "--rig", *folder_ / "rig.toml", "--simulated", cameras_->socket(),
                  "--out", *folder_ / "slow"},
                 [&] {
                   if (!waits_since && std::filesystem::exists(hang + ".waiting"))
                     waits_since = Clock::now();
                   // Twice as long as it takes to be told.
                   if (waits_since && Clock::now() > *waits_since + std::chrono::seconds(6)) {
                     std::filesystem::remove(hang);
                   }
                   return false;
                 });
  EXPECT_EQ(shot.exit_code, 0) << shot.errors;
  EXPECT_TRUE(Contains(shot.errors, "the disk does not answer; the frames stay in memory"))
      << shot.errors;
  const auto set = ReadFrameSet(*folder_ / "slow");
  ASSERT_TRUE(set) << set.error().ToString();
  EXPECT_EQ(set->trigger.at("complete"), TriggerValue(true));
}

TEST_F(CaptureCommand, CamerasTellsHowEachOneIs) {
  const ProcessOutcome all = RunRotunda({"cameras", "--rig", *folder_ / "rig.toml", "--json"});
  ASSERT_EQ(all.exit_code, 0) << all.errors;
  const Json told = Json::parse(all.output);
  EXPECT_TRUE(told.at("not_in_configuration").is_array());
  const Json cameras = told.at("items");
  ASSERT_EQ(cameras.size(), 4u);
  EXPECT_EQ(cameras[0].at("condition"), "ready");
  EXPECT_EQ(cameras[0].at("address"), std::string(kBlock) + ".1");
  EXPECT_EQ(cameras[0].at("serial"), "CAPT0");
  EXPECT_EQ(cameras[0].at("model"), "SimulatedGigE");
  EXPECT_EQ(cameras[0].at("firmware"), "1.0.0");
  EXPECT_NEAR(cameras[0].at("temperature_deg_c").get<double>(), 41, 3);
  EXPECT_EQ(cameras[0].at("packet_size_bytes"), 9000);
  EXPECT_EQ(cameras[0].at("resent_packets"), 0);
  EXPECT_EQ(cameras[0].at("control_held"), true);
  EXPECT_EQ(cameras[0].at("last_frame_id"), 1) << "of the warm-up";
  EXPECT_GE(cameras[0].at("last_frame_age_s"), 0.0);
  ASSERT_EQ(cameras_->Send({"fault", std::string(kBlock) + ".3", "unplug"}).exit_code, 0);
  const ProcessOutcome less = RunRotunda({"cameras", "--rig", *folder_ / "rig.toml"});
  EXPECT_EQ(less.exit_code, 1);
  EXPECT_TRUE(Contains(less.errors, "3 of 4 are ready")) << less.errors;
  EXPECT_TRUE(Contains(less.output, "no camera answers")) << less.output;
  EXPECT_TRUE(Contains(less.output, " ready        held ")) << less.output;
  EXPECT_TRUE(Contains(less.output, " disconnected - ")) << less.output;
  EXPECT_TRUE(Contains(less.output, " 1, ") && Contains(less.output, " s ago")) << less.output;
  ASSERT_EQ(cameras_->Send({"fault", std::string(kBlock) + ".2", "unplug"}).exit_code, 0);
  const ProcessOutcome two = RunRotunda({"cameras", "--rig", *folder_ / "rig.toml"});
  EXPECT_TRUE(Contains(two.output, "\n2 disconnected (no camera answers")) << two.output;
  EXPECT_EQ(CountOf(two.output, "no camera answers"), 1u) << two.output;
}

TEST_F(CaptureCommand, CamerasCallsAnotherSerialAWrongCamera) {
  const ProcessOutcome told = RunRotunda({"cameras", "--rig", *folder_ / "wrong.toml", "--json"});
  EXPECT_EQ(told.exit_code, 1);
  const Json cameras = Json::parse(told.output).at("items");
  EXPECT_EQ(cameras[0].at("condition"), "ready");
  EXPECT_EQ(cameras[1].at("condition"), "wrong camera");
  EXPECT_TRUE(Contains(cameras[1].at("problem"), "serial OTHER expected at ")) << cameras[1];
}

TEST_F(CaptureCommand, ACameraAtAnotherAddressIsNoUnknownOne) {
  const ProcessOutcome told = RunRotunda({"cameras", "--rig", *folder_ / "moved.toml"});
  EXPECT_EQ(told.exit_code, 1);
  EXPECT_TRUE(Contains(told.output, "c00r3 disconnected (serial CAPT3 is at " +
                                        std::string(kBlock) + ".4, but configured at " + kBlock +
                                        ".200, where nobody answers)"))
      << told.output;
  EXPECT_FALSE(Contains(told.output, "CAPT3 at ")) << "in the configuration: " << told.output;
}

TEST_F(CaptureCommand, WrongUsageIsRefused) {
  EXPECT_EQ(RunRotunda({"capture", "--out", *folder_ / "x"}).exit_code, 2)
      << "by the daemon or not?";
  EXPECT_EQ(RunRotunda({"capture", "--rig", *folder_ / "rig.toml"}).exit_code, 2);
  EXPECT_EQ(RunRotunda({"capture", "--rig", "/nonexistent", "--out", *folder_ / "x"}).exit_code, 1);
  const ProcessOutcome nobody =
      RunRotunda({"capture", "--rig", *folder_ / "rig.toml", "--out", *folder_ / "x", "--simulated",
                  *folder_ / "nobody.sock"});
  EXPECT_EQ(nobody.exit_code, 1);
  EXPECT_TRUE(Contains(nobody.errors, "no simulator listens there")) << nobody.errors;
  const ProcessOutcome taken = Capture("served");
  EXPECT_EQ(taken.exit_code, 1);
  EXPECT_TRUE(Contains(taken.errors, "not empty")) << taken.errors;
}

}  // namespace
}  // namespace rotunda
