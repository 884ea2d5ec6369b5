#include "daemon/store_reconstructions.h"

#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <set>
#include <system_error>

#include "daemon/drift.h"
#include "daemon/store_calibrations.h"
#include "daemon/store_captures.h"
#include "daemon/store_internal.h"
#include "daemon/store_sql.h"
#include "sfm/core/pose_set.h"
#include "sfm/run_choices.h"

namespace rotunda::daemon {
namespace {

constexpr int kMaxReconstructions = 10000;

constexpr char kSelect[] =
    "SELECT id, capture, calibration, created_at, method, preset, prior, registered, of_cameras, "
    "rms_px, verdict, verdict_reason, folded, used_for_drift, mean_rotation_deg, mean_position_mm, "
    "files_gone "
    "FROM reconstructions ";

constexpr char kSelectDrift[] =
    "SELECT calibration, camera, captured_at, capture, reconstruction, rotation_deg, position_mm, "
    "rotation_sigma_deg, position_sigma_mm, beyond_limit, swapped_with FROM drift ";

ReconstructionRecord ReadRow(Statement& row) {
  ReconstructionRecord record;
  record.id = row.Id();
  record.capture = row.Id();
  record.calibration = row.OptionalText();
  record.created_at = row.Text();
  record.method = row.Text();
  record.preset = row.Text();
  record.prior = row.Text();
  record.registered = row.Count();
  record.of = row.Count();
  record.rms_px = row.Real();
  record.verdict = row.Text();
  record.verdict_reason = row.Text();
  record.folded = row.Bool();
  record.used_for_drift = row.Bool();
  record.mean_rotation_deg = row.OptionalReal();
  record.mean_position_mm = row.OptionalReal();
  record.files_gone = row.Bool();
  return record;
}

DriftRecord ReadDrift(Statement& row) {
  DriftRecord drift;
  drift.calibration = row.Text();
  drift.camera = row.Text();
  drift.captured_at = row.Text();
  drift.capture = row.Text();
  drift.reconstruction = row.Text();
  drift.rotation_deg = row.Real();
  drift.position_mm = row.Real();
  drift.rotation_sigma_deg = row.OptionalReal();
  drift.position_sigma_mm = row.OptionalReal();
  drift.beyond_limit = row.Bool();
  drift.swapped_with = row.OptionalText();
  return drift;
}

Result<ReconstructionRecord> Select(Database& database, const std::string& id) {
  Statement row = database.Prepare(std::string(kSelect) + "WHERE id = ?");
  ROTUNDA_ASSIGN_OR_RETURN(std::optional<ReconstructionRecord> record,
                           ReadOne(row.Bind(id), ReadRow));
  if (!record) return NotFound("reconstruction", id);
  return *std::move(record);
}

/// When the file was written; a time that is yet to come is a clock's that was wrong: now.
std::string TimeOf(const std::filesystem::path& file, const Store& store) {
  std::string now = store.Now();
  struct stat found {};
  if (::stat(file.c_str(), &found) != 0) return now;
  const auto written =
      std::chrono::seconds(found.st_mtim.tv_sec) + std::chrono::nanoseconds(found.st_mtim.tv_nsec);
  using SystemClock = std::chrono::system_clock;
  return std::min(
      TimeText(SystemClock::time_point(std::chrono::duration_cast<SystemClock::duration>(written))),
      now);
}

Place PlaceOf(const ReconstructionRecord& record) { return {record.created_at, record.id}; }

Result<Place> PlaceOfReconstruction(Database& database, const std::string& id) {
  ROTUNDA_ASSIGN_OR_RETURN(const ReconstructionRecord record, Select(database, id));
  return PlaceOf(record);
}

ReconstructionRecord Describe(const std::string& id, const PoseSet& poses) {
  ReconstructionRecord record;
  record.id = id;
  record.capture = poses.frameset;
  record.calibration = poses.aligned_to;
  record.method = poses.method;
  if (const auto preset = poses.options.find(sfm::kPresetOption); preset != poses.options.end()) {
    record.preset = preset->second;
  }
  record.prior = sfm::PriorOf(poses);
  record.registered = poses.summary.registered;
  record.of = poses.summary.of;
  record.rms_px = poses.summary.rms_px;
  record.verdict = poses.summary.verdict;
  record.verdict_reason = poses.summary.verdict_reason;
  record.folded = poses.summary.folded.value_or(false);
  record.used_for_drift = MaySpeakOfDrift(poses);
  record.mean_rotation_deg = poses.summary.mean_rotation_deg;
  record.mean_position_mm = poses.summary.mean_position_mm;
  return record;
}

Status Insert(Database& database, const ReconstructionRecord& record) {
  Statement insert = database.Prepare(
      "INSERT INTO reconstructions (id, capture, calibration, created_at, method, preset, "
      "prior, registered, of_cameras, rms_px, verdict, verdict_reason, folded, used_for_drift, "
      "mean_rotation_deg, mean_position_mm) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, "
      "?)");
  insert.Bind(record.id).Bind(record.capture).Bind(record.calibration).Bind(record.created_at);
  insert.Bind(record.method)
      .Bind(record.preset)
      .Bind(record.prior)
      .Bind(record.registered)
      .Bind(record.of)
      .Bind(record.rms_px);
  insert.Bind(record.verdict).Bind(record.verdict_reason).Bind(record.folded);
  insert.Bind(record.used_for_drift).Bind(record.mean_rotation_deg).Bind(record.mean_position_mm);
  return insert.Run();
}

/// The calibration that the poses were aligned to, for its sigmas: the capture's copy or ours. One
/// that is not to be found has no cameras.
Calibration AlignedTo(const Store& store, const PoseSet& poses) {
  Calibration none;
  if (!poses.aligned_to) return none;
  const auto copy = ReadCalibration(store.CaptureFolder(poses.frameset) / "calibration.json");
  if (copy && copy->id == *poses.aligned_to) return *copy;
  if (!IsStoreId(*poses.aligned_to)) return none;
  auto ours = ReadCalibration(store.CalibrationFolder(*poses.aligned_to) / "calibration.json");
  return ours ? std::move(ours).value() : none;
}

/// Every camera that was compared with a calibration, by name; `latest` has only its name yet.
Result<std::vector<CameraDrift>> ComparedCameras(Database& database,
                                                 const std::string& calibration) {
  Statement row = database.Prepare(
      "SELECT camera, captures FROM drift_counts WHERE calibration = ? AND captures > 0 "
      "ORDER BY camera");
  row.Bind(calibration);
  std::vector<CameraDrift> drifts;
  while (row.Step()) {
    CameraDrift& drift = drifts.emplace_back();
    drift.latest.camera = row.Text();
    drift.captures = row.Count();
  }
  ROTUNDA_RETURN_IF_ERROR(row.status());
  return drifts;
}

/// In how many captures in a row, the newest first, the camera was beyond its limit.
Result<size_t> CountBeyond(Database& database, const std::string& calibration,
                           const std::string& camera) {
  Statement within = database.Prepare(
      "SELECT captured_at, capture FROM drift WHERE calibration = ? AND camera = ? "
      "AND beyond_limit = 0 ORDER BY captured_at DESC, capture DESC LIMIT 1");
  std::string captured_at, capture;  // empty: before all
  if (within.Bind(calibration).Bind(camera).Step()) {
    captured_at = within.Text();
    capture = within.Text();
  }
  ROTUNDA_RETURN_IF_ERROR(within.status());
  Statement newer = database.Prepare(
      "SELECT count(*) FROM drift WHERE calibration = ? AND camera = ? AND beyond_limit = 1 "
      "AND (captured_at, capture) > (?, ?)");
  newer.Bind(calibration).Bind(camera).Bind(captured_at).Bind(capture).Step();
  const size_t count = newer.Count();
  ROTUNDA_RETURN_IF_ERROR(newer.status());
  return count;
}

Result<std::vector<CameraDrift>> DriftAgainst(Database& database, const std::string& calibration,
                                              size_t captures_of_moved) {
  ROTUNDA_ASSIGN_OR_RETURN(std::vector<CameraDrift> drifts, ComparedCameras(database, calibration));
  Statement newest = database.Prepare(
      std::string(kSelectDrift) +
      "WHERE calibration = ? AND camera = ? ORDER BY captured_at DESC, capture DESC LIMIT 1");
  for (CameraDrift& drift : drifts) {
    if (newest.Reset().Bind(calibration).Bind(drift.latest.camera).Step()) {
      drift.latest = ReadDrift(newest);
    }
    ROTUNDA_RETURN_IF_ERROR(newest.status());
    if (!drift.latest.beyond_limit) continue;
    ROTUNDA_ASSIGN_OR_RETURN(drift.beyond, CountBeyond(database, calibration, drift.latest.camera));
    drift.moved = drift.beyond >= captures_of_moved;
  }
  return drifts;
}

/// Cameras that at least `fewest` captures in a row have no pose of.
Result<std::vector<UnregisteredCamera>> UnregisteredAgainst(Database& database,
                                                            const std::string& calibration,
                                                            size_t fewest) {
  // With max() SQLite takes the other columns from the row that has it.
  Statement row = database.Prepare(
      "SELECT camera, capture, reason, count(*), max(captured_at) FROM unregistered "
      "WHERE calibration = ? GROUP BY camera HAVING count(*) >= ? ORDER BY camera");
  row.Bind(calibration).Bind(uint64_t{fewest});
  std::vector<UnregisteredCamera> cameras;
  while (row.Step()) {
    UnregisteredCamera& camera = cameras.emplace_back();
    camera.latest.calibration = calibration;
    camera.latest.camera = row.Text();
    camera.latest.capture = row.Text();
    camera.latest.reason = row.Text();
    camera.captures = row.Count();
    camera.latest.captured_at = row.Text();
  }
  ROTUNDA_RETURN_IF_ERROR(row.status());
  return cameras;
}

Place PlaceOf(const DriftRecord& drift) {
  return {drift.captured_at, drift.capture, drift.calibration};
}

/// Where a reconstruction stands in the camera's history.
Result<Place> PlaceInHistory(Database& database, const std::string& camera,
                             const std::string& reconstruction) {
  Statement row =
      database.Prepare(std::string(kSelectDrift) + "WHERE camera = ? AND reconstruction = ?");
  const bool found = row.Bind(camera).Bind(reconstruction).Step();
  ROTUNDA_RETURN_IF_ERROR(row.status());
  if (found) return PlaceOf(ReadDrift(row));
  return Error{
      ErrorCode::kNotFound,
      "camera \"" + camera + "\" was not compared in reconstruction \"" + reconstruction + "\"",
      ""};
}

Result<bool> IsActive(Database& database, const std::string& calibration) {
  Statement row = database.Prepare("SELECT 1 FROM calibrations WHERE id = ? AND active = 1");
  const bool is_active = row.Bind(calibration).Step();
  ROTUNDA_RETURN_IF_ERROR(row.status());
  return is_active;
}

/// What `read` gives of the calibration in force; nothing without one.
template <typename T>
Result<std::vector<T>> AgainstTheActive(
    Store& store, Result<std::vector<T>> (*read)(Database&, const std::string&, size_t)) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::optional<CalibrationRecord> active, ActiveCalibration(store));
  Result<std::vector<T>> found = std::vector<T>();
  if (!active) return found;
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    found = read(database, active->id, store.options().drift.captures);
    return Status();
  }));
  return found;
}

