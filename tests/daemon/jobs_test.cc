#include "daemon/jobs.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

#include "daemon/store_captures.h"
#include "daemon/store_events.h"
#include "daemon/store_sql.h"
#include "tests/support/daemon_state.h"

namespace rotunda::daemon {
namespace {

using namespace std::chrono_literals;
using test::DaemonState;

/// A job that runs until it is let go or stopped.
class Gate {
 public:
  void Open() {
    const std::lock_guard lock(mutex_);
    open_ = true;
    changed_.notify_all();
  }
  Result<std::string> Pass(JobContext& context) {
    std::unique_lock lock(mutex_);
    ++entered_;
    changed_.notify_all();
    const std::stop_callback wake(context.stop, [this] { changed_.notify_all(); });
    while (!open_ && !context.stop.stop_requested()) changed_.wait_for(lock, 10ms);
    if (!open_) return Error{ErrorCode::kCancelled, "interrupted", ""};
    return std::string("{}");
  }
  void WaitUntilEntered(int times) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return entered_ >= times; });
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool open_ = false;
  int entered_ = 0;
};

Result<std::string> AsItIs(const std::string& body) {
  if (body == "bad") return Error{ErrorCode::kInvalidArgument, "is bad", "request"};
  return body;
}

JobHandler Handler(std::function<Result<std::string>(const JobRecord&, JobContext&)> run) {
  return {AsItIs, nullptr, std::move(run)};
}

Result<std::string> Nothing(const JobRecord&, JobContext&) { return std::string("{}"); }

JobHandlers CapturesDo(std::function<Result<std::string>(const JobRecord&, JobContext&)> run) {
  return {Handler(std::move(run)), Handler(Nothing), Handler(Nothing)};
}

/// The job when it is in none of the states.
JobRecord WaitWhile(Store& store, int64_t number, std::initializer_list<JobState> states) {
  while (true) {
    JobRecord job = FindJob(store, number).value();
    if (std::find(states.begin(), states.end(), job.state) == states.end()) return job;
    std::this_thread::sleep_for(2ms);
  }
}

JobRecord WaitForEnd(Store& store, int64_t number) {
  return WaitWhile(store, number, {JobState::kQueued, JobState::kRunning});
}

TEST(Jobs, RunAndTellOfIt) {
  DaemonState state;
  std::mutex mutex;
  std::vector<std::string> heard;
  const auto subscription = state.hub().Subscribe([&](const EventRecord& event) {
    const std::lock_guard lock(mutex);
    heard.push_back(event.kind + " " + event.about);
  });
  int64_t number = 0;
  {
    JobQueue queue(state.store(), CapturesDo([](const JobRecord& job, JobContext&) {
                     return Result<std::string>("{\"had\":" + job.body + "}");
                   }),
                   {});
    const auto job = queue.Submit(JobKind::kCapture, "{\"a\":1}", "");
    ASSERT_TRUE(job.ok());
    number = job->number;
    EXPECT_EQ(queue.Submit(JobKind::kCapture, "bad", "").error().code, ErrorCode::kInvalidArgument);
    const JobRecord end = WaitForEnd(state.store(), number);
    EXPECT_EQ(end.state, JobState::kDone);
    EXPECT_EQ(end.result, "{\"had\":{\"a\":1}}");
    EXPECT_TRUE(end.started_at && end.ended_at && *end.started_at < *end.ended_at);
  }
  const std::string n = std::to_string(number);
  EXPECT_EQ(heard,
            (std::vector<std::string>{"job_queued " + n, "job_started " + n, "job_done " + n}));
  EXPECT_EQ(ListJobs(state.store(), {})->items.size(), 1u);
}

TEST(Jobs, FailWithTheirReasonAlsoWhenTheyThrow) {
  DaemonState state;
  JobQueue queue(state.store(),
                 {Handler([](const JobRecord&, JobContext&) -> Result<std::string> {
                    return Error{ErrorCode::kFailed, "no camera is ready", "capture"};
                  }),
                  Handler([](const JobRecord&, JobContext&) -> Result<std::string> {
                    throw std::runtime_error("a bug");
                  }),
                  Handler(Nothing)},
                 {});
  const auto failing = queue.Submit(JobKind::kCapture, "{}", "");
  const auto throwing = queue.Submit(JobKind::kCalibration, "{}", "");
  const JobRecord failed = WaitForEnd(state.store(), failing->number);
  EXPECT_EQ(failed.state, JobState::kFailed);
  EXPECT_EQ(failed.error, "capture: no camera is ready");
  const JobRecord thrown = WaitForEnd(state.store(), throwing->number);
  EXPECT_EQ(thrown.state, JobState::kFailed);
  EXPECT_NE(thrown.error.find("a bug"), std::string::npos);
}

