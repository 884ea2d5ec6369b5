#include "sfm/core/run_context.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <mutex>
#include <thread>
#include <vector>

namespace rotunda {
namespace {

/// Set while this thread runs a body of ParallelFor, so that nested calls stay serial.
thread_local bool inside_parallel_for = false;

struct Job {
  size_t count = 0;
  const std::function<void(size_t)>* body = nullptr;
  std::stop_token stop;
  std::atomic<size_t> next{0};

  void Work() {
    inside_parallel_for = true;
    for (size_t i = next.fetch_add(1); i < count; i = next.fetch_add(1)) {
      if (stop.stop_requested()) break;
      (*body)(i);
    }
    inside_parallel_for = false;
  }
};

}  // namespace

struct ThreadPool::Impl {
  std::mutex mutex;
  std::condition_variable job_posted;
  std::condition_variable job_left;
  Job* job = nullptr;
  uint64_t generation = 0;
  size_t busy = 0;
  bool quit = false;
  std::mutex one_caller;
  std::vector<std::thread> workers;

  void Run() {
    uint64_t seen = 0;
    std::unique_lock lock(mutex);
    while (true) {
      job_posted.wait(lock, [&] { return quit || (job != nullptr && generation != seen); });
      if (quit) return;
      seen = generation;
      Job* mine = job;
      ++busy;
      lock.unlock();
      mine->Work();
      lock.lock();
      if (--busy == 0) job_left.notify_all();
    }
  }
};

ThreadPool::ThreadPool(int threads) : impl_(std::make_unique<Impl>()) {
  if (threads <= 0) threads = std::max(1U, std::thread::hardware_concurrency());
  for (int i = 1; i < threads; ++i) impl_->workers.emplace_back([this] { impl_->Run(); });
}

ThreadPool::~ThreadPool() {
  {
    std::lock_guard lock(impl_->mutex);
    impl_->quit = true;
  }
  impl_->job_posted.notify_all();
  for (std::thread& worker : impl_->workers) worker.join();
}

int ThreadPool::size() const { return static_cast<int>(impl_->workers.size()) + 1; }

void ThreadPool::ParallelFor(size_t count, const std::function<void(size_t)>& body,
                             std::stop_token stop) {
  if (inside_parallel_for) {
    for (size_t i = 0; i < count && !stop.stop_requested(); ++i) body(i);
    return;
  }
  std::lock_guard caller(impl_->one_caller);
  Job job;
  job.count = count;
  job.body = &body;
  job.stop = std::move(stop);
  {
    std::lock_guard lock(impl_->mutex);
    impl_->job = &job;
    ++impl_->generation;
  }
  impl_->job_posted.notify_all();
  job.Work();
  std::unique_lock lock(impl_->mutex);
  impl_->job = nullptr;
  impl_->job_left.wait(lock, [&] { return impl_->busy == 0; });
}

uint64_t DeriveSeed(uint64_t seed, uint64_t index) {
  uint64_t z = seed + 0x9E3779B97F4A7C15ULL * (index + 1);
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
  return z ^ (z >> 31);
}

}  // namespace rotunda