/// What one reconstruction says of the cameras; no drift: it may not speak of it.
struct Findings {
  std::vector<DriftRecord> drift;
  std::vector<UnregisteredRecord> unregistered;
};

Findings FindingsOf(const Store& store, const PoseSet& poses, const CaptureRecord& capture,
                    const std::string& reconstruction) {
  const Calibration calibration = AlignedTo(store, poses);
  Findings findings{DriftOf(poses, calibration, store.options().drift),
                    UnregisteredOf(poses, calibration)};
  for (DriftRecord& each : findings.drift) {
    each.capture = capture.id;
    each.captured_at = capture.captured_at;
    each.reconstruction = reconstruction;
  }
  for (UnregisteredRecord& each : findings.unregistered) {
    each.capture = capture.id;
    each.captured_at = capture.captured_at;
  }
  return findings;
}

Status InsertDrift(Database& database, const std::vector<DriftRecord>& records) {
  Statement insert = database.Prepare(
      "INSERT INTO drift (calibration, camera, captured_at, capture, reconstruction, "
      "rotation_deg, position_mm, rotation_sigma_deg, position_sigma_mm, beyond_limit, "
      "swapped_with) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  for (const DriftRecord& record : records) {
    insert.Reset().Bind(record.calibration).Bind(record.camera).Bind(record.captured_at);
    insert.Bind(record.capture).Bind(record.reconstruction).Bind(record.rotation_deg);
    insert.Bind(record.position_mm).Bind(record.rotation_sigma_deg).Bind(record.position_sigma_mm);
    insert.Bind(record.beyond_limit).Bind(record.swapped_with);
    ROTUNDA_RETURN_IF_ERROR(insert.Run());
  }
  return {};
}

