#include <unistd.h>
#include <xxhash.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "daemon/store_captures.h"
#include "daemon/store_jobs.h"
#include "sfm/core/file_io.h"
#include "sfm/core/frame_set.h"
#include "tests/support/background_process.h"
#include "tests/support/process.h"
#include "tests/support/unix_http.h"

// The real daemon with simulated cameras, killed at random moments while it captures, calibrates
// and reconstructs. After each kill the store must be whole: every capture that was acknowledged is
// there by its checksums, every job is done, failed, interrupted or queued. In the end everything
// that was asked for is done.

namespace rotunda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;
using test::BackgroundProcess;

struct Arguments {
  int crashes = 20;
  int cameras = 12;
  unsigned seed = 1;
  int max_ms = 12000;  // cameras of a killed daemon are locked for 3 s of that
  std::string block = "127.63.1";
};

constexpr int kTargets = 2;  // shots of the calibration target that the first captures take
constexpr auto kPollInterval = milliseconds(30);

void Require(bool fine, const std::string& what) {
  if (!fine) throw std::runtime_error(what);
}

class World {
 public:
  explicit World(const Arguments& arguments) : arguments_(arguments) {
    const std::vector<std::string> common = {"--cameras", std::to_string(arguments.cameras),
                                             "--scale", "0.3"};
    Simulate("target", {"--target", "cuboid", "--placements", std::to_string(kTargets)}, common);
    Simulate("person", {}, common);
    BackgroundProcess::Options options;
    options.arguments = {ROTUNDA_COMMAND, "simulate", "--serve"};
    for (int i = 0; i < kTargets; ++i) {
      options.arguments.push_back(folder_ / ("target/placement_0" + std::to_string(i)));
    }
    options.arguments.insert(
        options.arguments.end(),
        {folder_ / "person", "--block", arguments.block, "--socket", folder_ / "cameras.sock"});
    options.output = folder_ / "cameras.log";
    cameras_ = std::make_unique<BackgroundProcess>(options);
    WriteConfig();
  }

  fs::path State() const { return folder_ / "state"; }
  fs::path Socket() const { return folder_ / "api.sock"; }

  std::unique_ptr<BackgroundProcess> StartDaemon() const {
    return std::make_unique<BackgroundProcess>(BackgroundProcess::Options{
        {ROTUNDA_DAEMON, "--config", folder_ / "rotundad.toml"}, {}, {}, folder_ / "log"});
  }
  std::string Log() const { return ReadFile(folder_ / "log").value(); }

 private:
  void Simulate(const std::string& name, std::vector<std::string> what,
                const std::vector<std::string>& common) {
    what.insert(what.begin(), {ROTUNDA_COMMAND, "simulate", folder_ / name});
    what.insert(what.end(), common.begin(), common.end());
    const auto outcome = test::RunProcess(what);
    Require(outcome.exit_code == 0, outcome.errors);
  }

  void WriteConfig() const {
    const auto set = ReadFrameSet(folder_ / "person");
    Require(set.ok(), "no frame set");
    std::ofstream capture(folder_ / "capture.toml");
    capture << "[capture]\nwidth_px = 0\nheight_px = 0\npixel_format = \""
            << set->frames[0].pixel_format << "\"\n[uplinks.u]\n";
    for (size_t i = 0; i < set->frames.size(); ++i) {
      capture << "[cameras." << set->frames[i].camera << "]\nserial = \"" << set->frames[i].serial
              << "\"\naddress = \"" << arguments_.block << "." << i + 1 << "\"\n";
    }
    std::ofstream(folder_ / "rotundad.toml")
        << "[service]\nsocket = \"" << Socket().string() << "\"\nstate_folder = \""
        << State().string() << "\"\n[devices]\nboard = \"" << ROTUNDA_SOURCE_DIR
        << "/config/cuboid.toml\"\nsimulated_socket = \"" << (folder_ / "cameras.sock").string()
        << "\"\n[storage]\nreserve_mb = 10\n";
  }

  const Arguments arguments_;
  test::TemporaryFolder folder_;
  std::unique_ptr<BackgroundProcess> cameras_;
};

/// The answer's JSON; null when the daemon is not there (any more).
Json Ask(const World& world, const std::string& method, const std::string& target,
         const std::string& body = "") {
  try {
    const auto answer = test::Ask(world.Socket(), method, target, body,
                                  body.empty() ? "" : "Content-Type: application/json\r\n");
    if (answer.status == 0 || answer.status >= 500) return nullptr;
    return Json::parse(answer.body, nullptr, false);
  } catch (const std::exception&) {
    return nullptr;
  }
}

/// Runs again what was interrupted, keeps every kind of job coming, and notes captures that are
/// told to be done, until `end` or until nothing is left to do.
class Client {
 public:
  explicit Client(const World& world) : world_(world) {}

