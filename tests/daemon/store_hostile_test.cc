// A database that somebody has changed by hand: whatever its rows name, nothing outside the state
// folder is read, served, written or removed.

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "daemon/api.h"
#include "daemon/reconstruction_request.h"
#include "daemon/retention.h"
#include "daemon/store_calibrations.h"
#include "daemon/store_captures.h"
#include "daemon/store_events.h"
#include "daemon/store_jobs.h"
#include "daemon/store_reconstructions.h"
#include "daemon/store_sql.h"
#include "sfm/core/pose_set.h"
#include "tests/support/daemon_state.h"
#include "tests/support/process.h"

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;
using test::DaemonState;

/// A capture "x", its reconstruction "x-r1", a calibration "c"; beside the state folder a folder
/// that looks like all of them and is none of the daemon's.
class HostileDatabase : public testing::Test {
 protected:
  HostileDatabase() : outside_(state_.folder().parent_path() / Victim()) {
    Populate(store().CaptureFolder("x"), store().ReconstructionFolder("x-r1"),
             store().CalibrationFolder("c"));
    EXPECT_TRUE(RecordCapture(store(), "x", std::nullopt).ok());
    EXPECT_TRUE(RecordReconstruction(store(), "x-r1").ok());
    EXPECT_TRUE(RecordCalibration(store(), "c").ok());
    Populate(outside_, outside_, outside_);
  }
  ~HostileDatabase() override {
    std::error_code ignored;
    fs::remove_all(outside_, ignored);
  }

  static void Populate(const fs::path& capture, const fs::path& reconstruction,
                       const fs::path& calibration) {
    test::WriteTinyFrameSet(capture, "2026-01-01T10:00:00Z");
    Calibration charuco;
    charuco.created_at = "2026-01-01T09:00:00Z";
    test::WriteCalibrationFolder(calibration, charuco);
    PoseSet poses;
    poses.frameset = "x";
    fs::create_directories(reconstruction);
    std::ofstream(reconstruction / "poses.json") << PoseSetToJson(poses);
    for (const char* file : {"report.html", "points.ply"}) {
      std::ofstream(reconstruction / file) << "secret";
    }
  }

  Store& store() { return state_.store(); }
  std::string Victim() const { return state_.folder().filename().string() + "-outside"; }
  /// As seen from captures/, calibrations/ or reconstructions/.
  std::string Way() const { return "../../" + Victim(); }

  void Execute(const std::string& sql) {
    const Status done =
        store().Write([&](Database& database, auto&) { return database.Execute(sql); });
    ASSERT_TRUE(done.ok()) << done.error().ToString();
  }
  /// A capture of this name, older than "x"; its only picture is `file`.
  void AddCapture(const std::string& id, const std::string& file) {
    Execute("INSERT INTO captures (id, captured_at, ok_frames, frames) VALUES ('" + id +
            "', '2020-01-01T00:00:00Z', 1, 1); INSERT INTO frames VALUES ('" + id +
            "', 'c0', 'S', '" + file + "', 'ok', '', 8, 8, '')");
  }
  void AddReconstruction(const std::string& id, const std::string& capture) {
    Execute("INSERT INTO reconstructions SELECT '" + id + "', '" + capture +
            "', calibration, '2030-01-01T00:00:00Z', method, registered, of_cameras, rms_px, "
            "'sure', verdict_reason, folded, used_for_drift, NULL, NULL, 0, preset, prior FROM "
            "reconstructions "
            "WHERE id = 'x-r1'");
  }
  void AddCalibration(const std::string& id) {
    Execute("INSERT INTO calibrations (id, created_at, source, cameras, active) VALUES ('" + id +
            "', '2026-01-01T00:00:00Z', 'charuco', 0, 1)");
  }

  std::vector<std::string> Everything() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::recursive_directory_iterator(outside_))
      names.push_back(entry.path());
    std::sort(names.begin(), names.end());
    return names;
  }
  void ExpectRefusedAtStart(const std::string& what) {
    state_.Close();
    const auto opened = state_.TryOpen();
    ASSERT_FALSE(opened.ok());
    EXPECT_EQ(opened.error().code, ErrorCode::kBadInput);
    for (const std::string& part : {what, std::string("rotunda.db"), std::string("backup")}) {
      EXPECT_NE(opened.error().ToString().find(part), std::string::npos)
          << opened.error().ToString();
    }
  }

  DaemonState state_;
  const fs::path outside_;
};

