#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/store_jobs.h"
#include "sfm/core/run_context.h"

namespace rotunda::daemon {

/// What a job is given. The stop token is set when it is cancelled and when the daemon stops.
struct JobContext {
  std::stop_token stop;
  ProgressSink progress;  // may be called as often as one likes, from any thread
  /// From now on, until it has ended, the job is not cancelled: who asks for it is told why, as it
  /// was said last.
  std::function<void(const std::string& why)> refuse_cancel = [](const std::string&) {};
  /// For how long the daemon has been ending; nullopt: it goes on.
  std::function<std::optional<std::chrono::milliseconds>()> ending = [] { return std::nullopt; };
};

/// What jobs of one kind are.
struct JobHandler {
  /// The body as it is stored (keys in order, defaults filled in), or what is wrong with the
  /// request: kInvalidArgument names the field. Run by the caller of Submit().
  std::function<Result<std::string>(const std::string& body)> check;
  /// Whether new jobs can be taken now; not asked for one that was taken before. May be null.
  std::function<Status()> admit;
  /// Does the work; gives the result, a JSON object. A job that runs again comes with the
  /// `product` of the run before.
  std::function<Result<std::string>(const JobRecord& job, JobContext& context)> run;
  /// Whether what a checked body refers to is there: kNotFound. Not asked for a job that was taken
  /// before, which may have outlived what it was about. May be null.
  std::function<Status(const std::string& checked)> refers = nullptr;
};

struct JobHandlers {
  JobHandler capture;
  JobHandler calibration;
  JobHandler reconstruction;
};

/// Jobs and the two threads that do them: one captures, one computes, each one job at a time, in
/// the order in which they came. Jobs outlive the daemon: queued ones wait in the store.
class JobQueue {
 public:
  struct Options {
    /// Progress reaches store and events at most this often.
    std::chrono::milliseconds progress_interval{500};
    /// A running job that says nothing for so long hangs. The slowest step of computing between two
    /// signs of life is a bundle adjustment of 90 cameras, minutes on a slow machine.
    std::chrono::seconds capture_silence{120};
    std::chrono::seconds computing_silence{1200};
    /// A day of reconstructions. More are the work of a client gone wild.
    size_t max_queued = 1000;
    /// Told what Trouble() says, once until it is over. From the queue's threads. Null: nobody
    /// listens.
    std::function<void(const std::string& trouble)> tell = nullptr;
  };

  /// Starts the threads. `store` outlives the queue.
  JobQueue(Store& store, JobHandlers handlers, Options options);
  /// Stops: running jobs are told to, and become `interrupted`; queued ones stay queued.
  ~JobQueue();
  JobQueue(const JobQueue&) = delete;
  JobQueue& operator=(const JobQueue&) = delete;

  /// Queues a job. The same key with the same request gives the job of the first time; with another
  /// request kAlreadyExists. kFailed: too many wait.
  Result<JobRecord> Submit(JobKind kind, const std::string& body,
                           const std::string& idempotency_key);
  /// Tells the running jobs to stop and takes no others; returns at once. For an end that has more
  /// to wait for.
  void RequestStop();
  /// A running job ends within a second or two; see its state. kInvalidArgument: it has ended, or
  /// refuses (JobContext::refuse_cancel).
  Result<JobRecord> Cancel(int64_t number);
  /// Runs an interrupted, failed or cancelled job again. kFailed: too many wait.
  Result<JobRecord> Rerun(int64_t number);

  /// Which job hangs, in words; nullopt while all is well. For the watchdog.
  std::optional<std::string> Hung() const;
  /// Why jobs that run are not to be cancelled (JobContext::refuse_cancel), each in words.
  std::vector<std::string> CancelRefusals() const;
  /// Why the store gives no jobs, in words; nullopt while all is well. It is asked again all the
  /// while.
  std::optional<std::string> Trouble() const;

 private:
  class Worker;
  const JobHandler& HandlerOf(JobKind kind) const;
  void Wake();
  /// kFailed when as many jobs wait as may.
  Status CheckQueue() const;

  Store& store_;
  const JobHandlers handlers_;
  const Options options_;
  std::vector<std::unique_ptr<Worker>> workers_;
};

}  // namespace rotunda::daemon
