#include "daemon/capture_job.h"

#include <gtest/gtest.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <climits>
#include <map>
#include <string>
#include <thread>

#include "daemon/reconstruction_request.h"
#include "daemon/store_calibrations.h"
#include "daemon/store_captures.h"
#include "daemon/store_events.h"
#include "daemon/store_sql.h"
#include "tests/support/daemon_state.h"
#include "tests/support/simulated_rig.h"

namespace {

/// While it is set the disk does not answer where captures are made durable.
std::atomic<bool> disk_hangs = false;
std::atomic<int> hanging = 0;

bool IsOfACapture(int fd) {
  char path[PATH_MAX] = {};
  const std::string link = "/proc/self/fd/" + std::to_string(fd);
  return readlink(link.c_str(), path, sizeof(path) - 1) > 0 &&
         std::string(path).find("/captures/") != std::string::npos;
}

}  // namespace

/// In place of libc's, for what is linked into this program.
extern "C" int fsync(int fd) {
  while (disk_hangs && IsOfACapture(fd)) {
    hanging = 1;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return static_cast<int>(syscall(SYS_fsync, fd));
}

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using sim::FaultKind;
using test::DaemonState;
using test::SimulatedRig;

constexpr int kCameras = 4;
constexpr char kBlock[] = "127.62.1";

SimulatedRig::Options Rig() {
  SimulatedRig::Options options;
  options.block = kBlock;
  options.cameras = kCameras;
  options.like.width_px = 300;
  options.like.height_px = 400;
  options.source = sim::PatternSource(300, 400);
  return options;
}

/// Reconstructions are not what is tested here.
JobHandler Idle() {
  JobHandler handler;
  handler.check = [](const std::string& body) { return Result<std::string>(body); };
  handler.run = [](const JobRecord&, JobContext&) { return Result<std::string>("{}"); };
  return handler;
}

/// Simulated cameras, a station that fires them, and the daemon's queue.
class CaptureJobTest : public ::testing::Test {
 protected:
  CaptureJobTest() : rig_(Rig()) {
    rig_.capture().retries = 0;
    rig_.capture().timing.late_ms = 100;
    rig_.capture().timing.deadline_ms = 500;
    CaptureStation::Options options{rig_.capture(), rig_.server().socket(), 60s};
    station_ = std::make_unique<CaptureStation>(options);
    StartQueue(0);
  }
  ~CaptureJobTest() override { queue_.reset(); }

  void StartQueue(uint64_t reserve_bytes, JobQueue::Options options = {},
                  std::chrono::milliseconds end_patience = 0ms) {
    queue_.reset();
    CaptureJobOptions capture{[reserve_bytes] { return reserve_bytes; }, end_patience,
                              [this](const std::string& trouble) { told_ = trouble; }};
    queue_ = std::make_unique<JobQueue>(
        store(), JobHandlers{MakeCaptureHandler(store(), *station_, capture), Idle(), Idle()},
        options);
  }
  /// Nothing can be made in a folder that is a file.
  void LetTheDiskRefuse() {
    fs::remove_all(Captures());
    ASSERT_TRUE(WriteNewFile(Captures(), "").ok());
  }
  void MendTheDisk() {
    fs::remove(Captures());
    fs::create_directory(Captures());
  }
  void Execute(const std::string& sql) {
    const Status done =
        store().Write([&](Database& database, auto&) { return database.Execute(sql); });
    ASSERT_TRUE(done.ok()) << done.error().ToString();
  }
  /// Until trigger `full` is dropped.
  void RefuseInTheDatabase() {
    Execute(
        "CREATE TRIGGER full BEFORE INSERT ON captures BEGIN SELECT RAISE(ABORT, 'no room'); END");
  }
  fs::path Captures() const { return state_.folder() / "captures"; }
  /// A capture whose shot the disk has refused; its job.
  int64_t RefusedShot() {
    const auto job = queue_->Submit(JobKind::kCapture, "{\"reconstruct\": false}", "");
    EXPECT_TRUE(job.ok()) << job.error().ToString();
    while (CountEvents("capture_waits") == 0) std::this_thread::sleep_for(2ms);
    return job->number;
  }
  /// Events of this kind about the shot of the newest job.
  size_t CountEvents(const std::string& kind) {
    const std::string shot = ListJobs(store(), {})->items[0].product;
    const auto events = ListEvents(store(), 0, 1000);
    return static_cast<size_t>(std::count_if(
        events->begin(), events->end(),
        [&](const EventRecord& event) { return event.kind == kind && event.about == shot; }));
  }
  Store& store() { return state_.store(); }
  JobRecord Wait(int64_t number) {
    while (true) {
      JobRecord job = FindJob(store(), number).value();
      if (job.state != JobState::kQueued && job.state != JobState::kRunning) return job;
      std::this_thread::sleep_for(2ms);
    }
  }
  JobRecord Capture(const std::string& body) {
    const auto job = queue_->Submit(JobKind::kCapture, body, "");
    EXPECT_TRUE(job.ok()) << job.error().ToString();
    return Wait(job->number);
  }

  /// "now".
  void PutCalibrationInForce() {
    Calibration calibration;
    calibration.created_at = "2026-01-01T00:00:00Z";
    CalibratedCamera& camera = calibration.cameras.emplace_back();
    camera.camera = "c000";
    camera.intrinsics = {CameraModel::kPinhole, 300, 400, {400, 400, 150, 200}};
    test::WriteCalibrationFolder(store().CalibrationFolder("now"), calibration);
    ASSERT_TRUE(RecordCalibration(store(), "now").ok());
    ASSERT_TRUE(ActivateCalibration(store(), "now").ok());
  }

  DaemonState state_;
  std::string told_;  // to the log, by the queue's thread; to be read when it has ended
  SimulatedRig rig_;
  std::unique_ptr<CaptureStation> station_;
  std::unique_ptr<JobQueue> queue_;
};

TEST_F(CaptureJobTest, MakesADurableFrameSetWithTheCalibrationInForceAndQueuesItsReconstruction) {
  PutCalibrationInForce();
  const JobRecord job = Capture("{\"subject\": \"Anna\"}");
  ASSERT_EQ(job.state, JobState::kDone) << job.error;
  const auto capture = FindCapture(store(), job.product);
  ASSERT_TRUE(capture.ok());
  EXPECT_EQ(capture->ok_frames, uint64_t{kCameras});
  EXPECT_EQ(capture->subject, "Anna");
  EXPECT_EQ(capture->calibration, "now");
  const auto set = ReadFrameSet(store().CaptureFolder(capture->id));
  ASSERT_TRUE(set.ok());
  EXPECT_EQ(set->id, capture->id);
  EXPECT_EQ(std::get<std::string>(set->trigger.at("source")), "simulated");
  EXPECT_NE(job.result.find("\"complete\":true"), std::string::npos) << job.result;

  const auto jobs = ListJobs(store(), {});
  ASSERT_EQ(jobs->items.size(), 2u);
  EXPECT_EQ(jobs->items[0].kind, JobKind::kReconstruction);
  EXPECT_NE(jobs->items[0].body.find("\"capture\":\"" + capture->id + "\""), std::string::npos);

  // The next one: the cameras are still open.
  const JobRecord second = Capture("{\"reconstruct\": false}");
  ASSERT_EQ(second.state, JobState::kDone) << second.error;
  EXPECT_NE(second.product, job.product);
  EXPECT_EQ(ListJobs(store(), {})->items.size(), 3u) << "no reconstruction of it";
  for (const rig::CameraState& state : station_->States()) {
    EXPECT_EQ(state.condition, rig::CameraCondition::kReady) << state.camera;
  }
}

TEST_F(CaptureJobTest, AShotIsTakenWithoutACalibrationThatCannotBeReadAndSaysSo) {
  PutCalibrationInForce();
  const fs::path folder = store().CalibrationFolder("now");
  const auto expect_without = [&](const std::string& why) {
    const JobRecord job = Capture("{\"reconstruct\": false}");
    ASSERT_EQ(job.state, JobState::kDone) << job.error;
    EXPECT_NE(job.result.find("without the calibration in force"), std::string::npos) << job.result;
    EXPECT_NE(job.result.find(why), std::string::npos) << job.result;
    EXPECT_EQ(FindCapture(store(), job.product)->ok_frames, uint64_t{kCameras});
    EXPECT_FALSE(FindCapture(store(), job.product)->calibration.has_value());
    EXPECT_FALSE(fs::exists(store().CaptureFolder(job.product) / "calibration.json"));
  };
  fs::resize_file(folder / "calibration.json", 20);
  expect_without("calibration.json");
  fs::remove_all(folder);
  expect_without("No such file");
}

TEST_F(CaptureJobTest, ASetWithoutACalibrationIsReconstructedWithoutThePriorAndSaysSo) {
  const std::string body = R"({"preset":"internet","prior":"calibration"})";
  const std::string note = "reconstructed without the prior that was asked for";
  PutCalibrationInForce();
  EXPECT_EQ(Capture(body).result.find(note), std::string::npos) << "it has its calibration";
  fs::resize_file(store().CalibrationFolder("now") / "calibration.json", 20);
  const JobRecord job = Capture(body);
  ASSERT_EQ(job.state, JobState::kDone) << job.error;
  EXPECT_NE(job.result.find(note), std::string::npos) << job.result;
  sfm::RunChoices choices;
  choices.preset = sfm::Preset::kInternet;
  EXPECT_EQ(ListJobs(store(), {})->items[0].body, ReconstructionBody(job.product, choices));
  EXPECT_EQ(CaptureFollowUp(store(), job)->body, ReconstructionBody(job.product, choices))
      << "likewise when a start finds the shot";
}

TEST_F(CaptureJobTest, AShotWithMissingCamerasIsKeptAndSaysWhich) {
  ASSERT_TRUE(rig_.server().SetFault(2, {FaultKind::kMute, 0, 0}).ok());
  const JobRecord job = Capture("{}");
  ASSERT_EQ(job.state, JobState::kDone) << job.error;
  const auto capture = FindCapture(store(), job.product);
  EXPECT_EQ(capture->ok_frames, uint64_t{kCameras - 1});
  EXPECT_EQ(capture->frames, uint64_t{kCameras});
  const FrameRecord missing = ListFrames(store(), capture->id)->at(2);
  EXPECT_EQ(missing.status, "missing");
  EXPECT_NE(job.result.find("c002 missing (" + missing.reason + ")"), std::string::npos)
      << missing.reason << " in " << job.result;
  EXPECT_NE(job.result.find("c002 missing"), std::string::npos) << job.result;
}

/// The others' frames have come when it is cancelled.
TEST_F(CaptureJobTest, CancelledAfterThePulseKeepsWhatHasComeAndWaitsForNobody) {
  queue_.reset();
  rig_.capture().timing.deadline_ms = 60000;
  station_ = std::make_unique<CaptureStation>(
      CaptureStation::Options{rig_.capture(), rig_.server().socket(), 60s});
  StartQueue(0);
  ASSERT_TRUE(station_->Open().ok());
  const auto ready = [&](const rig::CameraState& state) {
    return state.condition == rig::CameraCondition::kReady;
  };
  std::vector<rig::CameraState> before;
  do {
    std::this_thread::sleep_for(1ms);
    before = station_->States();
  } while (!std::all_of(before.begin(), before.end(), ready));
  ASSERT_TRUE(rig_.server().SetFault(2, {FaultKind::kMute, 0, 0}).ok());
  const auto job = queue_->Submit(JobKind::kCapture, "{}", "");
  const auto has_come = [&](size_t i) {
    return station_->States()[i].last_frame_at != before[i].last_frame_at;
  };
  while (!has_come(0) || !has_come(1) || !has_come(3)) std::this_thread::sleep_for(1ms);
  ASSERT_TRUE(queue_->Cancel(job->number).ok());
  const JobRecord end = Wait(job->number);
  ASSERT_EQ(end.state, JobState::kDone) << end.error;
  const auto frames = ListFrames(store(), end.product);
  ASSERT_EQ(frames->size(), size_t{kCameras});
  for (size_t i = 0; i < frames->size(); ++i) {
    EXPECT_EQ(frames->at(i).status, i == 2 ? "interrupted" : "ok") << i;
  }
}

TEST_F(CaptureJobTest, IsRefusedWhenTheDiskIsNearlyFull) {
  StartQueue(uint64_t{1} << 60);
  const auto job = queue_->Submit(JobKind::kCapture, "{}", "");
  ASSERT_FALSE(job.ok());
  EXPECT_EQ(job.error().code, ErrorCode::kIo);
  EXPECT_NE(job.error().message.find("reserve"), std::string::npos);
  EXPECT_TRUE(ListJobs(store(), {})->items.empty());
}

TEST_F(CaptureJobTest, RefusesRequestsThatItDoesNotUnderstand) {
  for (const char* body : {"", "[]", "{\"subject\": 5}", "{\"reconstruct\": \"no\"}",
                           "{\"colour\": true}", "{\"subject\": \"a\", \"subject\": \"b\"}"}) {
    const auto job = queue_->Submit(JobKind::kCapture, body, "");
    ASSERT_FALSE(job.ok()) << body;
    EXPECT_EQ(job.error().code, ErrorCode::kInvalidArgument) << body;
  }
}

TEST_F(CaptureJobTest, ASubjectIsPlainText) {
  const std::string expected =
      "subject: expected at most 200 bytes of UTF-8 without control characters, found ";
  const std::map<std::string, std::string> refused = {
      {std::string(201, 'a'), "201 bytes"},
      {"Anna\\nBerta", "the control character U+000A at byte 4"},
      {"\\u0000", "the control character U+0000 at byte 0"},
      {"\x7F", "the control character U+007F at byte 0"},
      {"\\u001b[31m", "the control character U+001B at byte 0"},
      {"\u009B31m", "the control character U+009B at byte 0"}};
  for (const auto& [subject, found] : refused) {
    const auto job = queue_->Submit(JobKind::kCapture, "{\"subject\":\"" + subject + "\"}", "");
    ASSERT_FALSE(job.ok()) << subject;
    EXPECT_EQ(job.error().code, ErrorCode::kInvalidArgument);
    EXPECT_EQ(job.error().ToString(), expected + found);
  }
}

TEST_F(CaptureJobTest, PresetAndPriorAreThoseOfItsReconstruction) {
  const std::string both = R"({"preset":"internet","prior":"calibration"})";
  const auto refused = queue_->Submit(JobKind::kCapture, both, "");
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().ToString(), "prior: needs a calibration, and none is in force");
  for (const char* key : {"preset\":\"internet", "prior\":\"none"}) {
    const std::string body = std::string(R"({"reconstruct":false,")") + key + "\"}";
    const auto useless = queue_->Submit(JobKind::kCapture, body, "");
    ASSERT_FALSE(useless.ok()) << body;
    EXPECT_EQ(useless.error().message, "has no effect on a capture that is not reconstructed");
  }
  EXPECT_FALSE(queue_->Submit(JobKind::kCapture, R"({"preset":"literal"})", "").ok());
  PutCalibrationInForce();
  const JobRecord job = Capture(both);
  ASSERT_EQ(job.state, JobState::kDone) << job.error;
  sfm::RunChoices choices;
  choices.preset = sfm::Preset::kInternet;
  choices.calibration_prior = true;
  EXPECT_EQ(ListJobs(store(), {})->items[0].body, ReconstructionBody(job.product, choices));
}

