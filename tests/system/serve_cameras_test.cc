// The real command as a rig of cameras, used by Aravis' own tool.

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "tests/support/process.h"
#include "tests/support/rotunda_command.h"
#include "tests/support/served_cameras.h"
#include "tests/support/small_frame_set.h"

namespace rotunda {
namespace {

using test::Contains;
using test::ProcessOutcome;
using test::RunProcess;
using test::ServedCameras;
using test::TemporaryFolder;

ProcessOutcome Simulate(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), "simulate");
  return test::RunRotunda(arguments);
}

/// Three small cameras.
class ServeCameras : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<TemporaryFolder>();
    test::WriteSmallFrameSet(*folder_ / "set", 3, "SERVE");
  }
  static void TearDownTestSuite() { folder_.reset(); }
  static ServedCameras::Options At(const std::string& block) {
    return {ROTUNDA_COMMAND, *folder_ / "set", block};
  }
  static inline std::unique_ptr<TemporaryFolder> folder_;
};

TEST(SimulateCommand, TakesAllCamerasOfTheRigThatItIsGiven) {
  const TemporaryFolder folder;
  std::ofstream(folder / "small.toml") << "[rig]\ncolumns = 3\nrows = 2\n";
  const ProcessOutcome outcome =
      Simulate({folder / "out", "--rig", folder / "small.toml", "--scale", "0.06"});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
  EXPECT_TRUE(Contains(outcome.output, "Wrote 6 pictures")) << outcome.output;
}

TEST_F(ServeCameras, TakeCommandsUntilTheyAreEnded) {
  ServedCameras served(At("127.42.1"));
  EXPECT_TRUE(Contains(served.Send({"pulse"}).output, "edge_ns "));
  EXPECT_EQ(served.Send({"fault", "all", "drop", "0.05"}).output, "3 cameras\n");
  const ProcessOutcome wrong = served.Send({"fault", "all", "explode"});
  EXPECT_EQ(wrong.exit_code, 1);
  EXPECT_TRUE(Contains(wrong.errors, "expected one of drop, no-resend")) << wrong.errors;
  const ProcessOutcome bare = served.Send({"fault", "all", "drop"});
  EXPECT_EQ(bare.exit_code, 1);
  EXPECT_TRUE(Contains(bare.errors, "\"drop\" needs a value, 0..1")) << bare.errors;
  EXPECT_EQ(served.Send({"shot", "0"}).output, "shot 0\n");
  const ProcessOutcome beyond = served.Send({"shot", "99"});
  EXPECT_EQ(beyond.exit_code, 1);
  EXPECT_TRUE(Contains(beyond.errors, "shot is 99, expected 0, the only one")) << beyond.errors;
  const ProcessOutcome line = served.Send({"pulse", "2"});
  EXPECT_EQ(line.exit_code, 1);
  EXPECT_TRUE(Contains(line.errors, "line is 2, expected 0 to 1")) << line.errors;
  EXPECT_TRUE(Contains(served.Send({"list"}).output, "127.42.1.3 "));
  EXPECT_TRUE(std::filesystem::exists(served.socket()));
  const ProcessOutcome& ended = served.End();
  EXPECT_EQ(ended.exit_code, 0) << ended.errors;
  EXPECT_TRUE(Contains(ended.output, "3 cameras at 127.42.1.1 to 127.42.1.3: 120x160 RGB8"))
      << ended.output;
  EXPECT_FALSE(std::filesystem::exists(served.socket()));
  EXPECT_EQ(served.Send({"pulse"}).exit_code, 1);
}

TEST_F(ServeCameras, ListTellsTheFaultsInForce) {
  ServedCameras served(At("127.42.5"));
  served.Send({"fault", "c00r1", "drop", "0.05"});
  served.Send({"fault", "c00r1", "late", "800", "2"});
  served.Send({"fault", "c00r2", "unplug"});
  const std::string list = served.Send({"list"}).output;
  EXPECT_TRUE(Contains(list, "c00r0 SERVE0 free frames 0 resent 0 missed 0\n")) << list;
  EXPECT_TRUE(Contains(list,
                       "c00r1 SERVE1 free frames 0 resent 0 missed 0 faults drop 0.05, late "
                       "800 (2 more)\n"))
      << list;
  EXPECT_TRUE(Contains(list, "c00r2 SERVE2 gone frames 0 resent 0 missed 0 faults unplug\n"))
      << list;
  served.Send({"clear"});
  EXPECT_FALSE(Contains(served.Send({"list"}).output, "faults"));
}