/// All reads that lead to files.
class HostileDatabaseApi : public HostileDatabase {
 protected:
  HostileDatabaseApi()
      : station_(CaptureStation::Options()),
        jobs_(store(), {Handler(), Handler(), Handler()}, JobQueue::Options()),
        router_(ApiRoutes({store(), jobs_, station_, "1", store().Now(), [] { return uint64_t{0}; },
                           [] { return HttpCounters(); }}),
                {}) {}
  static JobHandler Handler() {
    JobHandler handler;
    handler.check = [](const std::string& body) -> Result<std::string> { return body; };
    handler.run = [](const JobRecord&, JobContext&) -> Result<std::string> {
      return std::string("{}");
    };
    return handler;
  }

  HttpResponse Call(const std::string& method, const std::string& target) {
    HttpResponse answer = router_.Handle({method, target, {}, "", {1000, 1, Role::kOperator}});
    return answer.bulk ? answer.bulk() : answer;
  }
  /// An answer that is made of nothing that lies outside.
  void ExpectRefused(const std::string& target) {
    const HttpResponse answer = Call("GET", target);
    EXPECT_EQ(answer.status, 500) << target << answer.body;
    EXPECT_EQ(answer.content_type, "application/problem+json") << target;
    EXPECT_FALSE(answer.file) << target << *answer.file;
    EXPECT_NE(answer.body.find("database: "), std::string::npos) << answer.body;
  }

  CaptureStation station_;
  JobQueue jobs_;
  Router router_;
};

TEST_F(HostileDatabaseApi, APictureIsServedFromItsCapturesFolderAlone) {
  test::WriteTinyFrameSet(store().CaptureFolder("y"), "2026-01-02T10:00:00Z");
  ASSERT_TRUE(RecordCapture(store(), "y", std::nullopt).ok());
  const std::string picture = "/v1/captures/x/frames/c0.png";
  ASSERT_EQ(Call("GET", picture).file, store().CaptureFolder("x") / "frames/c0.png");
  for (const std::string& file : std::vector<std::string>{
           "../" + Victim() + "/frames/c0.png",
           "captures/x/../../../" + Victim() + "/frames/c0.png", "captures/x/frames/..",
           (outside_ / "frames/c0.png").string(), "/etc/passwd", "captures/y/frames/c0.png",
           "captures/xy", "rotunda.db", "captures/x", "."}) {
    Execute("UPDATE frames SET file = '" + file + "' WHERE capture = 'x'");
    ExpectRefused(picture);
    ExpectRefused("/v1/captures/x");
  }
  Execute("UPDATE frames SET file = 'captures/x/frames/c0.png' || char(0) || '.png'");
  ExpectRefused(picture);
  Execute("UPDATE frames SET file = ''");
  EXPECT_EQ(Call("GET", picture).status, 404);
}

TEST_F(HostileDatabaseApi, AReconstructionThatIsElsewhereIsNotServed) {
  AddReconstruction(Way(), "x");
  for (const char* what :
       {"", "/poses", "/report", "/export?format=ply", "/export?format=colmap"}) {
    ExpectRefused("/v1/captures/x" + std::string(what));
  }
  ExpectRefused("/v1/captures");
}

TEST_F(HostileDatabaseApi, ACalibrationThatIsElsewhereIsNotRead) {
  AddCalibration(Way());
  ExpectRefused("/v1/status");
  ExpectRefused("/v1/calibrations");
  ExpectRefused("/v1/drift");
  EXPECT_FALSE(ActiveCalibration(store()).ok());
}

TEST_F(HostileDatabase, RetentionRemovesNothingElsewhere) {
  const std::vector<std::string> before = Everything();
  const RetentionPolicy newest{1, std::nullopt};
  for (const std::string& id : {Way(), outside_.string(), std::string(".."), std::string(".")}) {
    AddCapture(id, "captures/x/frames/c0.png");
    EXPECT_EQ(ApplyRetention(store(), newest).error().code, ErrorCode::kBadInput) << id;
    Execute("DELETE FROM captures WHERE id = '" + id + "'");
  }
  // A capture that goes, with reconstructions that are not where they say.
  test::WriteTinyFrameSet(store().CaptureFolder("old"), "2020-01-01T00:00:00Z");
  ASSERT_TRUE(RecordCapture(store(), "old", std::nullopt).ok());
  for (const std::string& id : {Way(), outside_.string(), std::string("..")}) {
    AddReconstruction(id, "old");
    EXPECT_EQ(ApplyRetention(store(), newest).error().code, ErrorCode::kBadInput) << id;
    Execute("DELETE FROM reconstructions WHERE id = '" + id + "'");
  }
  EXPECT_EQ(Everything(), before);
  EXPECT_TRUE(fs::exists(store().CaptureFolder("x") / "frames/c0.png"));
  EXPECT_EQ(*ApplyRetention(store(), newest), std::vector<std::string>{"old"});
}

