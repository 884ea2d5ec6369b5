// The real daemon with simulated cameras, which captures and reconstructs without a pause while
// many clients poll it and follow its events; then reconstructions, calibrations and captures with
// a camera missing are cancelled at random moments.
// Ends with 1 when the slowest hundredth of the reads takes 50 ms or more, a read fails, a frame is
// missed (also when a second pulse got it), an event stream misses something or a cancelled job
// takes more than two seconds to end.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <iterator>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "tests/bench/daemon_checks.h"
#include "tests/support/simulated_daemon.h"
#include "tests/support/unix_http.h"

namespace rotunda {
namespace {

using bench::Require;
using std::chrono::milliseconds;
using test::ReadAnswer;
using test::SimulatedDaemon;
using test::UnixConnection;
using Clock = std::chrono::steady_clock;
using Json = nlohmann::json;

struct Arguments {
  int cameras = 90;
  double scale = 0.35;
  int clients = 50;
  int streams = 20;
  int seconds = 120;
  int pause_ms = 100;  // of a client between two requests
  double limit_ms = 50;
  int cancels = 8;
  int cancel_within_s = 40;
  unsigned seed = 1;
  std::string block = "127.63.2";
};

// Nothing here takes nearly so long unless it hangs.
constexpr auto kPatience = milliseconds(600000);
constexpr auto kBetweenShots = milliseconds(1000);
// Shots and a reconstruction must really have been under way.
constexpr double kLeastReconstructing = 0.5;
constexpr int kLeastShots = 5;
constexpr double kCancelLimit_ms = 2000;
constexpr auto kCancelLook = milliseconds(10);
// With a camera missing, and another pulse for it.
constexpr auto kLongestCapture = milliseconds(8000);
constexpr size_t kTargetShots = 3;

constexpr const char* kTargets[] = {"/v1/status", "/v1/captures?limit=50", "/v1/jobs",
                                    "/v1/drift",  "/v1/cameras",           "/metrics"};

struct Reads {
  std::mutex mutex;
  std::map<std::string, std::vector<double>> milliseconds;  // by target
  std::atomic<int> failed = 0;
};

struct Stream {
  std::string text;
  bool ended_early = false;
};

/// Polls until `end`.
void Poll(const SimulatedDaemon& daemon, const Arguments& arguments, int client,
          const std::atomic<bool>& end, Reads& reads) {
  std::map<std::string, std::vector<double>> mine;
  try {
    UnixConnection connection(daemon.Socket());
    for (size_t i = static_cast<size_t>(client); !end; ++i) {
      const std::string target = kTargets[i % std::size(kTargets)];
      const auto begin = Clock::now();
      connection.Send("GET " + target + " HTTP/1.1\r\nHost: localhost\r\n\r\n");
      const bool answered = ReadAnswer(connection).status == 200;
      const std::chrono::duration<double, std::milli> spent = Clock::now() - begin;
      mine[target].push_back(spent.count());
      if (!answered) ++reads.failed;
      std::this_thread::sleep_for(milliseconds(arguments.pause_ms));
    }
  } catch (const std::exception&) {
    ++reads.failed;
  }
  const std::lock_guard lock(reads.mutex);
  for (auto& [target, times] : mine) {
    auto& all = reads.milliseconds[target];
    all.insert(all.end(), times.begin(), times.end());
  }
}

void Follow(const SimulatedDaemon& daemon, const std::atomic<bool>& end, Stream& stream) {
  try {
    UnixConnection connection(daemon.Socket());
    connection.Send("GET /v1/events?after=0 HTTP/1.1\r\nHost: localhost\r\n\r\n");
    while (!end && !connection.closed()) stream.text += connection.ReadUntil("\n\n");
    stream.ended_early = connection.closed();
  } catch (const std::exception&) {
    stream.ended_early = true;
  }
}

size_t Count(const std::string& text, const std::string& part) {
  size_t count = 0;
  for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

/// What was captured and reconstructed meanwhile.
struct Work {
  int shots = 0;
  int second_pulses = 0;
  std::vector<std::string> missed;  // "c03r1 in 2026...: late"
  int looks = 0, reconstructing = 0;
  int reconstructions = 0;
  // From the request to the end, by kind of job.
  std::map<std::string, std::vector<double>> cancelled_ms;
};

/// A shot, its frames, one after the other; a reconstruction is queued whenever none is.
void TakeShots(const SimulatedDaemon& daemon, Clock::time_point end, Work& work) {
  while (Clock::now() < end) {
    const Json status = daemon.Get("/v1/status");
    Require(status.is_object(), "no answer:\n" + daemon.Log());
    size_t computing = status["jobs"]["queued"].get<size_t>();
    for (const Json& job : status["jobs"]["running"]) computing += job["kind"] == "reconstruction";
    ++work.looks;
    work.reconstructing += computing > 0;
    const Json shot = daemon.Ended(
        daemon.Ask("POST", "/v1/captures", Json({{"reconstruct", computing == 0}}).dump()),
        kPatience);
    Require(shot["state"] == "done", shot.dump(1));
    ++work.shots;
    work.second_pulses += shot["result"]["pulses"].get<int>() > 1;
    const std::string id = shot["result"]["capture"];
    const Json capture = daemon.Get("/v1/captures/" + id);
    Require(capture.is_object() && !capture["frames"].empty(), "no frames of " + id);
    for (const Json& frame : capture["frames"]) {
      if (frame["status"] == "ok") continue;
      work.missed.push_back(frame["camera"].get<std::string>() + " in " + id + ": " +
                            frame["status"].get<std::string>());
    }
    std::this_thread::sleep_for(kBetweenShots);
  }
}

void CountReconstructions(const SimulatedDaemon& daemon, Work& work) {
  const auto jobs = daemon.All("/v1/jobs");
  Require(jobs.has_value(), "the jobs cannot be listed");
  for (const Json& job : *jobs) {
    if (job["kind"] != "reconstruction") continue;
    Require(job["state"] != "failed", job.dump(1));
    work.reconstructions += job["state"] == "done";
  }
}

/// Ends what is queued or runs, as the client of whoever asked for it would.
void CancelAll(const SimulatedDaemon& daemon) {
  const auto jobs = daemon.All("/v1/jobs");
  Require(jobs.has_value(), "the jobs cannot be listed");
  for (const Json& job : *jobs) {
    if (job["state"] != "queued" && job["state"] != "running") continue;
    daemon.Ask("DELETE", "/v1/jobs/" + job["id"].dump());
    daemon.Ended(job, kPatience);
  }
}

/// Asks for `body` at `target` again and again, and cancels each such job at a random moment, at
/// most `latest` after its begin.
void Cancel(const SimulatedDaemon& daemon, const Arguments& arguments, const std::string& target,
            const Json& body, milliseconds latest, std::vector<double>& cancelled_ms) {
  std::mt19937 random(arguments.seed);
  std::uniform_int_distribution<int64_t> moment_ms(0, latest.count());
  for (int i = 0; i < arguments.cancels; ++i) {
    const Json job = daemon.Ask("POST", target, body.dump());
    Require(job.is_object() && job.contains("id"), "no job: " + job.dump());
    const std::string of_job = "/v1/jobs/" + job["id"].dump();
    Require(test::WaitUntil(kPatience,
                            [&] { return daemon.Get(of_job).value("state", "") != "queued"; }),
            "it is not begun: " + job.dump());
    std::this_thread::sleep_for(milliseconds(moment_ms(random)));
    const bool was_running = daemon.Get(of_job).value("state", "") == "running";
    const auto begin = Clock::now();
    daemon.Ask("DELETE", of_job);
    while (daemon.Get(of_job).value("state", "") == "running") {
      std::this_thread::sleep_for(kCancelLook);
    }
    const std::chrono::duration<double, std::milli> spent = Clock::now() - begin;
    // Else it had come to its end before. A capture that keeps its shot is done.
    if (was_running) cancelled_ms.push_back(spent.count());
  }
}

/// A shot of what is served as `shot`, and nothing more; gives its id.
std::string TakeShot(const SimulatedDaemon& daemon, size_t shot) {
  daemon.SendToCameras({"shot", std::to_string(shot)});
  const Json job = daemon.Ended(
      daemon.Ask("POST", "/v1/captures", Json({{"reconstruct", false}}).dump()), kPatience);
  Require(job["state"] == "done" && job["result"]["complete"] == true, job.dump(1));
  return job["result"]["capture"];
}

/// The frame sets are those of the target, then that of the person.
void CancelCalibrations(const SimulatedDaemon& daemon, const Arguments& arguments, Work& work) {
  Json captures = Json::array();
  for (size_t shot = 0; shot < kTargetShots; ++shot) {
    captures.push_back(TakeShot(daemon, shot));
  }
  const Json body = {{"captures", captures}};
  const auto begin = Clock::now();
  const Json whole = daemon.Ended(daemon.Ask("POST", "/v1/calibrations", body.dump()), kPatience);
  Require(whole["state"] == "done", whole.dump(1));
  const auto spent = std::chrono::duration_cast<milliseconds>(Clock::now() - begin);
  Cancel(daemon, arguments, "/v1/calibrations", body, spent, work.cancelled_ms["calibration"]);
}

/// One camera does not send: its frame is waited for.
void CancelCaptures(const SimulatedDaemon& daemon, const Arguments& arguments, Work& work) {
  const std::string camera = daemon.Get("/v1/cameras")["items"][0]["camera"];
  daemon.SendToCameras({"fault", camera, "mute"});
  Cancel(daemon, arguments, "/v1/captures", Json({{"reconstruct", false}}), kLongestCapture,
         work.cancelled_ms["capture"]);
  daemon.SendToCameras({"clear"});
}

void CancelAtRandom(const SimulatedDaemon& daemon, const Arguments& arguments, Work& work) {
  CancelAll(daemon);
  if (arguments.cancels == 0) return;
  const std::string capture = daemon.Get("/v1/captures?limit=1")["items"][0]["id"];
  Cancel(daemon, arguments, "/v1/captures/" + capture + "/reconstructions", Json::object(),
         std::chrono::seconds(arguments.cancel_within_s), work.cancelled_ms["reconstruction"]);
  CancelCalibrations(daemon, arguments, work);
  CancelCaptures(daemon, arguments, work);
}

void PrintTimes(const std::string& what, const std::vector<double>& times) {
  std::printf("%-22s %7zu", what.c_str(), times.size());
  for (const double part : {0.5, 0.9, 0.99, 0.999, 1.0}) {
    std::printf(" %8.1f", bench::Quantile(times, part));
  }
  std::printf("\n");
}

/// Prints; gives what is not as it must be.
std::vector<std::string> Judge(const Arguments& arguments, const Reads& reads,
                               const std::vector<Stream>& streams, const Work& work) {
  std::vector<std::string> failures;
  const auto must = [&failures](bool fine, const std::string& what) {
    if (!fine) failures.push_back(what);
  };
  std::vector<double> all;
  std::printf("%-22s %7s %8s %8s %8s %8s %8s\n", "milliseconds", "reads", "median", "90 %", "99 %",
              "99.9 %", "largest");
  for (const auto& [target, times] : reads.milliseconds) {
    PrintTimes(target, times);
    all.insert(all.end(), times.begin(), times.end());
  }
  if (all.empty()) return {"nothing was read"};
  PrintTimes("all", all);
  std::printf("%d reads failed\n", reads.failed.load());
  std::printf(
      "%d shots of %d cameras (%d took a second pulse), %zu frames missed; %d reconstructions "
      "done, one was under way at %d of %d looks\n",
      work.shots, arguments.cameras, work.second_pulses, work.missed.size(), work.reconstructions,
      work.reconstructing, work.looks);
  for (const std::string& missed : work.missed) std::printf("  %s\n", missed.c_str());
  size_t bytes = 0, whole = 0;
  for (const Stream& stream : streams) {
    bytes += stream.text.size();
    whole += !stream.ended_early &&
             Count(stream.text, "event: capture_stored") == static_cast<size_t>(work.shots);
  }
  std::printf("%zu of %zu event streams told of every shot (%zu bytes)\n", whole, streams.size(),
              bytes);
  for (const auto& [kind, cancelled] : work.cancelled_ms) {
    const double slowest_ms =
        cancelled.empty() ? 0 : *std::max_element(cancelled.begin(), cancelled.end());
    std::printf("%zu %ss cancelled, the slowest ended after %.0f ms\n", cancelled.size(),
                kind.c_str(), slowest_ms);
    must(slowest_ms <= kCancelLimit_ms, "a " + kind + " that was cancelled took too long to end");
    must(!cancelled.empty(), "no " + kind + " was cancelled in time");
  }
  must(bench::Quantile(all, 0.99) < arguments.limit_ms,
       "the slowest hundredth of the reads is too slow");
  must(reads.failed == 0, "reads failed");
  must(work.missed.empty(), "frames were missed");
  must(work.second_pulses == 0, "a frame was missed at the first pulse");
  must(whole == streams.size(), "an event stream is not whole");
  must(work.shots >= kLeastShots, "too few shots to say anything");
  must(work.reconstructing >= kLeastReconstructing * work.looks,
       "no reconstruction ran for most of the time");
  return failures;
}

/// kTargetShots of the target, one of a person.
std::vector<std::filesystem::path> RenderScenes(const Arguments& arguments,
                                                const std::filesystem::path& folder) {
  std::vector<std::string> words = {"--cameras", std::to_string(arguments.cameras),
                                    "--scale",   std::to_string(arguments.scale),
                                    "--seed",    "1"};
  bench::Render(ROTUNDA_COMMAND, folder / "person", words);
  words.insert(words.end(), {"--target", "cuboid", "--placements", std::to_string(kTargetShots)});
  bench::Render(ROTUNDA_COMMAND, folder / "target", words);
  std::vector<std::filesystem::path> sets;
  for (size_t i = 0; i < kTargetShots; ++i) {
    sets.push_back(folder / "target" / ("placement_0" + std::to_string(i)));
  }
  sets.push_back(folder / "person");
  return sets;
}

std::vector<std::string> Measure(const Arguments& arguments) {
  const test::TemporaryFolder folder;
  SimulatedDaemon::Options options;
  options.command = ROTUNDA_COMMAND;
  options.daemon = ROTUNDA_DAEMON;
  options.board = std::string(ROTUNDA_SOURCE_DIR) + "/config/cuboid.toml";
  options.frame_sets = RenderScenes(arguments, folder.path());
  options.hold = true;
  options.block = arguments.block;
  options.more_config = "[storage]\nreserve_mb = 10\n[http]\nheartbeat_ms = 1000\n";
  const SimulatedDaemon daemon(options);
  const auto process = daemon.Start();
  Require(daemon.WaitForCameras(static_cast<size_t>(arguments.cameras), kPatience),
          "the cameras do not become ready:\n" + daemon.Log());
  daemon.SendToCameras({"shot", std::to_string(kTargetShots)});
  Reads reads;
  Work work;
  std::vector<Stream> streams(static_cast<size_t>(arguments.streams));
  std::atomic<bool> end = false;
  {
    std::vector<std::jthread> threads;
    for (int i = 0; i < arguments.clients; ++i) {
      threads.emplace_back([&, i] { Poll(daemon, arguments, i, end, reads); });
    }
    for (Stream& stream : streams) {
      threads.emplace_back([&] { Follow(daemon, end, stream); });
    }
    try {
      TakeShots(daemon, Clock::now() + std::chrono::seconds(arguments.seconds), work);
    } catch (...) {
      end = true;
      throw;
    }
    end = true;
  }
  CountReconstructions(daemon, work);
  CancelAtRandom(daemon, arguments, work);
  process->Signal(SIGTERM);
  Require(process->Wait() == 0, "the daemon did not stop well:\n" + daemon.Log());
  return Judge(arguments, reads, streams, work);
}

int Main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app(
      "Clients that poll and follow events while the daemon captures and reconstructs; ends with 1 "
      "when reads are slow or fail, or a frame is missed by the first pulse");
  app.add_option("--cameras", arguments.cameras, "Simulated cameras")->capture_default_str();
  app.add_option("--scale", arguments.scale, "Size of their pictures, 1: 1200x1600")
      ->capture_default_str();
  app.add_option("--clients", arguments.clients, "That poll")->capture_default_str();
  app.add_option("--streams", arguments.streams, "That follow events")->capture_default_str();
  app.add_option("--seconds", arguments.seconds, "How long")->capture_default_str();
  app.add_option("--pause", arguments.pause_ms, "Of each client between requests, milliseconds")
      ->capture_default_str();
  app.add_option("--limit", arguments.limit_ms, "Of 99 % of the reads, milliseconds")
      ->capture_default_str();
  app.add_option("--cancels", arguments.cancels, "Jobs of each kind to cancel after that")
      ->capture_default_str();
  app.add_option("--cancel-within", arguments.cancel_within_s,
                 "Latest moment of a reconstruction's, seconds after its begin")
      ->capture_default_str();
  app.add_option("--seed", arguments.seed, "Of these moments")->capture_default_str();
  app.add_option("--block", arguments.block, "Addresses of the cameras")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  std::vector<std::string> failures;
  try {
    failures = Measure(arguments);
  } catch (const std::exception& error) {
    failures = {error.what()};
  }
  for (const std::string& failure : failures) {
    std::fprintf(stderr, "daemon_load: %s\n", failure.c_str());
  }
  if (failures.empty()) std::printf("passed\n");
  return failures.empty() ? 0 : 1;
}

}  // namespace
}  // namespace rotunda

int main(int argc, char** argv) { return rotunda::Main(argc, argv); }