TEST_F(CaptureJobTest, ThatHadItsShotBeforeTheDaemonDiedDoesNotTakeAnother) {
  queue_.reset();
  const auto job = AddJob(store(), {JobKind::kCapture, "{\"reconstruct\":true}", ""});
  ASSERT_TRUE(TakeJob(store(), {JobKind::kCapture}).ok());
  ASSERT_TRUE(SetJobProduct(store(), job->number, "had").ok());
  test::WriteTinyFrameSet(store().CaptureFolder("had"), "2026-01-01T00:00:00Z");
  state_.Reopen();
  EXPECT_EQ(store().recovery().adopted, std::vector<std::string>{"captures/had"});
  StartQueue(0);
  ASSERT_TRUE(queue_->Rerun(job->number).ok());
  const JobRecord end = Wait(job->number);
  EXPECT_EQ(end.state, JobState::kDone) << end.error;
  EXPECT_NE(end.result.find("\"capture\":\"had\""), std::string::npos);
  EXPECT_EQ(ListCaptures(store(), {})->items.size(), 1u);
  EXPECT_EQ(ListJobs(store(), {})->items[0].kind, JobKind::kReconstruction);
}

/// What a new request may not say was once taken.
TEST_F(CaptureJobTest, AJobWhoseSubjectWouldBeRefusedTodayKeepsItsShot) {
  queue_.reset();
  const std::string body = R"({"subject":"Anna\nBerta","reconstruct":true})";
  const auto job = AddJob(store(), {JobKind::kCapture, body, ""});
  ASSERT_TRUE(TakeJob(store(), {JobKind::kCapture}).ok());
  ASSERT_TRUE(SetJobProduct(store(), job->number, "had").ok());
  test::WriteTinyFrameSet(store().CaptureFolder("had"), "2026-01-01T00:00:00Z");
  state_.SetFollowUp(CaptureFollowUp);
  state_.Reopen();
  const auto queued = ListJobs(store(), {}, JobState::kQueued);
  ASSERT_EQ(queued->items.size(), 1u);
  EXPECT_EQ(queued->items[0].body, ReconstructionBody("had"));
  StartQueue(0);
  EXPECT_FALSE(queue_->Submit(JobKind::kCapture, body, "").ok()) << "a new one";
  ASSERT_TRUE(queue_->Rerun(job->number).ok());
  const JobRecord end = Wait(job->number);
  EXPECT_EQ(end.state, JobState::kDone) << end.error;
  EXPECT_NE(end.result.find("\"capture\":\"had\""), std::string::npos) << end.result;
}