/// A folder that is a link to another place goes as a link.
TEST_F(HostileDatabase, RetentionRemovesALinkAndNotWhatItLeadsTo) {
  fs::create_directory_symlink(outside_, store().CaptureFolder("old"));
  Execute(
      "INSERT INTO captures (id, captured_at, ok_frames, frames) VALUES "
      "('old', '2020-01-01T00:00:00Z', 0, 0)");
  const std::vector<std::string> before = Everything();
  EXPECT_EQ(*ApplyRetention(store(), {1, std::nullopt}), std::vector<std::string>{"old"});
  EXPECT_FALSE(fs::is_symlink(store().CaptureFolder("old")));
  EXPECT_EQ(Everything(), before);
}

TEST_F(HostileDatabase, IsRefusedAtTheNextStartAndNothingIsTouched) {
  const std::vector<std::string> before = Everything();
  AddCapture(Way(), "");
  ExpectRefusedAtStart(Way());
  EXPECT_EQ(Everything(), before);
}

TEST_F(HostileDatabase, AReconstructionElsewhereIsRefusedAtTheNextStart) {
  AddReconstruction(Way(), "x");
  ExpectRefusedAtStart(Way());
}

TEST_F(HostileDatabase, ACalibrationElsewhereIsRefusedAtTheNextStart) {
  AddCalibration(outside_);
  ExpectRefusedAtStart(outside_);
}

/// A job's reserved name is where its work is written.
TEST_F(HostileDatabase, AJobThatWouldWriteElsewhereIsRefusedAtTheNextStart) {
  ASSERT_TRUE(AddJob(store(), {JobKind::kReconstruction, ReconstructionBody("x"), ""}).ok());
  Execute("UPDATE jobs SET product = '" + Way() + "'");
  EXPECT_EQ(FindJob(store(), 1).error().code, ErrorCode::kBadInput);
  EXPECT_EQ(TakeJob(store(), {JobKind::kReconstruction}).error().code, ErrorCode::kBadInput);
  ExpectRefusedAtStart(Way());
}

/// Bytes of the file changed at random: refused with the reason, or read as far as that goes.
TEST_F(HostileDatabase, RandomDamageIsRefusedOrRead) {
  constexpr uint64_t kSeed = 11;
  constexpr int kDamages = 100;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  ASSERT_TRUE(AddJob(store(), {JobKind::kReconstruction, ReconstructionBody("x"), ""}).ok());
  const std::vector<std::string> outside = Everything();
  state_.Close();
  const fs::path file = state_.folder() / "rotunda.db";
  std::ifstream in(file, std::ios::binary);
  const std::string whole(std::istreambuf_iterator<char>(in), {});
  std::mt19937_64 random(kSeed);
  int refused = 0;
  for (int i = 0; i < kDamages; ++i) {
    std::string damaged = whole;
    for (uint64_t changes = 1 + random() % 20; changes > 0; --changes) {
      damaged[random() % damaged.size()] = static_cast<char>(random());
    }
    for (const char* beside : {"-wal", "-shm"}) fs::remove(file.string() + beside);
    std::ofstream(file, std::ios::binary) << damaged;
    const auto opened = state_.TryOpen();
    refused += !opened;
    if (!opened) {
      EXPECT_NE(opened.error().ToString().find("rotunda.db"), std::string::npos)
          << opened.error().ToString();
      continue;
    }
    Store& read = **opened;
    static_cast<void>(ListCaptures(read, {}));
    static_cast<void>(ListFrames(read, "x"));
    static_cast<void>(ListCalibrations(read, {}));
    static_cast<void>(ListReconstructions(read, "x"));
    static_cast<void>(ListJobs(read, {}, std::nullopt));
    static_cast<void>(ListEvents(read, 0, 100));
    static_cast<void>(DriftNow(read));
    static_cast<void>(ApplyRetention(read, {1, std::nullopt}));
  }
  EXPECT_GT(refused, 0);
  EXPECT_EQ(Everything(), outside);
  EXPECT_TRUE(fs::exists(state_.folder() / "captures/x/frames/c0.png"));
}

}  // namespace
}  // namespace rotunda::daemon
