#include "daemon/jobs.h"

#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>
#include <utility>

namespace rotunda::daemon {
namespace {

using Clock = std::chrono::steady_clock;

// Jobs of this process wake the worker at once; this is for a store that could not be read.
constexpr auto kLookAgain = std::chrono::seconds(2);

/// The request as its job has it, when `known` is that of the same one: a body that was stored by
/// an earlier version lacks the fields that have come since.
std::string BodyFor(const std::optional<JobRecord>& known, const JobHandler& handler,
                    const std::string& checked) {
  if (!known) return checked;
  const Result<std::string> as_of_now = handler.check(known->body);
  return as_of_now && *as_of_now == checked ? known->body : checked;
}

}  // namespace

/// One thread and the job it does.
class JobQueue::Worker {
 public:
  Worker(JobQueue& queue, std::vector<JobKind> kinds, std::chrono::seconds silence)
      : queue_(queue), kinds_(std::move(kinds)), silence_(silence) {}

  void Start() {
    thread_ = std::thread([this] { Run(); });
  }
  void RequestStop() {
    {
      const std::lock_guard lock(mutex_);
      if (!quit_) quit_ = Clock::now();
      stop_.request_stop();
    }
    wake_.notify_all();
  }
  void Join() { thread_.join(); }

  void Wake() {
    {
      const std::lock_guard lock(mutex_);
      look_ = true;
    }
    wake_.notify_all();
  }

  /// Stops the job when it is the one that runs.
  void Cancel(int64_t number) {
    const std::lock_guard lock(mutex_);
    if (number == running_) stop_.request_stop();
  }

  /// A job that is not to be cancelled, and why.
  struct Refusal {
    int64_t number = 0;
    std::string why;
  };
  /// nullopt: none runs, or the one that does may be cancelled.
  std::optional<Refusal> CancelRefusal() const {
    const std::lock_guard lock(mutex_);
    if (running_ == 0 || !cancel_refusal_) return std::nullopt;
    return Refusal{running_, *cancel_refusal_};
  }

  std::optional<std::string> Hung() const {
    const std::lock_guard lock(mutex_);
    const auto silent = Clock::now() - last_sign_;
    if (running_ == 0 || silent < silence_) return std::nullopt;
    return "job " + std::to_string(running_) + " has given no sign of life for " +
           std::to_string(std::chrono::duration_cast<std::chrono::seconds>(silent).count()) + " s";
  }

  std::optional<std::string> Trouble() const {
    const std::lock_guard lock(mutex_);
    return trouble_;
  }

 private:
  void Run();
  /// What came of taking a job from the store.
  void NoteTaking(const std::optional<Error>& error);
  void Do(JobRecord job);
  /// For the job that begins now.
  JobContext Context(const JobRecord& job);
  Result<std::string> Work(const JobRecord& job, JobContext& context);
  void Progress(JobRecord& job, std::string_view stage, size_t done, size_t total);
  /// What has become of the job, whose handler has ended and refuses nothing any more.
  void Judge(const Result<std::string>& outcome, JobRecord& job);
  void StoreEnd(const JobRecord& job);