TEST_F(CaptureJobTest, RunAgainWithoutAShotTakesItUnderAnIdOfItsOwnTime) {
  queue_.reset();
  const auto job = AddJob(store(), {JobKind::kCapture, "{\"reconstruct\":false}", ""});
  ASSERT_TRUE(TakeJob(store(), {JobKind::kCapture}).ok());
  const std::string reserved = FreeCaptureId(store()).value();
  ASSERT_TRUE(SetJobProduct(store(), job->number, reserved).ok());
  state_.Reopen();
  state_.clock().Advance(1h);
  StartQueue(0);
  ASSERT_TRUE(queue_->Rerun(job->number).ok());
  const JobRecord end = Wait(job->number);
  ASSERT_EQ(end.state, JobState::kDone) << end.error;
  EXPECT_EQ(FindCapture(store(), reserved).error().code, ErrorCode::kNotFound);
  const auto capture = FindCapture(store(), end.product);
  ASSERT_TRUE(capture.ok());
  // 20260101T010012Z of 2026-01-01T01:00:12.000Z, but for the second between the two.
  std::string hour = capture->captured_at.substr(0, 14);
  std::erase_if(hour, [](char c) { return c == '-' || c == ':'; });
  EXPECT_EQ(capture->id.substr(0, hour.size()), hour);
  EXPECT_NE(reserved.substr(0, hour.size()), hour);
}