Status InsertUnregistered(Database& database, const std::vector<UnregisteredRecord>& records) {
  Statement insert = database.Prepare(
      "INSERT INTO unregistered (calibration, camera, captured_at, capture, reason) "
      "VALUES (?, ?, ?, ?, ?)");
  for (const UnregisteredRecord& record : records) {
    insert.Reset().Bind(record.calibration).Bind(record.camera).Bind(record.captured_at);
    ROTUNDA_RETURN_IF_ERROR(insert.Bind(record.capture).Bind(record.reason).Run());
  }
  return {};
}

/// Whether a newer reconstruction of the capture has spoken: folders without a row are adopted in
/// the order of their numbers, which need not be that of their times.
Result<bool> IsOutdated(Database& database, const DriftRecord& any) {
  Statement newer = database.Prepare(
      "SELECT 1 FROM drift JOIN reconstructions AS r ON r.id = drift.reconstruction "
      "JOIN reconstructions AS mine ON mine.id = ? "
      "WHERE drift.capture = ? AND drift.calibration = ? AND "
      "(r.created_at, length(r.id), r.id) > (mine.created_at, length(mine.id), mine.id) LIMIT 1");
  newer.Bind(any.reconstruction).Bind(any.capture).Bind(any.calibration);
  const bool found = newer.Step();
  ROTUNDA_RETURN_IF_ERROR(newer.status());
  return found;
}

