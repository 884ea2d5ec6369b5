#include "daemon/store.h"

#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <set>
#include <thread>
#include <utility>
#include <vector>

#include "daemon/events.h"
#include "daemon/migrations.h"
#include "daemon/store_calibrations.h"
#include "daemon/store_captures.h"
#include "daemon/store_events.h"
#include "daemon/store_jobs.h"
#include "daemon/store_reconstructions.h"
#include "sfm/core/pose_set.h"
#include "tests/support/as_nobody.h"
#include "tests/support/daemon_state.h"

namespace {

/// Looks at what is made durable while it lives; one at a time.
struct SyncsSeen {
  explicit SyncsSeen(std::filesystem::path of) : file(std::move(of)) { looking = this; }
  ~SyncsSeen() { looking = nullptr; }
  const std::filesystem::path file;
  bool folder_once_there = false;  // the folder of `file`, when that had its name
  static inline SyncsSeen* looking = nullptr;
};

}  // namespace

extern "C" int fsync(int fd) {
  std::error_code ignored;
  if (SyncsSeen* const seen = SyncsSeen::looking; seen != nullptr) {
    const auto synced =
        std::filesystem::read_symlink("/proc/self/fd/" + std::to_string(fd), ignored);
    seen->folder_once_there |=
        synced == seen->file.parent_path() && std::filesystem::exists(seen->file, ignored);
  }
  return static_cast<int>(syscall(SYS_fsync, fd));
}

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;
using test::DaemonState;
using test::WriteTinyFrameSet;

/// What `sql` does to a database from outside.
void RunSql(const fs::path& file, const std::string& sql) {
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(file.c_str(), &database), SQLITE_OK);
  char* problem = nullptr;
  EXPECT_EQ(sqlite3_exec(database, sql.c_str(), nullptr, nullptr, &problem), SQLITE_OK) << problem;
  sqlite3_close(database);
}

Calibration OneCamera() {
  Calibration calibration;
  calibration.created_at = "2026-01-01T00:00:00Z";
  CalibratedCamera& camera = calibration.cameras.emplace_back();
  camera.camera = "c0";
  camera.intrinsics = {CameraModel::kPinhole, 8, 8, {100, 100, 4, 4}};
  return calibration;
}

TEST(StoreIds, CannotLeaveTheirFolder) {
  for (const char* fine : {"20261122T230501Z", "20261122T230501Z-2", "charuco-1", "a.b_c"}) {
    EXPECT_TRUE(IsStoreId(fine)) << fine;
  }
  for (const char* bad : {"", ".", "..", ".hidden", "a/b", "../a", "a b", "-a", "a\n", "%2e"}) {
    EXPECT_FALSE(IsStoreId(bad)) << bad;
  }
  EXPECT_FALSE(IsStoreId(std::string(101, 'a')));
  EXPECT_FALSE(IsStoreId(std::string_view("a\0b", 3)));
}

TEST(StoreTime, HasMilliseconds) {
  EXPECT_EQ(
      TimeText(std::chrono::system_clock::time_point(std::chrono::milliseconds(1767225600007))),
      "2026-01-01T00:00:00.007Z");
}

TEST(Store, KeepsACaptureOverARestart) {
  DaemonState state;
  const std::string id = FreeCaptureId(state.store()).value();
  EXPECT_TRUE(IsStoreId(id));
  WriteTinyFrameSet(state.store().CaptureFolder(id), "2026-01-01T00:00:05.123Z", 3);
  ASSERT_TRUE(RecordCapture(state.store(), id, std::nullopt).ok());
  ASSERT_TRUE(RecordCapture(state.store(), id, std::nullopt).ok()) << "a second time";

  state.Reopen();
  EXPECT_TRUE(state.store().recovery().adopted.empty());
  const auto found = FindCapture(state.store(), id);
  ASSERT_TRUE(found.ok());
  EXPECT_EQ(found->captured_at, "2026-01-01T00:00:05.123Z");
  EXPECT_EQ(found->ok_frames, 3u);
  const auto frames = ListFrames(state.store(), id);
  ASSERT_TRUE(frames.ok());
  ASSERT_EQ(frames->size(), 3u);
  EXPECT_EQ((*frames)[2].file, "captures/" + id + "/frames/c2.png");
  EXPECT_EQ((*frames)[2].xxh3, "0123456789abcdef");
  EXPECT_NE(FreeCaptureId(state.store()).value(), id);
}