TEST_F(CaptureJobTest, AShotFoundOnTheDiskIsReconstructedAsItsJobAsked) {
  queue_.reset();
  const std::map<std::string, bool> asked = {{"with", true}, {"without", false}};
  for (const auto& [id, reconstruct] : asked) {
    const std::string body = std::string("{\"reconstruct\":") + (reconstruct ? "true}" : "false}");
    const auto job = AddJob(store(), {JobKind::kCapture, body, ""});
    ASSERT_TRUE(TakeJob(store(), {JobKind::kCapture}).ok());
    ASSERT_TRUE(SetJobProduct(store(), job->number, id).ok());
    test::WriteTinyFrameSet(store().CaptureFolder(id), "2026-01-01T00:00:00Z");
  }
  test::WriteTinyFrameSet(store().CaptureFolder("copied"), "2026-01-01T00:00:00Z");
  state_.SetFollowUp(CaptureFollowUp);
  state_.Reopen();
  EXPECT_EQ(store().recovery().adopted.size(), 3u);
  const auto queued = ListJobs(store(), {}, JobState::kQueued);
  ASSERT_EQ(queued->items.size(), 1u) << "of the one that asked for it";
  EXPECT_EQ(queued->items[0].kind, JobKind::kReconstruction);
  EXPECT_EQ(queued->items[0].body, ReconstructionBody("with"));
  // Its job, run again, has nothing more to ask for.
  StartQueue(0);
  ASSERT_TRUE(queue_->Rerun(1).ok());
  EXPECT_EQ(Wait(1).state, JobState::kDone);
  EXPECT_EQ(ListJobs(store(), {})->items.size(), 3u);
}