/// Of a capture that is reconstructed again the newest findings count.
Status ReplaceFindings(Database& database, const Findings& findings) {
  const DriftRecord& any = findings.drift[0];
  for (const std::string table : {"drift", "unregistered"}) {
    ROTUNDA_RETURN_IF_ERROR(
        database.Prepare("DELETE FROM " + table + " WHERE capture = ? AND calibration = ?")
            .Bind(any.capture)
            .Bind(any.calibration)
            .Run());
  }
  ROTUNDA_RETURN_IF_ERROR(InsertDrift(database, findings.drift));
  ROTUNDA_RETURN_IF_ERROR(InsertUnregistered(database, findings.unregistered));
  return database
      .Prepare(
          "DELETE FROM unregistered AS old WHERE calibration = ? AND EXISTS (SELECT 1 FROM drift "
          "WHERE calibration = old.calibration AND camera = old.camera "
          "AND (captured_at, capture) > (old.captured_at, old.capture))")
      .Bind(any.calibration)
      .Run();
}

/// camera_moved and camera_back: what changed between two looks at the drift.
void TellOfChanges(const std::vector<CameraDrift>& before, const std::vector<CameraDrift>& after,
                   std::vector<EventRecord>& events) {
  std::map<std::string, bool> moved_before;
  for (const CameraDrift& drift : before) moved_before[drift.latest.camera] = drift.moved;
  for (const CameraDrift& drift : after) {
    const DriftRecord& latest = drift.latest;
    if (moved_before[latest.camera] == drift.moved) continue;
    Json data = {{"capture", latest.capture},
                 {"calibration", latest.calibration},
                 {"position_mm", latest.position_mm},
                 {"rotation_deg", latest.rotation_deg},
                 {"captures", drift.beyond}};
    if (latest.swapped_with) data["swapped_with"] = *latest.swapped_with;
    events.push_back(MakeEvent(drift.moved ? "camera_moved" : "camera_back", latest.camera, data));
  }
}

