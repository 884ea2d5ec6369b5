// The real command as a rig of cameras, used by Aravis' own tool.

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/process.h"

namespace rotunda {
namespace {

using test::ProcessOutcome;
using test::RunProcess;
using test::TemporaryFolder;

ProcessOutcome Simulate(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), {ROTUNDA_COMMAND, "simulate"});
  return RunProcess(arguments);
}

bool Contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// `rotunda simulate --serve` of a small frame set, until the object goes.
class Served {
 public:
  explicit Served(const std::string& block) {
    const ProcessOutcome set =
        Simulate({folder_ / "set", "--cameras", "3", "--scale", "0.1", "--background", "plain"});
    EXPECT_EQ(set.exit_code, 0) << set.errors;
    server_ = std::thread([this, block] {
      outcome_ = RunProcess({ROTUNDA_COMMAND, "simulate", "--serve", folder_ / "set", "--block",
                             block, "--socket", socket()},
                            [this] { return done_.load(); });
      ended_ = true;
    });
    while (!ended_ && Send({"list"}).exit_code != 0) {
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
  }
  ~Served() { End(); }

  std::string socket() const { return folder_ / "cameras.sock"; }
  ProcessOutcome Send(std::vector<std::string> words) {
    words.insert(words.begin(), {"--socket", socket(), "--send"});
    return Simulate(words);
  }
  /// As Ctrl-C would.
  const ProcessOutcome& End() {
    done_ = true;
    if (server_.joinable()) server_.join();
    return outcome_;
  }

 private:
  TemporaryFolder folder_;
  std::atomic<bool> done_ = false;
  std::atomic<bool> ended_ = false;
  ProcessOutcome outcome_;
  std::thread server_;
};

TEST(ServeCameras, TakeCommandsUntilTheyAreEnded) {
  Served served("127.42.1");
  EXPECT_TRUE(Contains(served.Send({"pulse"}).output, "edge_ns "));
  EXPECT_EQ(served.Send({"fault", "all", "drop", "0.05"}).output, "3 cameras\n");
  const ProcessOutcome wrong = served.Send({"fault", "all", "explode"});
  EXPECT_EQ(wrong.exit_code, 1);
  EXPECT_TRUE(Contains(wrong.errors, "expected one of drop, no-resend")) << wrong.errors;
  EXPECT_TRUE(Contains(served.Send({"list"}).output, "127.42.1.3 "));
  EXPECT_TRUE(std::filesystem::exists(served.socket()));
  const ProcessOutcome& ended = served.End();
  EXPECT_EQ(ended.exit_code, 0) << ended.errors;
  EXPECT_TRUE(Contains(ended.output, "3 cameras at 127.42.1.1 to 127.42.1.3: 120x160 RGB8"))
      << ended.output;
  EXPECT_FALSE(std::filesystem::exists(served.socket()));
  EXPECT_EQ(served.Send({"pulse"}).exit_code, 1);
}

TEST(ServeCameras, ArvToolListsAndReadsThem) {
  const std::string tool = "arv-tool-0.8";
  if (RunProcess({tool, "--help"}).exit_code != 0) {
    GTEST_SKIP() << tool << " (package aravis-tools-cli) is not installed";
  }
  Served served("127.42.2");
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

TEST(ServeCameras, WrongUsageIsRefused) {
  EXPECT_EQ(Simulate({}).exit_code, 2);
  EXPECT_EQ(Simulate({"out", "--serve"}).exit_code, 2);
  EXPECT_EQ(Simulate({"--serve", "--block", "10.0.0"}).exit_code, 2);
  EXPECT_EQ(Simulate({"--serve", "--pixel-format", "Mono12"}).exit_code, 2);
  EXPECT_EQ(Simulate({"--serve", "/nonexistent"}).exit_code, 1);
}

}  // namespace
}  // namespace rotunda
