#include <gtest/gtest.h>

#include <algorithm>

#include "daemon/calibration_job.h"
#include "daemon/reconstruction_job.h"
#include "daemon/reconstruction_request.h"
#include "daemon/store_calibrations.h"
#include "daemon/store_captures.h"
#include "daemon/store_reconstructions.h"
#include "rig/sim/simulate.h"
#include "sfm/core/file_io.h"
#include "sfm/core/pose_set.h"
#include "tests/support/daemon_state.h"
#include "tests/support/small_frame_set.h"

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;
using test::DaemonState;

/// A capture of noise, which no reconstruction makes sense of.
void AddNoise(Store& store, const std::string& id) {
  test::WriteSmallFrameSet(store.CaptureFolder(id), 3, "NOISE");
  ASSERT_TRUE(RecordCapture(store, id, std::nullopt).ok());
}

JobRecord JobOf(Store& store, JobKind kind, const std::string& body) {
  const auto added = AddJob(store, {kind, body, ""});
  EXPECT_TRUE(added.ok());
  return *added;
}

TEST(ReconstructionJob, TheBodyIsFilledInAndChecked) {
  DaemonState state;
  AddNoise(state.store(), "x");
  const JobHandler handler = MakeReconstructionHandler(state.store(), 1);
  EXPECT_EQ(handler.check("{\"capture\": \"x\"}").value(), ReconstructionBody("x"));
  EXPECT_EQ(handler.check("{ \"pairs\":\"exhaustive\", \"capture\":\"x\" }").value(),
            ReconstructionBody("x"))
      << "the same request, however it is written";
  EXPECT_EQ(handler.refers("{\"capture\": \"y\"}").error().code, ErrorCode::kNotFound);
  EXPECT_EQ(handler.refers("{\"capture\": \"x\", \"calibration\": \"../x\"}").error().code,
            ErrorCode::kNotFound);
  for (const char* body :
       {"{}", "{\"capture\": 3}", "{\"capture\": \"x\", \"method\": \"magic\"}",
        "{\"capture\": \"x\", \"pairs\": \"\"}", "{\"capture\": \"x\", \"threads\": 5}"}) {
    EXPECT_EQ(handler.check(body).error().code, ErrorCode::kInvalidArgument) << body;
  }
  EXPECT_EQ(
      handler.check("{\"capture\": \"x\", \"threads\": 5}").error().ToString(),
      "request: threads: is not known, expected only: calibration, method, preset, pairs, prior, "
      "refine_intrinsics")
      << "the capture is in the path";
  EXPECT_NE(handler.check("{\"capture\": \"x\", \"method\": \"magic\"}")
                .error()
                .ToString()
                .find("method: expected one of \"plain\", \"tc-sfm\""),
            std::string::npos)
      << handler.check("{\"capture\": \"x\", \"method\": \"magic\"}").error().ToString();
}

TEST(ReconstructionJob, APresetAndAPriorAreThoseOfTheCommand) {
  DaemonState state;
  AddNoise(state.store(), "x");
  const JobHandler handler = MakeReconstructionHandler(state.store(), 1);
  const std::string usual = ReconstructionBody("x");
  EXPECT_NE(usual.find("\"preset\":\"rig\""), std::string::npos) << usual;
  EXPECT_NE(usual.find("\"prior\":\"none\""), std::string::npos) << usual;
  sfm::RunChoices choices;
  choices.preset = sfm::Preset::kInternet;
  choices.calibration_prior = true;
  const std::string body = ReconstructionBody("x", choices);
  EXPECT_EQ(handler.check(R"({"capture":"x","prior":"calibration","preset":"internet"})").value(),
            body);
  const auto parsed = ParseReconstructionRequest(body);
  ASSERT_TRUE(parsed.ok()) << parsed.error().ToString();
  EXPECT_EQ(parsed->choices.preset, sfm::Preset::kInternet);
  EXPECT_TRUE(parsed->choices.calibration_prior);
  const std::vector<std::pair<const char*, const char*>> refused = {
      {R"({"capture":"x","preset":"literal"})",
       "request: preset: expected one of \"internet\", \"rig\", found \"literal\""},
      {R"({"capture":"x","prior":true})", "request: prior: expected a string, found true"},
      {R"({"capture":"x","prior":"poses"})",
       "request: prior: expected one of \"calibration\", \"none\", found \"poses\""},
      {R"({"capture":"x","method":"plain","preset":"internet"})",
       "request: preset: has no effect on plain, only on tc-sfm"},
      {R"({"capture":"x","method":"plain","prior":"calibration"})",
       "request: prior: has no effect on plain, only on tc-sfm"}};
  for (const auto& [request, why] : refused) {
    const auto checked = handler.check(request);
    ASSERT_FALSE(checked.ok()) << request;
    EXPECT_EQ(checked.error().code, ErrorCode::kInvalidArgument);
    EXPECT_EQ(checked.error().ToString(), why);
  }
}