TEST_F(CaptureJobTest, WaitsForADiskThatRefusesAndIsNotCancelled) {
  LetTheDiskRefuse();
  const int64_t job = RefusedShot();
  while (FindJob(store(), job)->stage != kWaitingForDisk) std::this_thread::sleep_for(2ms);
  const auto cancelled = queue_->Cancel(job);
  ASSERT_FALSE(cancelled.ok());
  EXPECT_EQ(cancelled.error().code, ErrorCode::kInvalidArgument);
  EXPECT_NE(cancelled.error().message.find(kShotWaits), std::string::npos);
  EXPECT_NE(cancelled.error().message.find(Captures().string()), std::string::npos)
      << cancelled.error().message;
  EXPECT_EQ(FindJob(store(), job)->state, JobState::kRunning);
  MendTheDisk();
  const JobRecord end = Wait(job);
  ASSERT_EQ(end.state, JobState::kDone) << end.error;
  EXPECT_EQ(FindCapture(store(), end.product)->ok_frames, uint64_t{kCameras});
  EXPECT_EQ(CountEvents("capture_waits"), 1u) << "not for each attempt";
}

TEST_F(CaptureJobTest, AShotThatOnlyTheDatabaseRefusesIsToldOfTillItIsTaken) {
  RefuseInTheDatabase();
  const int64_t job = RefusedShot();
  const auto refusals = queue_->CancelRefusals();
  ASSERT_EQ(refusals.size(), 1u);
  const std::string shot = FindJob(store(), job)->product;
  EXPECT_EQ(refusals[0], "shot " + shot + ": is taken and waits for the disk (" +
                             (state_.folder() / "rotunda.db").string() +
                             ": database: no room): make room there; it is not given up");
  Execute("DROP TRIGGER full");
  EXPECT_EQ(Wait(job).state, JobState::kDone);
}