TEST(Jobs, TheSameKeyDoesItOnce) {
  DaemonState state;
  std::atomic<int> runs = 0;
  JobQueue queue(state.store(), CapturesDo([&](const JobRecord&, JobContext&) {
                   ++runs;
                   return Result<std::string>("{}");
                 }),
                 {});
  std::vector<std::thread> clients;
  std::vector<int64_t> numbers(16);
  for (size_t i = 0; i < numbers.size(); ++i) {
    clients.emplace_back([&, i] {
      numbers[i] = queue.Submit(JobKind::kCapture, "{\"subject\":\"x\"}", "key").value().number;
    });
  }
  for (std::thread& client : clients) client.join();
  for (const int64_t number : numbers) EXPECT_EQ(number, numbers[0]);
  WaitForEnd(state.store(), numbers[0]);
  EXPECT_EQ(queue.Submit(JobKind::kCapture, "{\"subject\":\"x\"}", "key")->state, JobState::kDone);
  EXPECT_EQ(runs, 1);

  const auto other = queue.Submit(JobKind::kCapture, "{\"subject\":\"y\"}", "key");
  ASSERT_FALSE(other.ok());
  EXPECT_EQ(other.error().code, ErrorCode::kAlreadyExists);
  EXPECT_FALSE(queue.Submit(JobKind::kCalibration, "{\"subject\":\"x\"}", "key").ok());
  EXPECT_EQ(ListJobs(state.store(), {})->items.size(), 1u);
}

/// The stored body is of a version that knew fewer fields.
TEST(Jobs, TheSameKeyIsThatOfTheSameRequestAlsoAfterAnUpgrade) {
  DaemonState state;
  const auto before = AddJob(state.store(), {JobKind::kCapture, "{\"a\":1}", "key"});
  ASSERT_TRUE(before.ok());
  JobHandlers handlers = CapturesDo(Nothing);
  handlers.capture.check = [](const std::string& body) -> Result<std::string> {
    if (body.find("\"b\"") != std::string::npos) return body;
    return body.substr(0, body.size() - 1) + ",\"b\":0}";
  };
  JobQueue queue(state.store(), handlers, {});
  for (const char* same : {"{\"a\":1}", "{\"a\":1,\"b\":0}"}) {
    const auto again = queue.Submit(JobKind::kCapture, same, "key");
    ASSERT_TRUE(again.ok()) << again.error().ToString();
    EXPECT_EQ(again->number, before->number);
  }
  for (const char* other : {"{\"a\":2}", "{\"a\":1,\"b\":1}"}) {
    const auto refused = queue.Submit(JobKind::kCapture, other, "key");
    ASSERT_FALSE(refused.ok()) << other;
    EXPECT_EQ(refused.error().code, ErrorCode::kAlreadyExists);
  }
}

TEST(Jobs, ThatCannotBeTakenAreRefusedUnlessTheyWereTakenBefore) {
  DaemonState state;
  std::atomic<bool> full = false;
  JobHandlers handlers = CapturesDo(Nothing);
  handlers.capture.admit = [&]() -> Status {
    if (!full) return {};
    return Error{ErrorCode::kIo, "no room", ""};
  };
  JobQueue queue(state.store(), handlers, {});
  const auto taken = queue.Submit(JobKind::kCapture, "{}", "first");
  ASSERT_TRUE(taken.ok());
  full = true;
  EXPECT_EQ(queue.Submit(JobKind::kCapture, "{}", "second").error().code, ErrorCode::kIo);
  EXPECT_EQ(queue.Submit(JobKind::kCapture, "{}", "first")->number, taken->number);
}