  JobQueue& queue_;
  const std::vector<JobKind> kinds_;
  const std::chrono::seconds silence_;
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  bool look_ = true;
  std::optional<Clock::time_point> quit_;      // since when the daemon ends
  int64_t running_ = 0;                        // 0: none
  std::stop_source stop_;                      // of the running job
  std::optional<std::string> cancel_refusal_;  // likewise
  Clock::time_point last_sign_ = Clock::now();
  std::optional<std::string> trouble_;
  std::optional<Clock::time_point> last_told_;  // by the running job
  std::mutex telling_;  // progress comes from many threads, and goes to the store one by one
  std::thread thread_;
};

void JobQueue::Worker::Run() {
  std::unique_lock lock(mutex_);
  while (!quit_) {
    look_ = false;
    lock.unlock();
    Result<std::optional<JobRecord>> job = TakeJob(queue_.store_, kinds_);
    NoteTaking(job ? std::nullopt : std::optional(job.error()));
    if (job && *job) {
      Do(std::move(**job));
      queue_.Wake();  // there may be another one, or one that this one queued
    }
    lock.lock();
    wake_.wait_for(lock, kLookAgain, [&] { return quit_ || look_; });
  }
}

void JobQueue::Worker::NoteTaking(const std::optional<Error>& error) {
  std::optional<std::string> trouble;
  if (error) {
    trouble = std::string("jobs are not begun (") + JobKindName(kinds_.front()) +
              "): " + error->ToString();
  }
  bool is_news = false;
  {
    const std::lock_guard lock(mutex_);
    is_news = trouble && !trouble_;
    trouble_ = trouble;
  }
  if (is_news && queue_.options_.tell) queue_.options_.tell(*trouble);
}

JobContext JobQueue::Worker::Context(const JobRecord& job) {
  JobContext context;
  context.progress = [this, told = job](std::string_view stage, size_t done, size_t total) mutable {
    Progress(told, stage, done, total);
  };
  context.refuse_cancel = [this](const std::string& why) {
    const std::lock_guard lock(mutex_);
    cancel_refusal_ = why;
  };
  context.ending = [this]() -> std::optional<std::chrono::milliseconds> {
    const std::lock_guard lock(mutex_);
    if (!quit_) return std::nullopt;
    return std::chrono::duration_cast<std::chrono::milliseconds>(Clock::now() - *quit_);
  };
  const std::lock_guard lock(mutex_);
  running_ = job.number;
  last_sign_ = Clock::now();
  cancel_refusal_.reset();
  if (!quit_) stop_ = std::stop_source();
  context.stop = stop_.get_token();
  return context;
}

void JobQueue::Worker::Do(JobRecord job) {
  last_told_.reset();
  JobContext context = Context(job);
  // A cancel that came between taking the job and now did not find it running.
  const Result<JobRecord> current = FindJob(queue_.store_, job.number);
  if (current && current->cancel_requested) Cancel(job.number);
  Judge(Work(job, context), job);
  StoreEnd(job);
  const std::lock_guard lock(mutex_);
  running_ = 0;
}

Result<std::string> JobQueue::Worker::Work(const JobRecord& job, JobContext& context) {
  if (context.stop.stop_requested()) return Error{ErrorCode::kCancelled, "was cancelled", ""};
  try {
    return queue_.HandlerOf(job.kind).run(job, context);
  } catch (const std::exception& unexpected) {  // a bug, or no memory left: not the others' end
    return Error{ErrorCode::kFailed, unexpected.what(), "unexpected failure"};
  }
}

void JobQueue::Worker::Progress(JobRecord& job, std::string_view stage, size_t done, size_t total) {
  const auto now = Clock::now();
  {
    const std::lock_guard lock(mutex_);
    last_sign_ = now;
  }
  // Whoever finds the store busy with an earlier report has nothing to add.
  const std::unique_lock lock(telling_, std::try_to_lock);
  if (!lock || (last_told_ && now - *last_told_ < queue_.options_.progress_interval)) return;
  last_told_ = now;
  job.stage = stage;
  job.done = done;
  job.total = total;
  // Progress that cannot be stored (disk full) is no reason to end the work.
  static_cast<void>(SetJobProgress(queue_.store_, job));
}

void JobQueue::Worker::Judge(const Result<std::string>& outcome, JobRecord& job) {
  const std::lock_guard lock(mutex_);
  cancel_refusal_.reset();
  if (outcome) {
    job.state = JobState::kDone;
    job.result = *outcome;
  } else if (!stop_.stop_requested()) {
    job.state = JobState::kFailed;
    job.error = outcome.error().ToString();
  } else if (quit_) {
    job.state = JobState::kInterrupted;
    job.error = "the daemon was stopped while it ran";
    if (outcome.error().code != ErrorCode::kCancelled) {
      job.error += ": " + outcome.error().ToString();
    }
  } else {
    job.state = JobState::kCancelled;
  }
}

/// A full disk must not leave a finished job "running": tried until it is stored or the daemon
/// stops, which has room set aside for it (without it the next start calls the job interrupted). A
/// row that is gone or broken stays so.
void JobQueue::Worker::StoreEnd(const JobRecord& job) {
  const auto refused = [&] {
    const Status ended = EndJob(queue_.store_, job);
    return !ended && ended.error().code == ErrorCode::kIo;
  };
  while (refused()) {
    std::unique_lock lock(mutex_);
    last_sign_ = Clock::now();
    if (quit_) {
      queue_.store_.FreeSpareRoom();
      static_cast<void>(refused());
      return;
    }
    wake_.wait_for(lock, kLookAgain, [&] { return quit_.has_value(); });
  }
}

JobQueue::JobQueue(Store& store, JobHandlers handlers, Options options)
    : store_(store), handlers_(std::move(handlers)), options_(std::move(options)) {
  workers_.push_back(
      std::make_unique<Worker>(*this, std::vector{JobKind::kCapture}, options_.capture_silence));
  workers_.push_back(
      std::make_unique<Worker>(*this, std::vector{JobKind::kCalibration, JobKind::kReconstruction},
                               options_.computing_silence));
  // They wake each other, so that none starts before all are there or goes before all have ended.
  for (const auto& worker : workers_) worker->Start();
}

JobQueue::~JobQueue() {
  RequestStop();
  for (const auto& worker : workers_) worker->Join();
}

void JobQueue::RequestStop() {
  for (const auto& worker : workers_) worker->RequestStop();
}

const JobHandler& JobQueue::HandlerOf(JobKind kind) const {
  switch (kind) {
    case JobKind::kCapture:
      return handlers_.capture;
    case JobKind::kCalibration:
      return handlers_.calibration;
    case JobKind::kReconstruction:
      break;
  }
  return handlers_.reconstruction;
}

Result<JobRecord> JobQueue::Submit(JobKind kind, const std::string& body,
                                   const std::string& idempotency_key) {
  const JobHandler& handler = HandlerOf(kind);
  ROTUNDA_ASSIGN_OR_RETURN(const std::string checked, handler.check(body));
  std::optional<JobRecord> known;
  if (!idempotency_key.empty()) {
    ROTUNDA_ASSIGN_OR_RETURN(known, FindJobByKey(store_, idempotency_key));
  }
  if (!known) ROTUNDA_RETURN_IF_ERROR(CheckQueue());
  if (!known && handler.refers) ROTUNDA_RETURN_IF_ERROR(handler.refers(checked));
  if (!known && handler.admit) ROTUNDA_RETURN_IF_ERROR(handler.admit());
  ROTUNDA_ASSIGN_OR_RETURN(
      JobRecord job, AddJob(store_, {kind, BodyFor(known, handler, checked), idempotency_key}));
  Wake();
  return job;
}

Status JobQueue::CheckQueue() const {
  ROTUNDA_ASSIGN_OR_RETURN(const size_t queued, CountJobs(store_, JobState::kQueued));
  if (queued < options_.max_queued) return {};
  return Error{ErrorCode::kFailed,
               std::to_string(queued) + " jobs wait, which is all that may: wait, or cancel some",
               ""};
}

Result<JobRecord> JobQueue::Cancel(int64_t number) {
  for (const auto& worker : workers_) {
    const auto refusal = worker->CancelRefusal();
    if (!refusal || refusal->number != number) continue;
    return Error{ErrorCode::kInvalidArgument, refusal->why, "job " + std::to_string(number)};
  }
  ROTUNDA_ASSIGN_OR_RETURN(JobRecord job, RequestCancel(store_, number));
  for (const auto& worker : workers_) worker->Cancel(number);
  return job;
}

Result<JobRecord> JobQueue::Rerun(int64_t number) {
  // One that cannot be run again says so also while the queue is full.
  ROTUNDA_ASSIGN_OR_RETURN(const JobRecord found, FindJob(store_, number));
  if (CanRunAgain(found.state)) ROTUNDA_RETURN_IF_ERROR(CheckQueue());
  ROTUNDA_ASSIGN_OR_RETURN(JobRecord job, RequeueJob(store_, number));
  Wake();
  return job;
}

void JobQueue::Wake() {
  for (const auto& worker : workers_) worker->Wake();
}

std::optional<std::string> JobQueue::Hung() const {
  for (const auto& worker : workers_) {
    if (auto hung = worker->Hung()) return hung;
  }
  return std::nullopt;
}

std::vector<std::string> JobQueue::CancelRefusals() const {
  std::vector<std::string> refusals;
  for (const auto& worker : workers_) {
    if (const auto refusal = worker->CancelRefusal()) refusals.push_back(refusal->why);
  }
  return refusals;
}

std::optional<std::string> JobQueue::Trouble() const {
  for (const auto& worker : workers_) {
    if (auto trouble = worker->Trouble()) return trouble;
  }
  return std::nullopt;
}

}  // namespace rotunda::daemon
