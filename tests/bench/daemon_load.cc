// How fast a daemon that runs answers while many ask: clients that poll, clients that follow the
// events. Start it, let it capture and reconstruct, and look at the slowest reads.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/unix_http.h"

namespace {

using Clock = std::chrono::steady_clock;
using rotunda::test::ReadAnswer;
using rotunda::test::UnixConnection;

struct Arguments {
  std::string socket = "/run/rotunda/api.sock";
  int clients = 50;
  int streams = 20;
  int seconds = 30;
  int pause_ms = 100;  // of a client between two requests
};

struct Totals {
  std::mutex mutex;
  std::vector<double> milliseconds;
  std::atomic<int> failed = 0;
  std::atomic<size_t> stream_bytes = 0;
};

constexpr const char* kTargets[] = {"/v1/status", "/v1/captures?limit=50", "/v1/jobs",
                                    "/v1/drift",  "/v1/cameras",           "/metrics"};

void Poll(const Arguments& arguments, int client, Clock::time_point end, Totals& totals) {
  std::vector<double> milliseconds;
  UnixConnection connection(arguments.socket);
  for (size_t i = static_cast<size_t>(client); Clock::now() < end; ++i) {
    const std::string target = kTargets[i % std::size(kTargets)];
    const auto begin = Clock::now();
    connection.Send("GET " + target + " HTTP/1.1\r\nHost: localhost\r\n\r\n");
    if (ReadAnswer(connection).status != 200) ++totals.failed;
    milliseconds.push_back(std::chrono::duration<double, std::milli>(Clock::now() - begin).count());
    std::this_thread::sleep_for(std::chrono::milliseconds(arguments.pause_ms));
  }
  const std::lock_guard lock(totals.mutex);
  totals.milliseconds.insert(totals.milliseconds.end(), milliseconds.begin(), milliseconds.end());
}

void Follow(const Arguments& arguments, Clock::time_point end, Totals& totals) {
  UnixConnection connection(arguments.socket);
  connection.Send("GET /v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n");
  while (Clock::now() < end && !connection.closed()) {
    totals.stream_bytes += connection.ReadUntil("\n\n").size();
  }
  if (connection.closed()) ++totals.failed;
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app("Load on a running daemon: the distribution of the times of its reads");
  app.add_option("--socket", arguments.socket, "Where it serves")->capture_default_str();
  app.add_option("--clients", arguments.clients, "That poll")->capture_default_str();
  app.add_option("--streams", arguments.streams, "That follow events")->capture_default_str();
  app.add_option("--seconds", arguments.seconds, "How long")->capture_default_str();
  app.add_option("--pause", arguments.pause_ms, "Of each client between requests, milliseconds")
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);

  Totals totals;
  const auto end = Clock::now() + std::chrono::seconds(arguments.seconds);
  {
    std::vector<std::jthread> threads;
    for (int i = 0; i < arguments.clients; ++i) {
      threads.emplace_back([&, i] { Poll(arguments, i, end, totals); });
    }
    for (int i = 0; i < arguments.streams; ++i) {
      threads.emplace_back([&] { Follow(arguments, end, totals); });
    }
  }
  std::vector<double>& times = totals.milliseconds;
  if (times.empty()) return 1;
  std::sort(times.begin(), times.end());
  const auto at = [&times](double part) {
    return times[static_cast<size_t>(part * static_cast<double>(times.size() - 1))];
  };
  std::printf(
      "%zu reads, %d failed; median %.1f ms, 95 %% %.1f ms, 99 %% %.1f ms, largest %.1f ms\n",
      times.size(), totals.failed.load(), at(0.5), at(0.95), at(0.99), times.back());
  std::printf("%d event streams brought %zu bytes\n", arguments.streams,
              totals.stream_bytes.load());
  return totals.failed == 0 ? 0 : 1;
}