/// What the store says that is opened by nobody.
std::string OpenedAsNobody(DaemonState& state) {
  std::string said;
  test::AsNobody([&] {
    const auto opened = state.TryOpen();
    said = opened ? "nothing" : opened.error().ToString();
  });
  return said;
}

TEST(Store, SaysWhoseAFolderOrFileIsThatItCannotWrite) {
  DaemonState state;
  state.Close();
  const auto allow = [](const fs::path& place, unsigned bits) {
    fs::permissions(place, fs::perms(bits));
  };
  allow(state.folder(), 0777);
  for (const auto& entry : fs::directory_iterator(state.folder())) allow(entry, 0777);
  EXPECT_EQ(OpenedAsNobody(state), "nothing");
  for (const char* name :
       {"", "captures", "calibrations", "reconstructions", "lock", "rotunda.db"}) {
    const fs::path place = *name == '\0' ? state.folder() : state.folder() / name;
    allow(place, 0555);
    const std::string said = OpenedAsNobody(state);
    allow(place, 0777);
    EXPECT_TRUE(said.starts_with(place.string() + ": cannot be written: Permission denied; "))
        << said;
    EXPECT_NE(said.find(", mode 0555, "), std::string::npos) << said;
    EXPECT_NE(said.find(": chown "), std::string::npos) << said;
    EXPECT_EQ(said.find('\n'), std::string::npos) << said;
  }
}