TEST(ReconstructionJob, APriorNeedsTheCalibrationOfTheCaptureOrOneThatIsNamed) {
  DaemonState state;
  Store& store = state.store();
  Calibration calibration;
  calibration.created_at = "2026-01-01T00:00:00Z";
  test::WriteCalibrationFolder(store.CalibrationFolder("k"), calibration);
  ASSERT_TRUE(RecordCalibration(store, "k").ok());
  AddNoise(store, "without");
  test::WriteSmallFrameSet(store.CaptureFolder("with"), 3, "NOISE");
  fs::copy_file(store.CalibrationFolder("k") / "calibration.json",
                store.CaptureFolder("with") / "calibration.json");
  ASSERT_TRUE(RecordCapture(store, "with", std::nullopt).ok());
  const JobHandler handler = MakeReconstructionHandler(store, 1);
  const Status refused = handler.refers(R"({"capture":"without","prior":"calibration"})");
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().code, ErrorCode::kInvalidArgument);
  EXPECT_EQ(refused.error().ToString(),
            "prior: needs a calibration, and none was in force at capture \"without\": name one as "
            "\"calibration\"");
  for (const char* fine :
       {R"({"capture":"without","prior":"calibration","calibration":"k"})",
        R"({"capture":"with","prior":"calibration"})", R"({"capture":"without"})"}) {
    const Status refers = handler.refers(fine);
    EXPECT_TRUE(refers.ok()) << fine << refers.error().ToString();
  }
}

TEST(ReconstructionJob, ThePageBesideACalibrationIsTakenAlong) {
  const test::TemporaryFolder folder;
  Calibration calibration;
  calibration.id = "monday";
  calibration.created_at = "2026-01-01T00:00:00Z";
  ASSERT_TRUE(WriteCalibration(calibration, folder / "calibration.json").ok());
  EXPECT_EQ(CalibrationOf(folder.path(), std::nullopt)->page, "");
  ASSERT_TRUE(WriteFileAtomically(folder / "calibration.html", "<html>monday</html>").ok());
  for (const std::optional<fs::path>& given :
       {std::optional<fs::path>(), std::optional(folder / "calibration.json")}) {
    const auto in_force = CalibrationOf(given ? "elsewhere" : folder.path(), given);
    ASSERT_TRUE(in_force.ok()) << in_force.error().ToString();
    EXPECT_EQ(in_force->calibration->id, "monday");
    EXPECT_EQ(in_force->page, "<html>monday</html>");
  }
}

TEST(ReconstructionJob, WhatFailsOrIsStoppedLeavesNothingBehind) {
  DaemonState state;
  AddNoise(state.store(), "x");
  const JobHandler handler = MakeReconstructionHandler(state.store(), 1);
  const JobRecord job = JobOf(state.store(), JobKind::kReconstruction, ReconstructionBody("x"));
  std::stop_source stop;
  for (const bool is_stopped : {false, true}) {
    if (is_stopped) stop.request_stop();
    JobContext context{stop.get_token(), nullptr};
    const auto result = handler.run(job, context);
    ASSERT_FALSE(result.ok());
    EXPECT_EQ(result.error().code == ErrorCode::kCancelled, is_stopped)
        << result.error().ToString();
    EXPECT_TRUE(fs::is_empty(state.folder() / "reconstructions"));
    EXPECT_TRUE(ListReconstructions(state.store(), "x")->empty());
  }
}