TEST(Jobs, ARepeatGivesItsJobAlsoWhenWhatItWasAboutIsGone) {
  DaemonState state;
  std::atomic<bool> gone = false;
  JobHandlers handlers = CapturesDo(Nothing);
  handlers.capture.refers = [&](const std::string&) -> Status {
    if (!gone) return {};
    return Error{ErrorCode::kNotFound, "there is no such capture", ""};
  };
  JobQueue queue(state.store(), handlers, {});
  const auto taken = queue.Submit(JobKind::kCapture, "{}", "first");
  ASSERT_TRUE(taken.ok());
  gone = true;
  EXPECT_EQ(queue.Submit(JobKind::kCapture, "{}", "second").error().code, ErrorCode::kNotFound);
  const auto again = queue.Submit(JobKind::kCapture, "{}", "first");
  ASSERT_TRUE(again.ok()) << again.error().ToString();
  EXPECT_EQ(again->number, taken->number);
}

TEST(Jobs, AreCancelledWhileTheyWaitAndWhileTheyRun) {
  DaemonState state;
  Gate gate;
  JobQueue queue(
      state.store(),
      CapturesDo([&](const JobRecord&, JobContext& context) { return gate.Pass(context); }), {});
  const auto running = queue.Submit(JobKind::kCapture, "{}", "");
  gate.WaitUntilEntered(1);
  const auto waiting = queue.Submit(JobKind::kCapture, "{}", "");
  EXPECT_EQ(queue.Cancel(waiting->number)->state, JobState::kCancelled);
  EXPECT_TRUE(queue.Cancel(running->number)->cancel_requested);
  EXPECT_EQ(WaitForEnd(state.store(), running->number).state, JobState::kCancelled);
  EXPECT_EQ(queue.Cancel(running->number).error().code, ErrorCode::kInvalidArgument);
  EXPECT_EQ(queue.Cancel(999).error().code, ErrorCode::kNotFound);

  gate.Open();
  EXPECT_EQ(queue.Rerun(waiting->number)->state, JobState::kQueued);
  const JobRecord again = WaitForEnd(state.store(), waiting->number);
  EXPECT_EQ(again.state, JobState::kDone) << again.error;
  EXPECT_EQ(queue.Rerun(waiting->number).error().code, ErrorCode::kInvalidArgument);
}

TEST(Jobs, RefuseToBeCancelledForTheLastReasonAndNotWhenTheirWorkIsOver) {
  DaemonState state;
  Gate gate;
  JobQueue queue(state.store(), CapturesDo([&](const JobRecord&, JobContext& context) {
                   context.refuse_cancel("the disk is full");
                   context.refuse_cancel("the database is full");
                   return gate.Pass(context);
                 }),
                 {});
  const auto job = queue.Submit(JobKind::kCapture, "{}", "");
  gate.WaitUntilEntered(1);
  EXPECT_EQ(queue.CancelRefusals(), std::vector<std::string>{"the database is full"});
  EXPECT_EQ(queue.Cancel(job->number).error().message, "the database is full");
  const auto execute = [&](const std::string& sql) {
    const Status done =
        state.store().Write([&](Database& database, auto&) { return database.Execute(sql); });
    ASSERT_TRUE(done.ok()) << done.error().ToString();
  };
  execute("CREATE TRIGGER full BEFORE UPDATE ON jobs BEGIN SELECT RAISE(ABORT, 'no room'); END");
  gate.Open();
  while (!queue.CancelRefusals().empty()) std::this_thread::sleep_for(2ms);
  EXPECT_EQ(FindJob(state.store(), job->number)->state, JobState::kRunning)
      << "its end is not stored yet";
  execute("DROP TRIGGER full");
  EXPECT_EQ(WaitForEnd(state.store(), job->number).state, JobState::kDone);
}

TEST(Jobs, CaptureWhileAReconstructionRuns) {
  DaemonState state;
  Gate gate;
  JobHandlers handlers = CapturesDo(Nothing);
  handlers.reconstruction.run = [&](const JobRecord&, JobContext& context) {
    return gate.Pass(context);
  };
  JobQueue queue(state.store(), handlers, {});
  const auto computing = queue.Submit(JobKind::kReconstruction, "{}", "");
  gate.WaitUntilEntered(1);
  const auto calibration = queue.Submit(JobKind::kCalibration, "{}", "");
  const auto capture = queue.Submit(JobKind::kCapture, "{}", "");
  EXPECT_EQ(WaitForEnd(state.store(), capture->number).state, JobState::kDone);
  EXPECT_EQ(FindJob(state.store(), calibration->number)->state, JobState::kQueued);
  gate.Open();
  EXPECT_EQ(WaitForEnd(state.store(), computing->number).state, JobState::kDone);
  EXPECT_EQ(WaitForEnd(state.store(), calibration->number).state, JobState::kDone);
}

