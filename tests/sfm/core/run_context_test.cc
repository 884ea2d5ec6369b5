#include "sfm/core/run_context.h"

#include <gtest/gtest.h>

#include <atomic>
#include <set>
#include <thread>
#include <vector>

namespace rotunda {
namespace {

TEST(ThreadPool, RunsEveryIndexExactlyOnce) {
  for (const int threads : {1, 2, 7}) {
    ThreadPool pool(threads);
    EXPECT_EQ(pool.size(), threads);
    for (const size_t count : {0, 1, 2, 1000}) {
      std::vector<std::atomic<int>> calls(count);
      pool.ParallelFor(count, [&](size_t i) { ++calls[i]; });
      for (size_t i = 0; i < count; ++i)
        EXPECT_EQ(calls[i], 1) << threads << " threads, item " << i;
    }
  }
}

TEST(ThreadPool, UsesItsThreads) {
  ThreadPool pool(3);
  std::atomic<int> inside = 0;
  // Each body waits until all three are inside: this ends only when they run side by side.
  pool.ParallelFor(3, [&](size_t) {
    ++inside;
    while (inside < 3) std::this_thread::yield();
  });
  EXPECT_EQ(inside, 3);
}

TEST(ThreadPool, NestedCallsRunOnTheSameThread) {
  ThreadPool pool(4);
  std::vector<std::atomic<int>> calls(8 * 50);
  std::atomic<int> on_another_thread = 0;
  pool.ParallelFor(8, [&](size_t outer) {
    const auto thread = std::this_thread::get_id();
    pool.ParallelFor(50, [&](size_t inner) {
      ++calls[50 * outer + inner];
      if (std::this_thread::get_id() != thread) ++on_another_thread;
    });
  });
  for (const auto& count : calls) EXPECT_EQ(count, 1);
  EXPECT_EQ(on_another_thread, 0);
}

TEST(ThreadPool, ManySmallJobsInARow) {
  ThreadPool pool(4);
  size_t total = 0;
  for (int job = 0; job < 2000; ++job) {
    std::vector<size_t> slots(5, 0);
    pool.ParallelFor(slots.size(), [&](size_t i) { slots[i] = i + 1; });
    for (const size_t slot : slots) total += slot;
  }
  EXPECT_EQ(total, 2000u * 15u);
}

TEST(ThreadPool, CallersTakeTurns) {
  ThreadPool pool(3);
  std::atomic<size_t> calls = 0;
  std::vector<std::thread> callers;
  for (int i = 0; i < 4; ++i) {
    callers.emplace_back([&] {
      for (int job = 0; job < 100; ++job) pool.ParallelFor(7, [&](size_t) { ++calls; });
    });
  }
  for (std::thread& caller : callers) caller.join();
  EXPECT_EQ(calls, 4u * 100u * 7u);
}

TEST(ThreadPool, LeavesOutWhatHasNotBegunOnceStopped) {
  for (const int threads : {1, 4}) {
    ThreadPool pool(threads);
    std::stop_source stop;
    std::atomic<size_t> calls = 0;
    // Who comes after the tenth call waits for the stop, so that only those who had begun before it
    // are counted.
    const auto body = [&](size_t) {
      const size_t call = ++calls;
      if (call == 10) stop.request_stop();
      while (call > 10 && !stop.stop_requested()) std::this_thread::yield();
    };
    pool.ParallelFor(100000, body, stop.get_token());
    EXPECT_GE(calls, 10u);
    EXPECT_LT(calls, 10u + static_cast<size_t>(threads));
    pool.ParallelFor(
        5, [&](size_t) { ++calls; }, stop.get_token());
    EXPECT_LT(calls, 10u + static_cast<size_t>(threads)) << "nothing begins after the stop";
  }
}

TEST(RunContext, ReportsToTheSinkWhenThereIsOne) {
  ThreadPool pool(1);
  std::vector<std::string> told;
  RunContext context{pool};
  context.Report("features", 1, 3);
  context.progress = [&](std::string_view stage, size_t done, size_t total) {
    told.push_back(std::string(stage) + " " + std::to_string(done) + "/" + std::to_string(total));
  };
  context.Report("features", 2, 3);
  EXPECT_EQ(told, std::vector<std::string>{"features 2/3"});
  EXPECT_FALSE(context.Stopped());
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  EXPECT_TRUE(context.Stopped());
}

TEST(DeriveSeed, IsSplitMix64) {
  // First outputs of Vigna's splitmix64.c seeded with 0 and 1234567.
  EXPECT_EQ(DeriveSeed(0, 0), 0xE220A8397B1DCDAFULL);
  EXPECT_EQ(DeriveSeed(0, 1), 0x6E789E6AA1B965F4ULL);
  EXPECT_EQ(DeriveSeed(1234567, 0), 6457827717110365317ULL);
  EXPECT_EQ(DeriveSeed(1234567, 1), 3203168211198807973ULL);
}

TEST(DeriveSeed, DiffersForNeighbours) {
  std::set<uint64_t> seeds;
  for (uint64_t seed = 0; seed < 30; ++seed) {
    for (uint64_t index = 0; index < 30; ++index) seeds.insert(DeriveSeed(seed * 1000003, index));
  }
  EXPECT_EQ(seeds.size(), 900u);
}

}  // namespace
}  // namespace rotunda