TEST(ReconstructionJob, ARunAgainKeepsTheIdOfTheFirst) {
  DaemonState state;
  AddNoise(state.store(), "x");
  const JobHandler handler = MakeReconstructionHandler(state.store(), 1);
  const JobRecord job = JobOf(state.store(), JobKind::kReconstruction, ReconstructionBody("x"));
  JobContext context{{}, nullptr};
  for (int run = 0; run < 2; ++run) {
    EXPECT_FALSE(handler.run(FindJob(state.store(), job.number).value(), context).ok());
    EXPECT_EQ(FindJob(state.store(), job.number)->product, "x-r1");
  }
  const JobRecord other = JobOf(state.store(), JobKind::kReconstruction, ReconstructionBody("x"));
  EXPECT_FALSE(handler.run(other, context).ok());
  EXPECT_EQ(FindJob(state.store(), other.number)->product, "x-r2") << "the first is reserved";
  // Killed between the folder and its row.
  PoseSet poses;
  poses.frameset = "x";
  poses.method = "plain";
  const fs::path folder = state.store().ReconstructionFolder("x-r1");
  fs::create_directories(folder);
  ASSERT_TRUE(WriteNewFile(folder / "poses.json", PoseSetToJson(poses)).ok());
  const auto made = handler.run(FindJob(state.store(), job.number).value(), context);
  ASSERT_TRUE(made.ok()) << made.error().ToString();
  EXPECT_NE(made->find("\"reconstruction\":\"x-r1\""), std::string::npos) << *made;
  EXPECT_TRUE(FindReconstruction(state.store(), "x-r1").ok());
}

TEST(CalibrationJob, ARunAgainFindsWhatTheFirstHadMade) {
  DaemonState state;
  AddNoise(state.store(), "x");
  const JobHandler handler = MakeCalibrationHandler(state.store(), {"board.toml", 1});
  const JobRecord job = JobOf(state.store(), JobKind::kCalibration, "{\"captures\":[\"x\"]}");
  ASSERT_TRUE(SetJobProduct(state.store(), job.number, "made").ok());
  Calibration calibration;
  calibration.created_at = "2026-01-01T00:00:00Z";
  test::WriteCalibrationFolder(state.store().CalibrationFolder("made"), calibration);
  JobContext context{{}, nullptr};
  const auto made = handler.run(FindJob(state.store(), job.number).value(), context);
  ASSERT_TRUE(made.ok()) << made.error().ToString();
  EXPECT_NE(made->find("\"calibration\":\"made\""), std::string::npos) << *made;
  EXPECT_TRUE(FindCalibration(state.store(), "made").ok());
}

TEST(CalibrationJob, TheRequestIsChecked) {
  DaemonState state;
  AddNoise(state.store(), "x");
  const JobHandler handler = MakeCalibrationHandler(state.store(), {"board.toml", 1});
  EXPECT_EQ(handler.check("{\"captures\": [\"x\"]}").value(),
            "{\"captures\":[\"x\"],\"model\":\"opencv\"}");
  EXPECT_EQ(handler.refers("{\"captures\": [\"x\", \"y\"]}").error().code, ErrorCode::kNotFound);
  EXPECT_EQ(handler.refers("{\"captures\": [\"x\"], \"compare\": \"none\"}").error().code,
            ErrorCode::kNotFound);
  EXPECT_NE(handler.check("{\"captures\": [\"x\", \"y\", \"x\"]}")
                .error()
                .ToString()
                .find("captures: capture \"x\" is named twice"),
            std::string::npos);
  for (const char* body :
       {"{}", "{\"captures\": []}", "{\"captures\": [\"x\", \"x\"]}", "{\"captures\": \"x\"}",
        "{\"captures\": [1]}", "{\"captures\": [\"x\"], \"model\": \"fish\"}",
        "{\"captures\": [\"x\"], \"board\": \"/etc/passwd\"}"}) {
    EXPECT_EQ(handler.check(body).error().code, ErrorCode::kInvalidArgument) << body;
  }
}