/// camera_unregistered and camera_registered: what changed between two looks.
void TellOfChanges(const std::vector<UnregisteredCamera>& before,
                   const std::vector<UnregisteredCamera>& after, std::vector<EventRecord>& events) {
  std::set<std::string> names_before, names_after;
  for (const UnregisteredCamera& camera : before) names_before.insert(camera.latest.camera);
  for (const UnregisteredCamera& camera : after) {
    const UnregisteredRecord& latest = camera.latest;
    names_after.insert(latest.camera);
    if (names_before.contains(latest.camera)) continue;
    events.push_back(MakeEvent("camera_unregistered", latest.camera,
                               {{"capture", latest.capture},
                                {"calibration", latest.calibration},
                                {"reason", latest.reason},
                                {"captures", camera.captures}}));
  }
  for (const std::string& name : names_before) {
    if (names_after.contains(name)) continue;
    events.push_back(MakeEvent("camera_registered", name, Json::object()));
  }
}

/// What the drift's tables say of the cameras.
struct Watch {
  std::vector<CameraDrift> drift;
  std::vector<UnregisteredCamera> unregistered;
};
Result<Watch> WatchAgainst(Database& database, const std::string& calibration,
                           size_t captures_to_name) {
  Watch watch;
  ROTUNDA_ASSIGN_OR_RETURN(watch.drift, DriftAgainst(database, calibration, captures_to_name));
  ROTUNDA_ASSIGN_OR_RETURN(watch.unregistered,
                           UnregisteredAgainst(database, calibration, captures_to_name));
  return watch;
}

Status AddFindings(Database& database, const Findings& findings, size_t captures_to_name,
                   std::vector<EventRecord>& events) {
  if (findings.drift.empty()) return {};
  const std::string& calibration = findings.drift[0].calibration;
  ROTUNDA_ASSIGN_OR_RETURN(const bool is_outdated, IsOutdated(database, findings.drift[0]));
  if (is_outdated) return {};
  ROTUNDA_ASSIGN_OR_RETURN(const Watch before,
                           WatchAgainst(database, calibration, captures_to_name));
  ROTUNDA_RETURN_IF_ERROR(ReplaceFindings(database, findings));
  ROTUNDA_ASSIGN_OR_RETURN(const Watch after,
                           WatchAgainst(database, calibration, captures_to_name));
  ROTUNDA_ASSIGN_OR_RETURN(const bool is_active, IsActive(database, calibration));
  if (!is_active) return {};
  TellOfChanges(before.drift, after.drift, events);
  TellOfChanges(before.unregistered, after.unregistered, events);
  return {};
}

}  // namespace

Result<std::string> FreeReconstructionId(Store& store, const std::string& capture) {
  for (int n = 1; n <= kMaxReconstructions; ++n) {
    std::string id = capture + "-r" + std::to_string(n);
    std::error_code failed;
    if (std::filesystem::exists(store.ReconstructionFolder(id), failed)) continue;
    const Result<ReconstructionRecord> known = FindReconstruction(store, id);
    if (!known && known.error().code != ErrorCode::kNotFound) return known.error();
    if (known) continue;
    ROTUNDA_ASSIGN_OR_RETURN(const auto reserved_by, FindJobByProduct(store, id));
    if (!reserved_by) return id;
  }
  return Error{ErrorCode::kAlreadyExists, "there are too many reconstructions", capture};
}

Result<ReconstructionRecord> RecordReconstruction(Store& store, const std::string& id) {
  const std::filesystem::path folder = store.ReconstructionFolder(id);
  const std::filesystem::path file = folder / "poses.json";
  ROTUNDA_ASSIGN_OR_RETURN(const PoseSet poses, ReadPoseSet(file));
  if (!IsStoreId(id)) {
    return Error{ErrorCode::kBadInput, "has no usable name", folder.string()};
  }
  ReconstructionRecord record = Describe(id, poses);
  record.created_at = TimeOf(file, store);
  ROTUNDA_ASSIGN_OR_RETURN(const CaptureRecord capture, FindCapture(store, record.capture));
  const Findings findings = FindingsOf(store, poses, capture, id);
  ROTUNDA_RETURN_IF_ERROR(store.Write([&](Database& database, auto& events) -> Status {
    const Result<ReconstructionRecord> known = Select(database, id);
    if (known) return {};
    if (known.error().code != ErrorCode::kNotFound) return known.error();
    ROTUNDA_RETURN_IF_ERROR(Insert(database, record));
    events.push_back(MakeEvent("reconstruction_stored", id,
                               {{"capture", record.capture},
                                {"registered", record.registered},
                                {"of", record.of},
                                {"prior", record.prior},
                                {"verdict", record.verdict},
                                {"verdict_reason", record.verdict_reason},
                                {"used_for_drift", record.used_for_drift}}));
    return AddFindings(database, findings, store.options().drift.captures, events);
  }));
  return FindReconstruction(store, id);
}