  void Run(Clock::time_point end, bool new_work) {
    bool reran = false;
    while (Clock::now() < end) {
      std::this_thread::sleep_for(kPollInterval);
      const Json jobs = Ask(world_, "GET", "/v1/jobs?limit=500");
      if (!jobs.is_object() || !jobs.contains("items")) continue;
      size_t open = 0;
      for (const Json& job : jobs["items"]) {
        open += job["state"] == "queued" || job["state"] == "running";
        Note(job);
      }
      if (!reran) {
        for (const Json& job : jobs["items"]) {
          if (job["state"] != "interrupted") continue;
          Ask(world_, "POST", "/v1/jobs/" + job["id"].dump() + "/rerun");
        }
        reran = true;
        continue;
      }
      if (open == 0 && !new_work) return;
      if (open < 3 && new_work) Submit();
    }
  }

  std::set<std::string> acknowledged;  // captures

 private:
  void Note(const Json& job) {
    if (job["kind"] == "capture" && job["state"] == "done") {
      acknowledged.insert(job["result"]["capture"].get<std::string>());
    }
  }
  void Submit() {
    const bool can_calibrate = acknowledged.size() >= kTargets;
    if (can_calibrate && turn_++ % 3 == 0) {
      Json captures = Json::array();
      for (const std::string& id : acknowledged) {
        if (captures.size() < kTargets) captures.push_back(id);
      }
      Ask(world_, "POST", "/v1/calibrations", Json({{"captures", captures}}).dump());
    } else {
      Ask(world_, "POST", "/v1/captures", Json({{"reconstruct", can_calibrate}}).dump());
    }
  }

  const World& world_;
  int turn_ = 0;
};

/// Throws with what is wrong; counts what was put right.
struct Repaired {
  size_t interrupted = 0, adopted = 0, temporaries = 0, captures = 0;
};
void CheckState(const World& world, const std::set<std::string>& acknowledged, Repaired& repaired) {
  daemon::EventHub hub;
  auto store = daemon::Store::Open(
      {world.State(), [] { return std::chrono::system_clock::now(); }, {}}, hub);
  Require(store.ok(), store.ok() ? "" : store.error().ToString());
  const daemon::RecoveryReport& recovery = (*store)->recovery();
  Require(recovery.gone.empty() && recovery.unreadable.empty(), "a folder is gone or unreadable");
  repaired.interrupted += recovery.interrupted.size();
  repaired.adopted += recovery.adopted.size();
  repaired.temporaries += recovery.removed_temporaries;
  for (const std::string& id : acknowledged) {
    Require(daemon::FindCapture(**store, id).ok(), "capture " + id + " is lost");
  }
  const auto captures = daemon::ListCaptures(**store, {daemon::kMaxPageLimit, ""});
  Require(captures.ok(), "captures cannot be listed");
  repaired.captures = captures->items.size();
  for (const daemon::CaptureRecord& capture : captures->items) {
    const auto frames = daemon::ListFrames(**store, capture.id);
    for (const daemon::FrameRecord& frame : *frames) {
      if (frame.file.empty()) continue;
      const auto bytes = ReadFile(world.State() / frame.file);
      Require(bytes.ok(), frame.file + " cannot be read");
      char sum[17];
      std::snprintf(sum, sizeof(sum), "%016llx",
                    static_cast<unsigned long long>(XXH3_64bits(bytes->data(), bytes->size())));
      Require(sum == frame.xxh3, frame.file + " is not what was taken");
    }
  }
  const auto running = daemon::CountJobs(**store, daemon::JobState::kRunning);
  Require(running.ok() && *running == 0, "a job is said to run");
}

void Measure(const Arguments& arguments) {
  const World world(arguments);
  Client client(world);
  Repaired repaired;
  std::mt19937 random(arguments.seed);
  std::uniform_int_distribution<int> patience_ms(100, arguments.max_ms);
  for (int crash = 0; crash < arguments.crashes; ++crash) {
    const auto daemon = world.StartDaemon();
    client.Run(Clock::now() + milliseconds(patience_ms(random)), true);
    daemon->Signal(SIGKILL);
    const int code = daemon->Wait();
    Require(code == 128 + SIGKILL, "the daemon ended by itself:\n" + world.Log());
    CheckState(world, client.acknowledged, repaired);
    std::printf("crash %d: %zu captures, %zu of them acknowledged\n", crash + 1, repaired.captures,
                client.acknowledged.size());
    std::fflush(stdout);
  }
  const auto daemon = world.StartDaemon();
  client.Run(Clock::now() + std::chrono::minutes(30), false);
  daemon->Signal(SIGTERM);
  Require(daemon->Wait() == 0, "the daemon did not stop well:\n" + world.Log());
  CheckState(world, client.acknowledged, repaired);
  std::printf(
      "%d crashes: %zu jobs interrupted, %zu folders adopted, %zu half-written ones removed; "
      "all %zu captures are whole\n",
      arguments.crashes, repaired.interrupted, repaired.adopted, repaired.temporaries,
      repaired.captures);
}

int Main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app("The daemon killed at random moments of its work");
  app.add_option("--crashes", arguments.crashes)->capture_default_str();
  app.add_option("--cameras", arguments.cameras)->capture_default_str();
  app.add_option("--seed", arguments.seed)->capture_default_str();
  app.add_option("--max-ms", arguments.max_ms, "Longest life")->capture_default_str();
  app.add_option("--block", arguments.block, "Addresses of the cameras")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    Measure(arguments);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}

}  // namespace
}  // namespace rotunda

int main(int argc, char** argv) { return rotunda::Main(argc, argv); }