TEST(Jobs, TellOfTheirProgressNowAndThen) {
  DaemonState state;
  std::mutex mutex;
  std::map<std::string, int> heard;
  const auto subscription = state.hub().Subscribe([&](const EventRecord& event) {
    const std::lock_guard lock(mutex);
    ++heard[event.kind];
  });
  JobQueue::Options options;
  options.progress_interval = 87600h;  // longer than any machine has been up
  JobRecord end;
  {
    JobQueue queue(state.store(), CapturesDo([](const JobRecord&, JobContext& context) {
                     std::vector<std::thread> threads;
                     for (int t = 0; t < 4; ++t) {
                       threads.emplace_back([&context] {
                         for (size_t i = 0; i < 1000; ++i) context.progress("stage", i, 1000);
                       });
                     }
                     for (std::thread& thread : threads) thread.join();
                     return Result<std::string>("{}");
                   }),
                   options);
    end = WaitForEnd(state.store(), queue.Submit(JobKind::kCapture, "{}", "")->number);
  }
  EXPECT_EQ(end.stage, "stage");
  EXPECT_EQ(end.total, 1000u);
  EXPECT_EQ(heard["job_progress"], 1) << "of 4000";
  const auto events = ListEvents(state.store(), 0, 100);
  ASSERT_TRUE(events.ok());
  for (const EventRecord& event : *events) {
    EXPECT_NE(event.kind, "job_progress") << "an ended job's progress is of no use";
  }
}

TEST(Jobs, ThatAStopInterruptsCanBeRunAgainAndQueuedOnesWait) {
  DaemonState state;
  Gate closed;
  int64_t running = 0, waiting = 0;
  {
    JobQueue queue(state.store(), CapturesDo([&](const JobRecord& job, JobContext& context) {
                     EXPECT_TRUE(SetJobProduct(state.store(), job.number, "planned").ok());
                     return closed.Pass(context);
                   }),
                   {});
    running = queue.Submit(JobKind::kCapture, "{}", "key")->number;
    waiting = queue.Submit(JobKind::kCapture, "{}", "")->number;
    closed.WaitUntilEntered(1);
  }
  state.Reopen();
  EXPECT_EQ(FindJob(state.store(), running)->state, JobState::kInterrupted);
  EXPECT_EQ(FindJob(state.store(), waiting)->state, JobState::kQueued);

  std::mutex mutex;
  std::map<int64_t, std::string> products;
  JobQueue queue(state.store(), CapturesDo([&](const JobRecord& job, JobContext&) {
                   const std::lock_guard lock(mutex);
                   products[job.number] = job.product;
                   return Result<std::string>("{}");
                 }),
                 {});
  EXPECT_EQ(WaitForEnd(state.store(), waiting).state, JobState::kDone);
  EXPECT_EQ(FindJob(state.store(), running)->state, JobState::kInterrupted);
  EXPECT_EQ(queue.Submit(JobKind::kCapture, "{}", "key")->number, running) << "runs it again";
  EXPECT_EQ(WaitForEnd(state.store(), running).state, JobState::kDone);
  const std::lock_guard lock(mutex);
  EXPECT_EQ(products[running], "planned");
  EXPECT_EQ(products[waiting], "");
}