TEST(CalibrationJob, EveryLensModelHasItsName) {
  DaemonState state;
  const JobHandler handler = MakeCalibrationHandler(state.store(), {"board.toml", 1});
  for (const auto& [name, model] : rig::LensModelsByName()) {
    const std::string body = "{\"captures\":[\"x\"],\"model\":\"" + name + "\"}";
    EXPECT_TRUE(handler.check(body).ok()) << name;
  }
  const auto refused = handler.check("{\"captures\": [\"x\"], \"model\": \"fish\"}");
  EXPECT_NE(refused.error().ToString().find("\"full-opencv\", \"opencv\", \"opencv5\""),
            std::string::npos)
      << refused.error().ToString();
}

TEST(CalibrationJob, APictureWithoutABoardIsAReasonToFail) {
  DaemonState state;
  AddNoise(state.store(), "x");
  const JobHandler handler = MakeCalibrationHandler(
      state.store(), {fs::path(ROTUNDA_SOURCE_DIR) / "config/cuboid.toml", 1});
  const JobRecord job =
      JobOf(state.store(), JobKind::kCalibration, handler.check("{\"captures\":[\"x\"]}").value());
  JobContext context{{}, nullptr};
  const auto result = handler.run(job, context);
  ASSERT_FALSE(result.ok());
  EXPECT_FALSE(result.error().message.empty());
  EXPECT_TRUE(fs::is_empty(state.folder() / "calibrations"));
}

/// The calibration in force must not be what keeps the next one from being made.
TEST(CalibrationJob, IsNotKeptFromItsWorkByTheCalibrationInForce) {
  DaemonState state;
  Store& store = state.store();
  AddNoise(store, "x");
  const JobHandler handler =
      MakeCalibrationHandler(store, {fs::path(ROTUNDA_SOURCE_DIR) / "config/cuboid.toml", 1});
  const auto error_of = [&](const std::string& body) {
    JobContext context{{}, nullptr};
    const auto result = handler.run(JobOf(store, JobKind::kCalibration, body), context);
    return result.ok() ? "" : result.error().ToString();
  };
  const std::string body = "{\"captures\":[\"x\"]}";
  const std::string compare = "{\"captures\":[\"x\"],\"compare\":\"old\"}";
  const std::string no_board = error_of(body);
  ASSERT_NE(no_board, "");
  Calibration other_rig;
  other_rig.created_at = "2026-01-01T00:00:00Z";
  test::WriteCalibrationFolder(store.CalibrationFolder("old"), other_rig);
  ASSERT_TRUE(RecordCalibration(store, "old").ok());
  ASSERT_TRUE(ActivateCalibration(store, "old").ok());
  EXPECT_EQ(error_of(body), no_board);
  EXPECT_NE(error_of(compare), no_board) << "what was asked for is not left out";
  ASSERT_TRUE(WriteFileAtomically(store.CalibrationFolder("old") / "calibration.json", "{").ok());
  EXPECT_EQ(error_of(body), no_board);
  EXPECT_NE(error_of(compare).find("calibration.json"), std::string::npos) << error_of(compare);
}