Result<ReconstructionRecord> FindReconstruction(Store& store, const std::string& id) {
  Result<ReconstructionRecord> record = NotFound("reconstruction", id);
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    record = Select(database, id);
    return Status();
  }));
  return record;
}

Result<std::vector<ReconstructionRecord>> ListReconstructions(Store& store,
                                                              const std::string& capture) {
  std::vector<ReconstructionRecord> records;
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    Statement row = database.Prepare(std::string(kSelect) + "WHERE capture = ? ORDER BY " +
                                     kNewestReconstructionFirst);
    row.Bind(capture);
    while (row.Step()) records.push_back(ReadRow(row));
    return row.status();
  }));
  return records;
}

Result<Listing<ReconstructionRecord>> ListReconstructions(Store& store, const std::string& capture,
                                                          const Page& page) {
  ROTUNDA_RETURN_IF_ERROR(CheckPage(page));
  Result<Listing<ReconstructionRecord>> listing = Listing<ReconstructionRecord>();
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) -> Status {
    std::string where = "WHERE capture = ? ";
    Place after;
    if (!page.after.empty()) {
      ROTUNDA_ASSIGN_OR_RETURN(after, PlaceAfter(page.after, 2, [&](const std::string& id) {
                                 return PlaceOfReconstruction(database, id);
                               }));
      where += "AND (created_at, length(id), id) < (?2, length(?3), ?3) ";
    }
    Statement rows =
        database.Prepare(kSelect + where + "ORDER BY " + kNewestReconstructionFirst + " LIMIT ?");
    rows.Bind(capture);
    for (const std::string& value : after) rows.Bind(value);
    rows.Bind(uint64_t{page.limit + 1});
    listing = ReadListing<ReconstructionRecord>(
        rows, page.limit, ReadRow,
        [](const ReconstructionRecord& record) { return PlaceText(PlaceOf(record)); });
    return Status();
  }));
  return listing;
}

Result<std::vector<CameraDrift>> DriftNow(Store& store) {
  return AgainstTheActive(store, DriftAgainst);
}

Result<std::vector<UnregisteredCamera>> UnregisteredNow(Store& store) {
  return AgainstTheActive(store, UnregisteredAgainst);
}

Result<Listing<DriftRecord>> DriftHistory(Store& store, const std::string& camera,
                                          const Page& page) {
  ROTUNDA_RETURN_IF_ERROR(CheckPage(page));
  Result<Listing<DriftRecord>> listing = Listing<DriftRecord>();
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) -> Status {
    std::string where = "WHERE camera = ? ";
    Place after;
    if (!page.after.empty()) {
      ROTUNDA_ASSIGN_OR_RETURN(after, PlaceAfter(page.after, 3, [&](const std::string& id) {
                                 return PlaceInHistory(database, camera, id);
                               }));
      where += "AND (captured_at, capture, calibration) < (?, ?, ?) ";
    }
    Statement rows = database.Prepare(
        kSelectDrift + where + "ORDER BY captured_at DESC, capture DESC, calibration DESC LIMIT ?");
    rows.Bind(camera);
    for (const std::string& value : after) rows.Bind(value);
    rows.Bind(uint64_t{page.limit + 1});
    listing = ReadListing<DriftRecord>(rows, page.limit, ReadDrift, [](const DriftRecord& drift) {
      return PlaceText(PlaceOf(drift));
    });
    return Status();
  }));
  return listing;
}

}  // namespace rotunda::daemon