TEST(Jobs, ThatRanWhenTheDaemonDiedAreInterrupted) {
  DaemonState state;
  const auto job = AddJob(state.store(), {JobKind::kReconstruction, "{}", ""});
  ASSERT_TRUE(job.ok());
  const auto taken = TakeJob(state.store(), {JobKind::kReconstruction});
  ASSERT_TRUE(taken.ok() && *taken);
  EXPECT_EQ((*taken)->state, JobState::kRunning);
  EXPECT_FALSE(TakeJob(state.store(), {JobKind::kReconstruction})->has_value());
  EXPECT_EQ(state.Reopen().recovery().interrupted, std::vector<int64_t>{job->number});
  EXPECT_EQ(FindJob(state.store(), job->number)->state, JobState::kInterrupted);
  EXPECT_NE(FindJob(state.store(), job->number)->error.find("could not store how"),
            std::string::npos)
      << "nobody knows whether it died";
  EXPECT_EQ(CountJobs(state.store(), JobState::kInterrupted).value(), 1u);
}

TEST(Jobs, ThatGiveNoSignOfLifeAreNamed) {
  DaemonState state;
  Gate gate;
  JobQueue::Options options;
  options.capture_silence = 0s;
  JobQueue queue(state.store(), CapturesDo([&](const JobRecord&, JobContext& context) {
                   return gate.Pass(context);
                 }),
                 options);
  EXPECT_FALSE(queue.Hung().has_value()) << "idle";
  const auto job = queue.Submit(JobKind::kCapture, "{}", "");
  gate.WaitUntilEntered(1);
  const auto hung = queue.Hung();
  ASSERT_TRUE(hung.has_value());
  EXPECT_NE(hung->find("job " + std::to_string(job->number)), std::string::npos);
  gate.Open();
  WaitForEnd(state.store(), job->number);
}

TEST(Jobs, ThatCannotBeTakenFromTheStoreAreToldOfOnce) {
  DaemonState state;
  const auto execute = [&](const std::string& sql) {
    const Status done =
        state.store().Write([&](Database& database, auto&) { return database.Execute(sql); });
    ASSERT_TRUE(done.ok()) << done.error().ToString();
  };
  const auto job = AddJob(state.store(), {JobKind::kCapture, "{}", ""});
  ASSERT_TRUE(job.ok());
  execute("CREATE TRIGGER full BEFORE UPDATE ON jobs BEGIN SELECT RAISE(ABORT, 'no room'); END");
  std::mutex mutex;
  std::vector<std::string> told;
  JobQueue::Options options;
  options.tell = [&](const std::string& trouble) {
    const std::lock_guard lock(mutex);
    told.push_back(trouble);
  };
  JobQueue queue(state.store(), CapturesDo(Nothing), options);
  while (!queue.Trouble()) std::this_thread::sleep_for(2ms);
  EXPECT_NE(queue.Trouble()->find("jobs are not begun (capture): "), std::string::npos);
  EXPECT_NE(queue.Trouble()->find("no room"), std::string::npos);
  // Asked again at once, and in vain.
  EXPECT_TRUE(queue.Submit(JobKind::kCapture, "{}", "").ok());
  execute("DROP TRIGGER full");
  EXPECT_EQ(WaitForEnd(state.store(), job->number).state, JobState::kDone);
  EXPECT_FALSE(queue.Trouble().has_value());
  const std::lock_guard lock(mutex);
  EXPECT_EQ(told.size(), 1u);
}

TEST(Jobs, ThatEndWithTheDaemonOnAFullDiskGetTheRoomThatWasSetAside) {
  DaemonState state;
  const std::filesystem::path spare = state.folder() / "spare-room";
  struct stat file {};
  ASSERT_EQ(::stat(spare.c_str(), &file), 0);
  EXPECT_GE(file.st_blocks * 512, 1 << 20) << "it has its room";
  Gate gate;
  std::optional<JobQueue> queue(
      std::in_place, state.store(),
      CapturesDo([&](const JobRecord&, JobContext& context) { return gate.Pass(context); }),
      JobQueue::Options());
  ASSERT_TRUE(queue->Submit(JobKind::kCapture, "{}", "").ok());
  gate.WaitUntilEntered(1);
  ASSERT_TRUE(state.store()
                  .Write([](Database& database, auto&) {
                    return database.Execute(
                        "CREATE TRIGGER full BEFORE UPDATE ON jobs BEGIN SELECT RAISE(ABORT, 'no "
                        "room'); END");
                  })
                  .ok());
  queue.reset();
  EXPECT_FALSE(std::filesystem::exists(spare));
  ASSERT_TRUE(
      state.store()
          .Write([](Database& database, auto&) { return database.Execute("DROP TRIGGER full"); })
          .ok());
  state.Reopen();
  EXPECT_TRUE(std::filesystem::exists(spare)) << "for the next end";
}