TEST(Store, SaysWhatIsNotThere) {
  DaemonState state;
  EXPECT_EQ(FindCapture(state.store(), "../etc").error().code, ErrorCode::kNotFound);
  EXPECT_EQ(ListFrames(state.store(), "nothing").error().code, ErrorCode::kNotFound);
  EXPECT_EQ(FindJob(state.store(), 7).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(ActivateCalibration(state.store(), "../c").error().code, ErrorCode::kNotFound);
  EXPECT_EQ(ListCaptures(state.store(), {10, "nothing"}).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(ListCaptures(state.store(), {0, ""}).error().code, ErrorCode::kInvalidArgument);
  EXPECT_EQ(ListCaptures(state.store(), {501, ""}).error().code, ErrorCode::kInvalidArgument);
}

TEST(Store, AdoptsWhatACrashLeftAndRemovesHalfWrittenFolders) {
  DaemonState state;
  state.Close();
  WriteTinyFrameSet(state.folder() / "captures/orphan", "2026-01-01T00:00:00Z");
  WriteTinyFrameSet(state.folder() / "captures/.killed.tmp-123-0", "2026-01-01T00:00:00Z");
  test::WriteCalibrationFolder(state.folder() / "calibrations/found", OneCamera());
  fs::create_directories(state.folder() / "captures/rubbish");

  Store& store = state.Reopen();
  EXPECT_EQ(store.recovery().adopted,
            (std::vector<std::string>{"calibrations/found", "captures/orphan"}));
  EXPECT_EQ(store.recovery().removed_temporaries, 1u);
  ASSERT_EQ(store.recovery().unreadable.size(), 1u);
  EXPECT_NE(store.recovery().unreadable[0].find("captures/rubbish"), std::string::npos);
  EXPECT_TRUE(fs::exists(state.folder() / "captures/rubbish"));
  EXPECT_FALSE(fs::exists(state.folder() / "captures/.killed.tmp-123-0"));
  EXPECT_EQ(FindCapture(store, "orphan")->frames, 2u);
  EXPECT_EQ(FindCalibration(store, "found")->cameras, 1u);
}

/// reconstructions/<capture>-r<number>, written at `time`.
void WriteReconstructionFolder(const fs::path& state_folder, const std::string& capture, int number,
                               std::chrono::sys_seconds time) {
  PoseSet poses;
  poses.frameset = capture;
  poses.method = "plain";
  const fs::path folder =
      state_folder / "reconstructions" / (capture + "-r" + std::to_string(number));
  fs::create_directories(folder);
  ASSERT_TRUE(WriteNewFile(folder / "poses.json", PoseSetToJson(poses)));
  fs::last_write_time(folder / "poses.json", std::chrono::file_clock::from_sys(time));
}

TEST(Store, AdoptsReconstructionsInTheOrderOfTheirNumbersWithTheirOwnTime) {
  using namespace std::chrono_literals;
  constexpr int kFound = 11;
  const std::chrono::sys_seconds made = std::chrono::sys_days(2025y / 12 / 31) + 10h;
  DaemonState state;
  state.Close();
  WriteTinyFrameSet(state.folder() / "captures/x", "2025-12-31T09:00:00Z");
  std::vector<std::string> oldest_first = {"captures/x"};
  for (int number = 1; number <= kFound; ++number) {
    WriteReconstructionFolder(state.folder(), "x", number, made);
    oldest_first.push_back("reconstructions/x-r" + std::to_string(number));
  }
  Store& store = state.Reopen();
  EXPECT_EQ(store.recovery().adopted, oldest_first);
  // A page at a time, as a client reads them; of all that are alike the newest speaks.
  std::vector<std::string> newest_first;
  Page page{4, ""};
  do {
    const auto listing = ListReconstructions(store, "x", page);
    ASSERT_TRUE(listing.ok()) << listing.error().ToString();
    for (const ReconstructionRecord& record : listing->items) {
      EXPECT_EQ(record.created_at, "2025-12-31T10:00:00.000Z") << record.id;
      newest_first.push_back("reconstructions/" + record.id);
    }
    page.after = listing->next;
  } while (!page.after.empty());
  newest_first.emplace_back("captures/x");
  EXPECT_EQ(newest_first, std::vector<std::string>(oldest_first.rbegin(), oldest_first.rend()));
  EXPECT_EQ(ListReconstructions(store, "x")->front().id, "x-r11");
  EXPECT_EQ(FindCapture(store, "x")->reconstruction, "x-r11");
}

TEST(Store, AReconstructionWhoseFileIsOfATimeToComeIsOfNow) {
  using namespace std::chrono_literals;
  DaemonState state;
  state.Close();
  WriteTinyFrameSet(state.folder() / "captures/x", "2025-12-31T09:00:00Z");
  WriteReconstructionFolder(state.folder(), "x", 1, std::chrono::sys_days(2100y / 1 / 1));
  Store& store = state.Reopen();
  const auto found = FindReconstruction(store, "x-r1");
  ASSERT_TRUE(found.ok()) << found.error().ToString();
  EXPECT_LT(found->created_at, store.Now());
}

TEST(Store, AdoptsManyFoldersTogetherAndSaysThatItIsStillAtIt) {
  constexpr int kFound = 250;
  DaemonState state;
  state.Close();
  for (int i = 0; i < kFound; ++i) {
    const std::string name = "x" + std::to_string(1000 + i);
    WriteTinyFrameSet(state.folder() / "captures" / name, "2026-01-01T00:00:00Z", 1);
  }
  fs::create_directories(state.folder() / "captures/x1050-rubbish");
  std::vector<EventRecord> heard;
  auto subscription =
      state.hub().Subscribe([&](const EventRecord& event) { heard.push_back(event); });
  int signs = 0;
  StoreOptions options{state.folder(), state.clock().Source(), {}};
  options.still_opening = [&signs] { ++signs; };
  const auto store = Store::Open(options, state.hub());
  ASSERT_TRUE(store.ok()) << store.error().ToString();
  EXPECT_EQ((*store)->recovery().adopted.size(), size_t{kFound});
  EXPECT_EQ((*store)->recovery().unreadable.size(), 1u);
  EXPECT_GE(signs, 3);
  EXPECT_EQ(ListCaptures(**store, {500, ""})->items.size(), size_t{kFound});
  const auto stored = ListEvents(**store, 0, 1000);
  ASSERT_EQ(stored->size(), size_t{2 * kFound}) << "stored and adopted, of each";
  ASSERT_EQ(heard.size(), stored->size());
  for (size_t i = 0; i < heard.size(); ++i) {
    EXPECT_EQ(heard[i].number, (*stored)[i].number);
    EXPECT_EQ(heard[i].about, (*stored)[i].about);
  }
}

TEST(Store, WritesTogetherAreAllOrNothingAndSoIsEach) {
  DaemonState state;
  Store& store = state.store();
  const auto add = [&](const std::string& body) {
    return AddJob(store, {JobKind::kCapture, body, ""}).ok();
  };
  const Status failed = Error{ErrorCode::kFailed, "no", ""};
  EXPECT_FALSE(store.WriteTogether([&] {
    EXPECT_TRUE(add("one"));
    EXPECT_EQ(ListJobs(store, {})->items.size(), 1u) << "is seen within";
    return failed;
  }));
  EXPECT_TRUE(ListJobs(store, {})->items.empty());
  EXPECT_EQ(LastEventNumber(store).value(), 0);
  EXPECT_TRUE(store.WriteTogether([&] {
    EXPECT_TRUE(add("two"));
    EXPECT_FALSE(store.Write([&](Database& database, auto&) {
      EXPECT_TRUE(database.Execute("DELETE FROM jobs"));
      return failed;
    }));
    EXPECT_TRUE(add("three"));
    return Status();
  }));
  EXPECT_EQ(ListJobs(store, {})->items.size(), 2u);
  EXPECT_EQ(ListEvents(store, 0, 10)->size(), 2u);
}

TEST(Store, MarksCapturesWhoseFilesAreGoneUntilTheyAreBack) {
  DaemonState state;
  const fs::path folder = state.store().CaptureFolder("a");
  WriteTinyFrameSet(folder, "2026-01-01T00:00:00Z");
  ASSERT_TRUE(RecordCapture(state.store(), "a", std::nullopt).ok());
  fs::rename(folder, state.folder() / "elsewhere");
  EXPECT_EQ(state.Reopen().recovery().gone, std::vector<std::string>{"captures/a"});
  EXPECT_TRUE(FindCapture(state.store(), "a")->files_gone);
  fs::rename(state.folder() / "elsewhere", folder);
  EXPECT_TRUE(state.Reopen().recovery().gone.empty());
  EXPECT_FALSE(FindCapture(state.store(), "a")->files_gone);
}

TEST(Store, HasOneCalibrationInForce) {
  DaemonState state;
  for (const char* id : {"one", "two"}) {
    test::WriteCalibrationFolder(state.store().CalibrationFolder(id), OneCamera());
    ASSERT_TRUE(RecordCalibration(state.store(), id).ok());
  }
  EXPECT_FALSE(ActiveCalibration(state.store())->has_value());
  EXPECT_TRUE(ActivateCalibration(state.store(), "one")->active);
  EXPECT_TRUE(ActivateCalibration(state.store(), "two")->active);
  state.Reopen();
  EXPECT_EQ((*ActiveCalibration(state.store()))->id, "two");
  EXPECT_FALSE(FindCalibration(state.store(), "one")->active);
  EXPECT_EQ(FreeCalibrationId(state.store(), "one").value(), "one-2");
  EXPECT_EQ(ListCalibrations(state.store(), {})->items.size(), 2u);
}

TEST(Store, WritesAheadSyncsFullyAndKeepsReferences) {
  DaemonState state;
  ASSERT_TRUE(state.store()
                  .Write([](Database& database, auto&) -> Status {
                    Statement mode = database.Prepare("PRAGMA journal_mode");
                    EXPECT_TRUE(mode.Step());
                    EXPECT_EQ(mode.Text(), "wal");
                    EXPECT_EQ(*database.Number("PRAGMA synchronous"), 2) << "FULL";
                    EXPECT_EQ(*database.Number("PRAGMA foreign_keys"), 1);
                    return {};
                  })
                  .ok());
  EXPECT_FALSE(state.store()
                   .Write([](Database& database, auto&) {
                     return database.Execute(
                         "INSERT INTO frames VALUES ('none', 'c0', '', '', 'ok', '', 8, 8, '')");
                   })
                   .ok())
      << "a frame of no capture";
}

TEST(Store, RefusesASecondDaemon) {
  DaemonState state;
  const auto second = state.TryOpen();
  ASSERT_FALSE(second.ok());
  EXPECT_NE(second.error().message.find("another rotundad"), std::string::npos);
}

TEST(StoreSchema, RefusesDatabasesOfOthersAndOfTheFuture) {
  DaemonState state;
  state.Close();
  const fs::path file = state.folder() / "rotunda.db";
  RunSql(file, "PRAGMA user_version = 1000");
  auto opened = state.TryOpen();
  ASSERT_FALSE(opened.ok());
  EXPECT_NE(opened.error().message.find("schema version 1000, this rotundad knows 1 to "),
            std::string::npos);
  RunSql(file, "PRAGMA user_version = " + std::to_string(SchemaSteps().size()));
  EXPECT_TRUE(state.TryOpen().ok());

  RunSql(file, "PRAGMA application_id = 252006675");
  opened = state.TryOpen();
  ASSERT_FALSE(opened.ok());
  EXPECT_NE(opened.error().message.find("another program (application id 0x0f055113"),
            std::string::npos)
      << opened.error().message;

  fs::remove(file);
  RunSql(file, "CREATE TABLE images(name TEXT)");
  opened = state.TryOpen();
  ASSERT_FALSE(opened.ok());
  EXPECT_NE(opened.error().message.find("another program"), std::string::npos);
}

TEST(StoreSchema, TakesAnOldDatabaseThroughTheMissingSteps) {
  const test::TemporaryFolder folder;
  const std::vector<std::string_view> steps = {"CREATE TABLE a(x INTEGER)",
                                               "ALTER TABLE a ADD COLUMN y INTEGER DEFAULT 4"};
  auto database = Database::Open(folder / "m.db", Database::Access::kReadWrite);
  ASSERT_TRUE(database.ok());
  ASSERT_TRUE(Migrate(*database, {steps.data(), 1}).ok());
  ASSERT_TRUE(database->Execute("INSERT INTO a VALUES (1)").ok());
  ASSERT_TRUE(Migrate(*database, steps).ok());
  ASSERT_TRUE(Migrate(*database, steps).ok()) << "nothing to do";
  EXPECT_EQ(database->Number("SELECT x + y FROM a").value(), 5);
  EXPECT_EQ(database->Number("PRAGMA user_version").value(), 2);

  const std::vector<std::string_view> broken = {steps[0], steps[1],
                                                "CREATE TABLE b(z); INSERT INTO nowhere VALUES(1)"};
  EXPECT_FALSE(Migrate(*database, broken).ok());
  EXPECT_EQ(database->Number("PRAGMA user_version").value(), 2);
  EXPECT_EQ(database->Number("SELECT count(*) FROM sqlite_schema WHERE name = 'b'").value(), 0);
}

/// How SQLite answers the query: "SEARCH jobs USING COVERING INDEX ...".
std::string PlanOf(Store& store, const std::string& query) {
  std::string plan;
  EXPECT_TRUE(store.Read([&](Database& database) {
    Statement row = database.Prepare("EXPLAIN QUERY PLAN " + query);
    if (row.Step()) {
      for (int skipped = 0; skipped < 3; ++skipped) row.Int();
      plan = row.Text();
    }
    return row.status();
  }));
  return plan;
}

TEST(StoreSchema, ADatabaseOfTheFirstVersionGetsWhatCameLater) {
  const test::TemporaryFolder old;
  {
    auto database = Database::Open(old / "rotunda.db", Database::Access::kReadWrite);
    ASSERT_TRUE(database.ok());
    ASSERT_TRUE(Migrate(*database, SchemaSteps().first(1)).ok());
    ASSERT_TRUE(database
                    ->Execute("INSERT INTO jobs (kind, state, body, product, created_at) VALUES "
                              "('capture', 'done', '{}', 'x', '2026-01-01T00:00:00.000Z')")
                    .ok());
    ASSERT_TRUE(database
                    ->Execute("INSERT INTO calibrations (id, created_at, source, cameras, active) "
                              "VALUES ('now', '2026-01-01T00:00:00.000Z', 'charuco', 1, 1);"
                              "INSERT INTO captures (id, captured_at, ok_frames, frames) VALUES "
                              "('x', '2026-01-01T00:00:00.000Z', 0, 1);"
                              "INSERT INTO reconstructions (id, capture, created_at, method, "
                              "registered, of_cameras, rms_px, verdict, verdict_reason, folded, "
                              "used_for_drift) VALUES ('x-r1', 'x', '2026-01-01T00:00:00.000Z', "
                              "'tc-sfm', 0, 1, 0, 'sure', '', 0, 1);"
                              "INSERT INTO frames VALUES ('x', 'c0', 'S', '', 'missing', '', 8, 8);"
                              "INSERT INTO drift VALUES ('now', 'c0', '2026-01-01T00:00:00.000Z', "
                              "'x', 'x-r1', 0, 0, NULL, NULL, 0, NULL), ('now', 'c0', "
                              "'2026-01-02T00:00:00.000Z', 'y', 'y-r1', 1, 9, NULL, NULL, 1, NULL)")
                    .ok());
  }
  EventHub hub;
  const auto store =
      Store::Open({old.path(), [] { return std::chrono::system_clock::time_point(); }, {}}, hub);
  ASSERT_TRUE(store.ok()) << store.error().ToString();
  EXPECT_EQ(FindJob(**store, 1)->product, "x");
  EXPECT_NE(PlanOf(**store, "SELECT * FROM jobs WHERE product = 'x'").find("jobs_by_product"),
            std::string::npos);
  EXPECT_NE(
      PlanOf(**store, "SELECT 1 FROM jobs WHERE kind = 'a' AND body = 'b'").find("jobs_by_body"),
      std::string::npos);
  const auto frames = ListFrames(**store, "x");
  ASSERT_TRUE(frames.ok()) << frames.error().ToString();
  EXPECT_EQ(frames->at(0).status, "missing");
  EXPECT_EQ(frames->at(0).reason, "");
  EXPECT_EQ(FindCalibration(**store, "now")->made_from, "");
  const auto reconstruction = FindReconstruction(**store, "x-r1");
  ASSERT_TRUE(reconstruction.ok()) << reconstruction.error().ToString();
  EXPECT_EQ(reconstruction->preset, "rig");
  EXPECT_EQ(reconstruction->prior, "none");
  const auto drift = DriftNow(**store);
  ASSERT_TRUE(drift.ok()) << drift.error().ToString();
  ASSERT_EQ(drift->size(), 1u);
  EXPECT_EQ(drift->at(0).beyond, 1u);
  EXPECT_EQ(drift->at(0).latest.capture, "y");
  EXPECT_TRUE(UnregisteredNow(**store)->empty());
}

/// With thousands of captures the status asks for it for every camera.
TEST(StoreSchema, HowLongACameraHasBeenBeyondItsLimitIsCountedInAnIndex) {
  DaemonState state;
  const std::string of_camera = " FROM drift WHERE calibration = 'a' AND camera = 'b' AND ";
  EXPECT_NE(PlanOf(state.store(), "SELECT captured_at, capture" + of_camera +
                                      "beyond_limit = 0 ORDER BY captured_at DESC, capture DESC")
                .find("COVERING INDEX drift_by_limit"),
            std::string::npos);
  EXPECT_NE(PlanOf(state.store(), "SELECT count(*)" + of_camera +
                                      "beyond_limit = 1 AND (captured_at, capture) > ('c', 'd')")
                .find("COVERING INDEX drift_by_limit"),
            std::string::npos);
}

TEST(StoreSchema, RefusesADamagedFileAndSaysWhatToDo) {
  DaemonState state;
  for (int i = 0; i < 20; ++i) {
    const std::string id = "x" + std::to_string(i);
    WriteTinyFrameSet(state.store().CaptureFolder(id), "2026-01-01T00:00:00Z", 20);
    ASSERT_TRUE(RecordCapture(state.store(), id, std::nullopt).ok());
  }
  state.Close();
  const fs::path file = state.folder() / "rotunda.db";
  const std::string whole = ReadFile(file).value();
  for (const size_t from : {size_t{0}, whole.size() / 2}) {
    std::string damaged = whole;
    for (size_t i = from; i < from + 9000 && i < damaged.size(); ++i) damaged[i] ^= 0x5A;
    std::ofstream(file, std::ios::binary | std::ios::trunc) << damaged;
    const auto opened = state.TryOpen();
    ASSERT_FALSE(opened.ok()) << "damaged from byte " << from;
    EXPECT_NE(opened.error().message.find("is damaged"), std::string::npos)
        << opened.error().ToString();
    EXPECT_NE(opened.error().message.find("backup"), std::string::npos);
    EXPECT_EQ(ReadFile(file).value(), damaged) << "must be left as it is";
  }
  // What the message says to do.
  fs::rename(file, state.folder() / "away.db");
  EXPECT_EQ(state.Reopen().recovery().adopted.size(), 20u);
}

TEST(Store, MakesABackupWhileItIsUsed) {
  DaemonState state;
  WriteTinyFrameSet(state.store().CaptureFolder("a"), "2026-01-01T00:00:00Z");
  ASSERT_TRUE(RecordCapture(state.store(), "a", std::nullopt).ok());
  const fs::path copy = state.folder() / "copy.db";
  ASSERT_TRUE(BackUpStore(state.folder(), copy).ok());
  EXPECT_EQ(BackUpStore(state.folder(), copy).error().code, ErrorCode::kAlreadyExists);
  WriteTinyFrameSet(state.store().CaptureFolder("b"), "2026-01-01T00:00:01Z");
  ASSERT_TRUE(RecordCapture(state.store(), "b", std::nullopt).ok());

  auto database = Database::Open(copy, Database::Access::kReadWrite);
  ASSERT_TRUE(database.ok());
  EXPECT_EQ(database->Number("SELECT count(*) FROM captures").value(), 1);
  EXPECT_EQ(database->Number("SELECT count(*) FROM frames").value(), 2);
  EXPECT_EQ(BackUpStore(state.folder() / "nothing", state.folder() / "b.db").error().code,
            ErrorCode::kNotFound);

  // Put in the database's place it is a database; what came after it is found on the disk.
  state.Close();
  for (const char* name : {"rotunda.db", "rotunda.db-wal", "rotunda.db-shm"}) {
    fs::remove(state.folder() / name);
  }
  fs::rename(copy, state.folder() / "rotunda.db");
  EXPECT_EQ(state.Reopen().recovery().adopted, std::vector<std::string>{"captures/b"});
}

TEST(Store, ABackupIsItsOwnersAloneAndDurable) {
  DaemonState state;
  const fs::path folder = state.folder() / "backups", copy = folder / "copy.db";
  fs::create_directory(folder);
  const mode_t before = umask(0);
  SyncsSeen seen(copy);
  const Status copied = BackUpStore(state.folder(), copy);
  umask(before);
  ASSERT_TRUE(copied.ok()) << copied.error().ToString();
  EXPECT_EQ(fs::status(copy).permissions(), fs::perms::owner_read | fs::perms::owner_write);
  EXPECT_TRUE(seen.folder_once_there) << "a power cut could take the name away";
}

TEST(Store, BackupsAtTheSameTimeDoNotDisturbEachOther) {
  DaemonState state;
  const fs::path folder = state.folder() / "backups", copy = folder / "copy.db";
  fs::create_directory(folder);
  std::vector<std::optional<Error>> refusals(8);
  {
    std::vector<std::jthread> threads;
    for (auto& refusal : refusals) {
      threads.emplace_back([&] {
        const Status copied = BackUpStore(state.folder(), copy);
        if (!copied) refusal = copied.error();
      });
    }
  }
  for (const auto& refusal : refusals) {
    EXPECT_TRUE(!refusal || refusal->code == ErrorCode::kAlreadyExists) << refusal->ToString();
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()), 1)
      << "something was left";
  auto database = Database::Open(copy, Database::Access::kReadOnly);
  ASSERT_TRUE(database.ok());
  EXPECT_EQ(database->Number("SELECT count(*) FROM captures").value(), 0);
}

TEST(StoreEvents, ComeInOrderAndCanBeResumed) {
  DaemonState state;
  std::vector<EventRecord> heard;
  auto subscription =
      state.hub().Subscribe([&](const EventRecord& event) { heard.push_back(event); });
  for (int i = 0; i < 3; ++i) {
    const std::string id = "x" + std::to_string(i);
    WriteTinyFrameSet(state.store().CaptureFolder(id), "2026-01-01T00:00:00Z");
    ASSERT_TRUE(RecordCapture(state.store(), id, std::nullopt).ok());
  }
  subscription.reset();
  ASSERT_TRUE(AddJob(state.store(), {JobKind::kCapture, "{}", ""}).ok());
  ASSERT_EQ(heard.size(), 3u) << "the fourth came after the subscription's end";
  EXPECT_EQ(heard[1].kind, "capture_stored");
  EXPECT_EQ(heard[1].about, "x1");

  state.Reopen();
  const auto missed = ListEvents(state.store(), heard[1].number, 100);
  ASSERT_TRUE(missed.ok());
  ASSERT_EQ(missed->size(), 2u);
  EXPECT_EQ((*missed)[0].number, heard[2].number);
  EXPECT_EQ((*missed)[0].data, heard[2].data);
  EXPECT_EQ((*missed)[1].kind, "job_queued");
  EXPECT_EQ(LastEventNumber(state.store()).value(), (*missed)[1].number);
}

TEST(Store, PagesThroughTwoThousandCaptures) {
  constexpr int kCaptures = 2000, kFrames = 90;
  DaemonState state;
  ASSERT_TRUE(state.store()
                  .Write([&](Database& database, auto&) {
                    return database.Execute(
                        "WITH RECURSIVE n(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n "
                        "WHERE i + 1 < " +
                        std::to_string(kCaptures) +
                        ") "
                        "INSERT INTO captures (id, captured_at, ok_frames, frames) "
                        "SELECT printf('x%04d', i), printf('2026-01-01T%02d:%02d:00.000Z', "
                        "i / 60 / 2, i / 2 % 60), 90, 90 FROM n;"
                        "WITH RECURSIVE n(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n "
                        "WHERE i + 1 < " +
                        std::to_string(kFrames) +
                        ") "
                        "INSERT INTO frames SELECT id, printf('c%02d', i), '', "
                        "'captures/' || id || '/f', 'ok', "
                        "'0123456789abcdef', 1200, 1600, '' FROM captures, n");
                  })
                  .ok());
  std::set<std::string> seen;
  std::string last = "x9999", after;
  do {
    const auto page = ListCaptures(state.store(), {300, after});
    ASSERT_TRUE(page.ok());
    for (const CaptureRecord& capture : page->items) {
      EXPECT_LT(capture.id, last) << "newest first";
      last = capture.id;
      seen.insert(capture.id);
    }
    after = page->next;
  } while (!after.empty());
  EXPECT_EQ(seen.size(), size_t{kCaptures});
  EXPECT_EQ(ListFrames(state.store(), "x1234")->size(), size_t{kFrames});
}

}  // namespace
}  // namespace rotunda::daemon