/// Shots of the target by a small simulated rig.
class MadeCalibration : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new test::TemporaryFolder;
    ThreadPool pool(0);
    RunContext context{pool};
    sim::SimulateOptions options;
    options.target = sim::Target::kCuboid;
    options.background = sim::Background::kPlain;
    options.cameras = 4;
    options.picture_scale = 0.5;
    options.seed = 1;
    const Status made = sim::SimulatePlacements({}, options, 3, *folder_ / "shots", context);
    ASSERT_TRUE(made.ok()) << made.error().ToString();
  }
  static void TearDownTestSuite() { delete folder_; }

  static CalibrationTask Task() {
    CalibrationTask task;
    task.framesets = {*folder_ / "shots"};
    task.board = rig::CuboidBoard({});
    return task;
  }
  static EarlierCalibration Truth() {
    return {ReadCalibration(*folder_ / "shots/placement_00/truth.json").value(), "monday"};
  }
  static Result<CalibrationOutcome> Make(const CalibrationTask& task) {
    ThreadPool pool(0);
    RunContext context{pool};
    return MakeCalibration(task, context);
  }
  static bool Noted(const CalibrationOutcome& outcome, const std::string& text) {
    return std::any_of(outcome.notes.begin(), outcome.notes.end(), [&](const std::string& note) {
      return note.find(text) != std::string::npos;
    });
  }

  static test::TemporaryFolder* folder_;
};
test::TemporaryFolder* MadeCalibration::folder_ = nullptr;

TEST_F(MadeCalibration, IsNotRefusedForTheComparisonThatNobodyAskedFor) {
  CalibrationTask task = Task();
  task.compare = Truth();
  for (CalibratedCamera& camera : task.compare->calibration.cameras) camera.camera += "x";
  EXPECT_FALSE(Make(task).ok());
  task.compare_asked_for = false;
  task.not_compared = "the one in force cannot be read";
  const auto made = Make(task);
  ASSERT_TRUE(made.ok()) << made.error().ToString();
  EXPECT_EQ(made->calibration.cameras.size(), 4u);
  EXPECT_FALSE(made->comparison.has_value());
  EXPECT_TRUE(Noted(*made, "not compared with monday: "));
  EXPECT_TRUE(Noted(*made, "the one in force cannot be read"));
}

TEST_F(MadeCalibration, FromOneShotNeedsNoShotForTheFrame) {
  CalibrationTask task = Task();
  task.framesets = {*folder_ / "shots/placement_02"};
  task.board.rig_frame.shot = "simulated-1-placement-0";
  EXPECT_FALSE(Make(task).ok());
  task.intrinsics_from = Truth();
  const auto made = Make(task);
  ASSERT_TRUE(made.ok()) << made.error().ToString();
  EXPECT_EQ(made->result.frame, "the earlier calibration's");
}

TEST_F(MadeCalibration, NamesPicturesThatWereChangedAndCamerasThatAreMissing) {
  const fs::path shot = *folder_ / "changed";
  fs::copy(*folder_ / "shots/placement_02", shot, fs::copy_options::recursive);
  CalibrationTask task = Task();
  task.framesets = {shot};
  task.intrinsics_from = task.compare = Truth();
  const std::string camera = Truth().calibration.cameras[1].camera;
  fs::copy_file(shot / "frames" / (Truth().calibration.cameras[0].camera + ".png"),
                shot / "frames" / (camera + ".png"), fs::copy_options::overwrite_existing);
  const auto made = Make(task);
  ASSERT_TRUE(made.ok()) << made.error().ToString();
  EXPECT_TRUE(Noted(*made, camera + " in simulated-1-placement-2 was left out: cannot be read: the "
                                    "picture was changed after the capture"))
      << testing::PrintToString(made->notes);
  ASSERT_TRUE(made->comparison.has_value());
  EXPECT_EQ(made->comparison->not_calibrated, std::vector<std::string>{camera});
}

TEST(CalibrationIds, AreMadeOfTheTimeOfTheNewestShot) {
  EXPECT_EQ(CalibrationIdOf("2026-01-18T10:15:00Z"), "charuco-20260118T101500Z");
  EXPECT_EQ(CalibrationIdOf("2026-01-18T10:15:00.250Z"), "charuco-20260118T101500250Z");
}

}  // namespace
}  // namespace rotunda::daemon
