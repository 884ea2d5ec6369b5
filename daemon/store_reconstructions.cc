#include "daemon/store_reconstructions.h"

#include <map>
#include <system_error>

#include "daemon/drift.h"
#include "daemon/store_calibrations.h"
#include "daemon/store_captures.h"
#include "daemon/store_internal.h"
#include "daemon/store_sql.h"
#include "sfm/core/pose_set.h"

namespace rotunda::daemon {
namespace {

constexpr int kMaxReconstructions = 10000;

constexpr char kSelect[] =
    "SELECT id, capture, calibration, created_at, method, registered, of_cameras, rms_px, verdict, "
    "verdict_reason, folded, used_for_drift, mean_rotation_deg, mean_position_mm, files_gone "
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
      "INSERT INTO reconstructions (id, capture, calibration, created_at, method, registered, "
      "of_cameras, rms_px, verdict, verdict_reason, folded, used_for_drift, mean_rotation_deg, "
      "mean_position_mm) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  insert.Bind(record.id).Bind(record.capture).Bind(record.calibration).Bind(record.created_at);
  insert.Bind(record.method).Bind(record.registered).Bind(record.of).Bind(record.rms_px);
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

Result<std::vector<CameraDrift>> DriftAgainst(Database& database, const std::string& calibration,
                                              size_t captures_of_moved) {
  ROTUNDA_ASSIGN_OR_RETURN(std::vector<CameraDrift> drifts, ComparedCameras(database, calibration));
  Statement newest = database.Prepare(
      std::string(kSelectDrift) +
      "WHERE calibration = ? AND camera = ? ORDER BY captured_at DESC, capture DESC");
  for (CameraDrift& drift : drifts) {
    newest.Reset().Bind(calibration).Bind(drift.latest.camera);
    for (bool is_first = true; newest.Step(); is_first = false) {
      DriftRecord record = ReadDrift(newest);
      const bool is_beyond = record.beyond_limit;
      if (is_first) drift.latest = std::move(record);
      if (!is_beyond) break;
      ++drift.beyond;
    }
    drift.moved = drift.beyond >= captures_of_moved;
  }
  ROTUNDA_RETURN_IF_ERROR(newest.status());
  return drifts;
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

Status ReplaceDrift(Database& database, const std::vector<DriftRecord>& records) {
  if (records.empty()) return {};
  ROTUNDA_RETURN_IF_ERROR(
      database.Prepare("DELETE FROM drift WHERE capture = ? AND calibration = ?")
          .Bind(records[0].capture)
          .Bind(records[0].calibration)
          .Run());
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

Status AddDrift(Database& database, const std::vector<DriftRecord>& records,
                size_t captures_of_moved, std::vector<EventRecord>& events) {
  if (records.empty()) return {};
  const std::string& calibration = records[0].calibration;
  ROTUNDA_ASSIGN_OR_RETURN(const auto before,
                           DriftAgainst(database, calibration, captures_of_moved));
  ROTUNDA_RETURN_IF_ERROR(ReplaceDrift(database, records));
  ROTUNDA_ASSIGN_OR_RETURN(const auto after,
                           DriftAgainst(database, calibration, captures_of_moved));
  ROTUNDA_ASSIGN_OR_RETURN(const bool is_active, IsActive(database, calibration));
  if (is_active) TellOfChanges(before, after, events);
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
  ROTUNDA_ASSIGN_OR_RETURN(const PoseSet poses, ReadPoseSet(folder / "poses.json"));
  if (!IsStoreId(id)) {
    return Error{ErrorCode::kBadInput, "has no usable name", folder.string()};
  }
  ReconstructionRecord record = Describe(id, poses);
  record.created_at = store.Now();
  ROTUNDA_ASSIGN_OR_RETURN(const CaptureRecord capture, FindCapture(store, record.capture));
  std::vector<DriftRecord> drift = DriftOf(poses, AlignedTo(store, poses), store.options().drift);
  for (DriftRecord& each : drift) {
    each.capture = capture.id;
    each.captured_at = capture.captured_at;
    each.reconstruction = id;
  }
  ROTUNDA_RETURN_IF_ERROR(store.Write([&](Database& database, auto& events) -> Status {
    const Result<ReconstructionRecord> known = Select(database, id);
    if (known) return {};
    if (known.error().code != ErrorCode::kNotFound) return known.error();
    ROTUNDA_RETURN_IF_ERROR(Insert(database, record));
    events.push_back(MakeEvent("reconstruction_stored", id,
                               {{"capture", record.capture},
                                {"registered", record.registered},
                                {"of", record.of},
                                {"verdict", record.verdict},
                                {"verdict_reason", record.verdict_reason},
                                {"used_for_drift", record.used_for_drift}}));
    return AddDrift(database, drift, store.options().drift.captures, events);
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
    Statement row = database.Prepare(std::string(kSelect) +
                                     "WHERE capture = ? ORDER BY created_at DESC, id DESC");
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
      where += "AND (created_at, id) < (?, ?) ";
    }
    Statement rows =
        database.Prepare(kSelect + where + "ORDER BY created_at DESC, id DESC LIMIT ?");
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
  ROTUNDA_ASSIGN_OR_RETURN(const std::optional<CalibrationRecord> active, ActiveCalibration(store));
  if (!active) return std::vector<CameraDrift>();
  Result<std::vector<CameraDrift>> drifts = std::vector<CameraDrift>();
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    drifts = DriftAgainst(database, active->id, store.options().drift.captures);
    return Status();
  }));
  return drifts;
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