TEST(Jobs, AreRefusedWhenTooManyWait) {
  DaemonState state;
  Gate gate;
  JobQueue::Options options;
  options.max_queued = 2;
  JobQueue queue(state.store(), CapturesDo([&](const JobRecord&, JobContext& context) {
                   return gate.Pass(context);
                 }),
                 options);
  ASSERT_TRUE(queue.Submit(JobKind::kCapture, "{}", "").ok());
  gate.WaitUntilEntered(1);  // does not wait any more
  const auto first = queue.Submit(JobKind::kCapture, "{}", "key");
  const auto second = queue.Submit(JobKind::kCapture, "{}", "");
  ASSERT_TRUE(first.ok() && second.ok());
  EXPECT_EQ(queue.Submit(JobKind::kCapture, "{}", "").error().code, ErrorCode::kFailed);
  EXPECT_EQ(queue.Submit(JobKind::kCapture, "{}", "key")->number, first->number);
  ASSERT_TRUE(queue.Cancel(second->number).ok());
  EXPECT_TRUE(queue.Submit(JobKind::kCapture, "{}", "").ok());
  EXPECT_EQ(queue.Rerun(second->number).error().code, ErrorCode::kFailed);
  EXPECT_EQ(queue.Rerun(first->number).error().code, ErrorCode::kInvalidArgument) << "it waits";
  EXPECT_EQ(queue.Rerun(4711).error().code, ErrorCode::kNotFound);
  gate.Open();
}

TEST(Jobs, ThatEndedLongAgoAreForgotten) {
  DaemonState state;
  const JobState ends[] = {JobState::kDone,   JobState::kFailed, JobState::kInterrupted,
                           JobState::kQueued, JobState::kDone,   JobState::kDone};
  for (const JobState end : ends) {
    JobRecord job = AddJob(state.store(), {JobKind::kCapture, "{}", ""}).value();
    job.state = end;
    ASSERT_TRUE(EndJob(state.store(), job).ok());
  }
  test::WriteTinyFrameSet(state.store().CaptureFolder("1"), "2026-01-01T00:00:00Z");
  ASSERT_TRUE(RecordCapture(state.store(), "1", std::nullopt).ok());
  EXPECT_EQ(PruneJobs(state.store(), 2).value(), 2u);
  std::vector<int64_t> left;
  const auto listed = ListJobs(state.store(), {});
  for (const JobRecord& job : listed->items) left.push_back(job.number);
  EXPECT_EQ(left, (std::vector<int64_t>{6, 5, 4, 3})) << "those that wait or were interrupted stay";
  std::set<std::string> told;
  const auto events = ListEvents(state.store(), 0, 100);
  for (const EventRecord& event : *events) {
    if (event.kind.starts_with("job_")) told.insert(event.about);
  }
  EXPECT_EQ(told, (std::set<std::string>{"3", "4", "5", "6"})) << "of forgotten ones nothing";
  EXPECT_EQ(events->back().kind, "capture_stored") << "what is no job's stays";
  EXPECT_EQ(PruneJobs(state.store(), 2).value(), 0u);
  EXPECT_EQ(AddJob(state.store(), {JobKind::kCapture, "{}", ""})->number, 7);
}

TEST(Jobs, ArePagedNewestFirst) {
  DaemonState state;
  for (int i = 0; i < 5; ++i) {
    ASSERT_TRUE(AddJob(state.store(), {JobKind::kCapture, "{}", ""}).ok());
  }
  const auto first = ListJobs(state.store(), {2, ""});
  ASSERT_TRUE(first.ok());
  EXPECT_EQ(first->items[0].number, 5);
  EXPECT_EQ(first->next, "4");
  const auto last = ListJobs(state.store(), {500, first->next}, JobState::kQueued);
  EXPECT_EQ(last->items.size(), 3u);
  EXPECT_TRUE(last->next.empty());
  EXPECT_TRUE(ListJobs(state.store(), {}, JobState::kDone)->items.empty());
  EXPECT_FALSE(ListJobs(state.store(), {2, "4x"}).ok());
}

}  // namespace
}  // namespace rotunda::daemon
