#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <stop_token>
#include <string_view>

namespace rotunda {

/// A fixed number of workers. ParallelFor is the only way work is shared out: item i writes only
/// to place i of a result, so the outcome does not depend on the number of threads.
class ThreadPool {
 public:
  /// `threads` >= 1; 0 means the machine's cores.
  explicit ThreadPool(int threads = 0);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  int size() const;

  /// Calls body(i) for every i in [0, count), in no particular order, and returns when all are
  /// done. The caller's thread works too. A call from inside a body runs serially. Items not yet
  /// begun are left out once `stop` is set. `body` must not throw.
  void ParallelFor(size_t count, const std::function<void(size_t)>& body,
                   std::stop_token stop = {});

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Told how far a stage has come: `done` of `total` items of `stage`. Called from any thread.
using ProgressSink = std::function<void(std::string_view stage, size_t done, size_t total)>;

/// What every stage is given besides its input and options. Stages never print and never read
/// clocks or global random state.
struct RunContext {
  ThreadPool& threads;
  std::stop_token stop = {};
  ProgressSink progress = nullptr;
  uint64_t seed = 0;

  void Report(std::string_view stage, size_t done, size_t total) const {
    if (progress) progress(stage, done, total);
  }
  bool Stopped() const { return stop.stop_requested(); }
};

/// SplitMix64 of `seed` and `index`: an independent seed for item `index`.
uint64_t DeriveSeed(uint64_t seed, uint64_t index);

}  // namespace rotunda