TEST_F(CaptureJobTest, WhyItIsNotCancelledIsWhatHoldsNow) {
  RefuseInTheDatabase();
  LetTheDiskRefuse();
  const int64_t job = RefusedShot();
  EXPECT_NE(queue_->Cancel(job).error().message.find(Captures().string()), std::string::npos);
  MendTheDisk();
  const auto says = [&](const std::string& what) {
    return queue_->CancelRefusals().at(0).find(what) != std::string::npos;
  };
  while (!says("no room")) std::this_thread::sleep_for(2ms);
  EXPECT_FALSE(says(Captures().string())) << "that is mended";
  EXPECT_NE(queue_->Cancel(job).error().message.find("no room"), std::string::npos);
  Execute("DROP TRIGGER full");
  EXPECT_EQ(Wait(job).state, JobState::kDone);
  EXPECT_EQ(CountEvents("capture_waits"), 1u) << "not for each reason";
}

TEST_F(CaptureJobTest, CancelledBeforeTheDiskRefusesItIsNotGivenUpEither) {
  disk_hangs = true;
  hanging = 0;
  const auto job = queue_->Submit(JobKind::kCapture, "{}", "");
  while (hanging == 0) std::this_thread::sleep_for(2ms);
  const auto cancelled = queue_->Cancel(job->number);
  ASSERT_TRUE(cancelled.ok()) << "nothing is known to be the matter";
  EXPECT_TRUE(cancelled->cancel_requested);
  LetTheDiskRefuse();
  disk_hangs = false;
  while (CountEvents("capture_waits") == 0) std::this_thread::sleep_for(2ms);
  MendTheDisk();
  EXPECT_EQ(Wait(job->number).state, JobState::kDone);
}

