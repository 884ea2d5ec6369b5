// The real daemon on a state folder of thousands of captures of 90 cameras, each with its
// reconstruction and drift, some cameras beyond their limit in the newer half: how long a start
// takes, and reads over the socket. Ends with 1 when a start takes 2 s or more, or the slowest
// hundredth of one kind of read 50 ms or more.

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "daemon/store_calibrations.h"
#include "daemon/store_captures.h"
#include "daemon/store_reconstructions.h"
#include "daemon/store_sql.h"
#include "sfm/core/file_io.h"
#include "sfm/core/frame_set.h"
#include "sfm/core/pose_set.h"
#include "tests/bench/daemon_checks.h"
#include "tests/bench/process_cost.h"
#include "tests/support/simulated_daemon.h"
#include "tests/support/unix_http.h"

namespace rotunda {
namespace {

namespace fs = std::filesystem;
using bench::Require;
using daemon::Database;
using std::chrono::milliseconds;
using test::SimulatedDaemon;
using test::UnixConnection;
using Clock = std::chrono::steady_clock;

struct Arguments {
  int captures = 2000;
  int cameras = 90;
  int moved = 3;  // of the cameras
  int reads = 300;
  std::string block = "127.63.4";
};

constexpr double kMostForStart_ms = 2000;
constexpr double kMostForRead_ms = 50;
constexpr int kStarts = 3;
// Nothing here takes nearly so long unless it hangs.
constexpr auto kPatience = milliseconds(300000);
constexpr char kCalibration[] = "now";

double MillisecondsSince(Clock::time_point begin) { return 1000 * SecondsSince(begin); }

std::string CaptureName(int index) { return "x" + std::to_string(100000 + index); }

std::unique_ptr<daemon::Store> Open(const fs::path& state, daemon::EventHub& hub) {
  return Must(
      daemon::Store::Open({state, [] { return std::chrono::system_clock::now(); }, {}}, hub));
}

/// Folders as they lie on the disk; of the frames only what frameset.json says. An hour apart.
void WriteCaptures(const fs::path& state, FrameSet set, int captures) {
  for (Frame& frame : set.frames) {
    frame.status = "missing";
    frame.file.clear();
  }
  const std::chrono::sys_days first(std::chrono::year(2026) / 1 / 1);
  for (int i = 0; i < captures; ++i) {
    set.id = CaptureName(i);
    set.captured_at = daemon::TimeText(first + std::chrono::hours(i));
    fs::create_directories(state / "captures" / set.id);
    Must(WriteNewFile(state / "captures" / set.id / "frameset.json", FrameSetToJson(set)));
  }
}

void WriteCalibrationInForce(const fs::path& state, const fs::path& original) {
  Calibration calibration = Must(ReadCalibration(original));
  calibration.id = kCalibration;
  const fs::path folder = state / "calibrations" / kCalibration;
  fs::create_directories(folder);
  Must(WriteCalibration(calibration, folder / "calibration.json"));
}

void WriteReconstructions(const fs::path& state, int captures) {
  PoseSet poses;
  poses.method = "tc-sfm";
  for (int i = 0; i < captures; ++i) {
    poses.frameset = CaptureName(i);
    const fs::path folder = state / "reconstructions" / (poses.frameset + "-r1");
    fs::create_directories(folder);
    Must(WriteNewFile(folder / "poses.json", PoseSetToJson(poses)));
  }
}

/// A reconstruction, a job, ten events, and drift of every camera for each capture; `moved` cameras
/// are beyond their limit in the newer half.
Status FillTables(daemon::Store& store, int moved) {
  const std::string is_moved =
      "camera IN (SELECT DISTINCT camera FROM frames ORDER BY camera LIMIT " +
      std::to_string(moved) +
      ") AND captured_at >= (SELECT captured_at FROM captures ORDER BY captured_at "
      "LIMIT 1 OFFSET (SELECT count(*) / 2 FROM captures))";
  return store.Write([&is_moved](Database& database, auto&) {
    return database.Execute(
        "INSERT INTO reconstructions (id, capture, calibration, created_at, method, registered, "
        "of_cameras, rms_px, verdict, verdict_reason, folded, used_for_drift) "
        "SELECT id || '-r1', id, 'now', captured_at, 'tc-sfm', frames, frames, 0.5, 'sure', '', 0, "
        "1 FROM captures;"
        "INSERT INTO drift (calibration, camera, captured_at, capture, reconstruction, "
        "rotation_deg, position_mm, rotation_sigma_deg, position_sigma_mm, beyond_limit) SELECT "
        "'now', camera, captured_at, id, id || '-r1', 0.01, "
        "iif(" +
        is_moved + ", 20, 0.4), 0.01, 0.3, " + is_moved +
        " FROM captures JOIN frames ON capture = id;"
        "INSERT INTO jobs (kind, state, body, product, created_at) "
        "SELECT 'capture', 'done', '{}', id, captured_at FROM captures;"
        "INSERT INTO events (at, kind, about, data) SELECT captured_at, 'job_done', id, '{}' "
        "FROM captures JOIN (SELECT DISTINCT camera FROM frames LIMIT 10)");
  });
}

/// What years of captures leave.
void FillState(const fs::path& state, const fs::path& person, const Arguments& arguments) {
  WriteCaptures(state, Must(ReadFrameSet(person)), arguments.captures);
  WriteCalibrationInForce(state, person / "calibration.json");
  daemon::EventHub hub;
  const auto begin = Clock::now();
  auto store = Open(state, hub);
  std::printf("%zu folders found without a database: %.0f ms\n", store->recovery().adopted.size(),
              MillisecondsSince(begin));
  Must(daemon::ActivateCalibration(*store, kCalibration));
  Must(FillTables(*store, arguments.moved));
  WriteReconstructions(state, arguments.captures);
  store = nullptr;
  ::sync();  // what was written for the measurement is not what is measured
  std::printf("database: %.0f MB\n",
              1e-6 * static_cast<double>(fs::file_size(state / "rotunda.db")));
}

/// Whether the daemon told systemd in time that it is ready.
bool StartsInTime(const SimulatedDaemon& daemon, const fs::path& notify_socket,
                  std::unique_ptr<test::BackgroundProcess>& process) {
  fs::remove(notify_socket);
  test::NotifySocket systemd(notify_socket);
  const auto begin = Clock::now();
  process = daemon.Start({{"NOTIFY_SOCKET", notify_socket}});
  Require(systemd.WaitFor("READY=1", kPatience), "it does not become ready:\n" + daemon.Log());
  const double start_ms = MillisecondsSince(begin);
  const bool is_fast = start_ms < kMostForStart_ms;
  std::printf("start-up: %.0f ms%s\n", start_ms, is_fast ? "" : "  TOO SLOW");
  return is_fast;
}

/// Prints median and 99th percentile of many reads; whether the latter is within the limit.
bool ReadsInTime(const SimulatedDaemon& daemon, const std::string& target, int reads) {
  UnixConnection connection(daemon.Socket());
  std::vector<double> times_ms;
  for (int i = 0; i < reads; ++i) {
    const auto begin = Clock::now();
    connection.Send("GET " + target + " HTTP/1.1\r\nHost: localhost\r\n\r\n");
    Require(test::ReadAnswer(connection).status == 200, "GET " + target + " fails");
    times_ms.push_back(MillisecondsSince(begin));
  }
  const double slow_ms = bench::Quantile(times_ms, 0.99);
  const bool is_fast = slow_ms < kMostForRead_ms;
  std::printf("%-50s %8.2f %8.2f%s\n", target.c_str(), bench::Quantile(times_ms, 0.5), slow_ms,
              is_fast ? "" : "  TOO SLOW");
  return is_fast;
}

bool AllReadsInTime(const SimulatedDaemon& daemon, const Arguments& arguments) {
  const nlohmann::json status = daemon.Get("/v1/status");
  Require(status.is_object() && status["moved"].size() == static_cast<size_t>(arguments.moved),
          "expected " + std::to_string(arguments.moved) + " cameras that moved: " + status.dump());
  const std::string moved = status["moved"][0]["camera"];
  const std::string next = daemon.Get("/v1/captures?limit=500").at("next");
  const std::string capture = "/v1/captures/" + CaptureName(arguments.captures / 2);
  std::printf("%-50s %8s %8s\n", "milliseconds", "median", "99 %");
  bool all_fast = true;
  for (const std::string& target :
       {std::string("/v1/status"), std::string("/v1/cameras"), std::string("/v1/captures"),
        std::string("/v1/captures?limit=500"), "/v1/captures?limit=500&after=" + next, capture,
        capture + "/reconstructions", "/v1/reconstructions/" + CaptureName(0) + "-r1",
        std::string("/v1/drift"), "/v1/drift?limit=500&camera=" + moved, std::string("/v1/jobs")}) {
    all_fast &= ReadsInTime(daemon, target, arguments.reads);
  }
  return all_fast;
}

bool Measure(const Arguments& arguments) {
  const test::TemporaryFolder folder;
  bench::Render(ROTUNDA_COMMAND, folder / "person",
                {"--cameras", std::to_string(arguments.cameras), "--scale", "0.1"});
  SimulatedDaemon::Options options;
  options.command = ROTUNDA_COMMAND;
  options.daemon = ROTUNDA_DAEMON;
  options.board = std::string(ROTUNDA_SOURCE_DIR) + "/config/cuboid.toml";
  options.frame_sets = {folder / "person"};
  options.block = arguments.block;
  options.more_config = "[storage]\nreserve_mb = 10\n";
  const SimulatedDaemon daemon(options);
  FillState(daemon.State(), folder / "person", arguments);
  bool is_fast = true;
  for (int i = 0; i < kStarts; ++i) {
    std::unique_ptr<test::BackgroundProcess> process;
    is_fast &= StartsInTime(daemon, folder / "notify.sock", process);
    Require(daemon.WaitForCameras(static_cast<size_t>(arguments.cameras), kPatience),
            "the cameras do not become ready:\n" + daemon.Log());
    if (i + 1 == kStarts) is_fast &= AllReadsInTime(daemon, arguments);
    process->Signal(SIGTERM);
    Require(process->Wait() == 0, "the daemon did not stop well:\n" + daemon.Log());
  }
  return is_fast;
}

int Main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app(
      "The real daemon with thousands of captures; ends with 1 when a start or a read is slow");
  app.add_option("--captures", arguments.captures)
      ->check(CLI::Range(1001, 8000))
      ->capture_default_str();
  app.add_option("--cameras", arguments.cameras, "Simulated cameras")->capture_default_str();
  app.add_option("--moved", arguments.moved, "Of them, beyond the limit in the newer captures")
      ->check(CLI::Range(1, 10000))
      ->capture_default_str();
  app.add_option("--reads", arguments.reads, "Of each kind")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  app.add_option("--block", arguments.block, "Addresses of the cameras")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    return Measure(arguments) ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "daemon_store: %s\n", error.what());
    return 1;
  }
}

}  // namespace
}  // namespace rotunda

int main(int argc, char** argv) { return rotunda::Main(argc, argv); }