TEST_F(ServeCameras, ArvToolListsAndReadsThem) {
  const std::string tool = "arv-tool-0.8";
  if (RunProcess({tool, "--help"}).exit_code != 0) {
    GTEST_SKIP() << tool << " (package aravis-tools-cli) is not installed";
  }
  ServedCameras served(At("127.42.2"));
  const ProcessOutcome list = RunProcess({tool});
  for (const char* address : {"127.42.2.1", "127.42.2.2", "127.42.2.3"}) {
    EXPECT_TRUE(Contains(list.output, std::string("Rotunda-SimulatedGigE-")) &&
                Contains(list.output, "(" + std::string(address) + ")"))
        << list.output;
  }
  const ProcessOutcome read = RunProcess({tool, "-a", "127.42.2.2", "control", "Width", "Height",
                                          "PixelFormat", "TriggerSource", "DeviceTemperature"});
  for (const char* line : {"Width = 120", "Height = 160", "PixelFormat = RGB8",
                           "TriggerSource = Line0", "DeviceTemperature = "}) {
    EXPECT_TRUE(Contains(read.output, line)) << read.output << read.errors;
  }
  const ProcessOutcome features = RunProcess({tool, "-a", "127.42.2.2", "features"});
  EXPECT_TRUE(Contains(features.output, "'TriggerSoftware'")) << features.output;
}

TEST_F(ServeCameras, ShowWhatWouldBeRendered) {
  ServedCameras served({ROTUNDA_COMMAND,
                        "",
                        "127.42.4",
                        {"--cameras", "2", "--scale", "0.1", "--target", "cuboid", "--seed", "5"}});
  EXPECT_TRUE(Contains(served.Send({"list"}).output, "127.42.4.2 "));
  const ProcessOutcome& ended = served.End();
  EXPECT_EQ(ended.exit_code, 0) << ended.errors;
  EXPECT_TRUE(Contains(ended.output, "2 cameras at 127.42.4.1 to 127.42.4.2: 120x160 BayerRG8"))
      << ended.output;
}

TEST_F(ServeCameras, WrongUsageIsRefused) {
  EXPECT_EQ(Simulate({}).exit_code, 2);
  EXPECT_EQ(Simulate({"out", "--serve"}).exit_code, 2);
  EXPECT_EQ(Simulate({"--serve", "--block", "10.0.0"}).exit_code, 2);
  EXPECT_EQ(Simulate({"--serve", "--pixel-format", "Mono12"}).exit_code, 2);
  EXPECT_EQ(Simulate({"--serve", "/nonexistent"}).exit_code, 1);
}

TEST_F(ServeCameras, HelpTellsTheWholePulseCommandTheSocketAndHowServingEnds) {
  const std::string help = Simulate({"--help"}).output;
  EXPECT_TRUE(Contains(help, "pulse [LINE [EDGE_NS [WIDTH_US]]]")) << help;
  EXPECT_TRUE(Contains(help, "/tmp/rotunda-cameras-UID.sock")) << help;
  EXPECT_TRUE(Contains(help, "exit status 0")) << help;
}

TEST_F(ServeCameras, SeveralCamerasCanBeMoved) {
  EXPECT_EQ(Simulate({"out", "--move", "c00r0", "far"}).exit_code, 2);
  EXPECT_EQ(Simulate({"out", "--move", "c00r0"}).exit_code, 2);
  EXPECT_EQ(Simulate({"out", "--turn", "c00r0", "far"}).exit_code, 2);
  // Two pairs, and the folder is not taken for part of them.
  const ProcessOutcome moved =
      Simulate({"--move", "c00r0", "-5", "--move", "nobody", "3", *folder_ / "out"});
  EXPECT_EQ(moved.exit_code, 1);
  EXPECT_TRUE(Contains(moved.errors, "the rig has no camera 'nobody'")) << moved.errors;
}

}  // namespace
}  // namespace rotunda