TEST_F(CaptureJobTest, AShotThatWaitsForTheDiskIsKeptWhenThatIsMendedWhileTheDaemonEnds) {
  StartQueue(0, {}, 60s);
  LetTheDiskRefuse();
  const int64_t job = RefusedShot();
  queue_->RequestStop();
  MendTheDisk();
  queue_.reset();
  const auto end = FindJob(store(), job);
  ASSERT_EQ(end->state, JobState::kDone) << end->error;
  EXPECT_EQ(FindCapture(store(), end->product)->ok_frames, uint64_t{kCameras});
}

TEST_F(CaptureJobTest, AShotThatIsLostAtTheEndOfTheDaemonIsNamed) {
  StartQueue(0, {}, 10ms);
  LetTheDiskRefuse();
  const int64_t job = RefusedShot();
  queue_.reset();
  const auto end = FindJob(store(), job);
  EXPECT_EQ(end->state, JobState::kInterrupted);
  EXPECT_NE(end->error.find("shot " + end->product + ": is lost: the disk refused it for"),
            std::string::npos)
      << end->error;
  EXPECT_EQ(CountEvents("capture_lost"), 1u);
  EXPECT_EQ(told_, "");
}

TEST_F(CaptureJobTest, WhatTheStoreCannotKeepOfAShotGoesToTheLog) {
  ASSERT_TRUE(store()
                  .Write([](Database& database, auto&) {
                    return database.Execute(
                        "CREATE TRIGGER full BEFORE INSERT ON events WHEN new.kind GLOB "
                        "'capture_*' BEGIN SELECT RAISE(ABORT, 'no room'); END");
                  })
                  .ok());
  LetTheDiskRefuse();
  const auto job = queue_->Submit(JobKind::kCapture, "{}", "");
  while (FindJob(store(), job->number)->stage != kWaitingForDisk) std::this_thread::sleep_for(2ms);
  queue_.reset();
  const auto end = FindJob(store(), job->number);
  EXPECT_EQ(told_.find("shot " + end->product + ": is lost: "), 0u) << told_;
}

TEST_F(CaptureJobTest, AWriterThatHangsIsAHungJobForTheWatchdog) {
  JobQueue::Options options;
  options.capture_silence = 1s;
  StartQueue(0, options);
  disk_hangs = true;
  const auto job = queue_->Submit(JobKind::kCapture, "{}", "");
  while (hanging == 0) std::this_thread::sleep_for(2ms);
  // Long after the silence; it did not come at all while waiting counted as a sign of life.
  for (int i = 0; i < 10000 && !queue_->Hung(); ++i) std::this_thread::sleep_for(2ms);
  const auto hung = queue_->Hung();
  disk_hangs = false;
  ASSERT_TRUE(hung.has_value());
  EXPECT_NE(hung->find("job " + std::to_string(job->number)), std::string::npos) << *hung;
  EXPECT_EQ(Wait(job->number).state, JobState::kDone) << "a disk that answers again";
}

TEST_F(CaptureJobTest, APreviewIsAJpegAsSoonAsTheCameraIsReady) {
  ASSERT_TRUE(station_->Open().ok());
  Result<std::string> jpeg = Error{};
  while (!jpeg && jpeg.error().code == ErrorCode::kFailed) {
    jpeg = station_->PreviewJpeg("c001");
    std::this_thread::sleep_for(1ms);
  }
  ASSERT_TRUE(jpeg.ok()) << jpeg.error().ToString();
  EXPECT_EQ(jpeg->substr(0, 3), "\xFF\xD8\xFF");
  EXPECT_EQ(station_->PreviewJpeg("nobody").error().code, ErrorCode::kNotFound);
  EXPECT_EQ(Capture("{}").state, JobState::kDone) << "previews before that did no harm";
}

}  // namespace
}  // namespace rotunda::daemon
