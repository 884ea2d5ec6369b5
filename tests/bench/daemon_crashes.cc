#include <CLI/CLI.hpp>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <random>
#include <string>
#include <thread>

#include "tests/bench/daemon_checks.h"
#include "tests/bench/daemon_disk_full.h"
#include "tests/support/simulated_daemon.h"

// The real daemon with simulated cameras, killed at random moments while it captures, calibrates,
// reconstructs and writes its store, and its disk filled up. After each time the store must be
// whole (StateInspector); in the end every job has come to its end, and why some failed, which must
// be for one of few reasons, is printed. Ends with 1 and says what when something is not so.

namespace rotunda {
namespace {

using bench::CountsText;
using bench::DaemonClient;
using bench::Require;
using bench::StateInspector;
using std::chrono::milliseconds;
using test::SimulatedDaemon;

struct Arguments {
  int crashes = 200;
  int full_disks = 24;
  int cameras = 12;
  unsigned seed = 1;
  int max_ms = 6000;
  std::string block = "127.63.1";
};

// With so many crashes each kind of job must have been hit, or the measurement is worth nothing.
constexpr int kEnoughForAllKinds = 100;
constexpr int kTellEvery = 10;
constexpr auto kLastPatience = std::chrono::minutes(30);

void PrintFailures(const StateInspector::Findings& findings) {
  for (const auto& [reason, count] : findings.failures) {
    std::printf("  %zu x %s\n", count, reason.c_str());
  }
}

/// What is left comes to its end.
void Finish(const SimulatedDaemon& daemon, DaemonClient& client, StateInspector& inspector) {
  const auto process = daemon.Start();
  Require(client.Run(kLastPatience, false), "jobs do not end:\n" + daemon.Log());
  process->Signal(SIGTERM);
  Require(process->Wait() == 0, "the daemon did not stop well:\n" + daemon.Log());
  inspector.Look(client.acknowledged, true);
  for (const auto& [state, count] : inspector.findings().jobs) {
    Require(state == "done" || state == "failed",
            "not all came to their end: " + CountsText(inspector.findings().jobs));
  }
  Require(inspector.findings().jobs.contains("done"), "every job failed");
}

void MeasureCrashes(const Arguments& arguments, const SimulatedDaemon::Options& options) {
  const SimulatedDaemon daemon(options);
  DaemonClient client(daemon);
  StateInspector inspector(daemon.State());
  std::mt19937 random(arguments.seed);
  std::uniform_int_distribution<int> life_ms(100, arguments.max_ms);
  for (int crash = 1; crash <= arguments.crashes; ++crash) {
    const auto process = daemon.Start();
    const milliseconds life(life_ms(random));
    {
      // Beside the client, so that requests are hit, too.
      const std::jthread killer([&process, life] {
        std::this_thread::sleep_for(life);
        process->Signal(SIGKILL);
      });
      client.Run(life, true);
    }
    const int status = process->Wait();
    Require(status == 128 + SIGKILL, "the daemon ended by itself, exit status " +
                                         std::to_string(status) + ":\n" + daemon.Log());
    // Else they would wait 3 s for the heartbeat of the dead one, and lives are short.
    daemon.SendToCameras({"fault", "all", "reboot", "100"});
    inspector.Look(client.acknowledged, false);
    if (crash % kTellEvery != 0) continue;
    std::printf("crash %d: %zu captures, %zu of them acknowledged; interrupted so far: %s\n", crash,
                inspector.findings().captures, client.acknowledged.size(),
                CountsText(inspector.findings().interrupted).c_str());
    std::fflush(stdout);
  }
  Finish(daemon, client, inspector);
  const StateInspector::Findings& findings = inspector.findings();
  std::printf(
      "%d crashes: jobs interrupted: %s; %zu folders adopted, %zu half-written ones removed\n"
      "all %zu captures are whole (%zu acknowledged; %zu pictures compared), %zu have the "
      "reconstruction they asked for, jobs: %s\n",
      arguments.crashes, CountsText(findings.interrupted).c_str(), findings.adopted,
      findings.temporaries, findings.captures, client.acknowledged.size(), findings.pictures,
      findings.follow_ups, CountsText(findings.jobs).c_str());
  PrintFailures(findings);
  if (arguments.crashes < kEnoughForAllKinds) return;
  for (const char* kind : {"capture", "calibration", "reconstruction"}) {
    Require(findings.interrupted.contains(kind), std::string("no crash hit a ") + kind);
  }
  Require(findings.follow_ups > 0, "no capture asked for its reconstruction");
}

void Measure(const Arguments& arguments) {
  const test::TemporaryFolder folder;
  SimulatedDaemon::Options options;
  options.command = ROTUNDA_COMMAND;
  options.daemon = ROTUNDA_DAEMON;
  options.board = std::string(ROTUNDA_SOURCE_DIR) + "/config/cuboid.toml";
  options.frame_sets = bench::RenderScenes(ROTUNDA_COMMAND, folder.path(), arguments.cameras);
  options.block = arguments.block;
  options.more_config = "[storage]\nreserve_mb = 10\n";
  if (arguments.crashes > 0) MeasureCrashes(arguments, options);
  if (arguments.full_disks > 0) {
    bench::MeasureFullDisk(options, arguments.full_disks, arguments.seed);
  }
}

int Main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app(
      "The real daemon killed at random moments of its work, and its disk filled up; ends with 1 "
      "when anything is lost, damaged or left over");
  app.add_option("--crashes", arguments.crashes, "Times kill -9")->capture_default_str();
  app.add_option("--full-disks", arguments.full_disks,
                 "Times a full disk (needs root; 0 leaves it out)")
      ->capture_default_str();
  app.add_option("--cameras", arguments.cameras)->capture_default_str();
  app.add_option("--seed", arguments.seed)->capture_default_str();
  app.add_option("--max-ms", arguments.max_ms, "Longest life")->capture_default_str();
  app.add_option("--block", arguments.block, "Addresses of the cameras")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  const auto begin = std::chrono::steady_clock::now();
  try {
    Measure(arguments);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "daemon_crashes: %s\n", error.what());
    return 1;
  }
  const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - begin;
  std::printf("passed, seed %u, %.0f s\n", arguments.seed, spent.count());
  return 0;
}

}  // namespace
}  // namespace rotunda

int main(int argc, char** argv) { return rotunda::Main(argc, argv); }
