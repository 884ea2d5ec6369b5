#include "daemon/store_calibrations.h"

#include <system_error>

#include "daemon/store_internal.h"
#include "daemon/store_sql.h"
#include "sfm/core/calibration.h"
#include "sfm/core/file_io.h"
#include "sfm/core/json_reader.h"

namespace rotunda::daemon {
namespace {

constexpr int kMaxCopies = 10000;

constexpr char kSelect[] =
    "SELECT id, created_at, source, cameras, rms_px, held_out_px, active, activated_at, "
    "files_gone, "
    "made_from "
    "FROM calibrations ";

CalibrationRecord ReadRow(Statement& row) {
  CalibrationRecord calibration;
  calibration.id = row.Id();
  calibration.created_at = row.Text();
  calibration.source = row.Text();
  calibration.cameras = row.Count();
  calibration.rms_px = row.OptionalReal();
  calibration.held_out_rms_px = row.OptionalReal();
  calibration.active = row.Bool();
  calibration.activated_at = row.OptionalText();
  calibration.files_gone = row.Bool();
  calibration.made_from = row.Text();
  return calibration;
}

const char* SourceName(CalibrationSource source) {
  switch (source) {
    case CalibrationSource::kCharuco:
      return "charuco";
    case CalibrationSource::kSfm:
      return "sfm";
    case CalibrationSource::kTruth:
      return "truth";
  }
  return "";
}

Result<CalibrationRecord> Select(Database& database, const std::string& id) {
  Statement row = database.Prepare(std::string(kSelect) + "WHERE id = ?");
  ROTUNDA_ASSIGN_OR_RETURN(std::optional<CalibrationRecord> calibration,
                           ReadOne(row.Bind(id), ReadRow));
  if (!calibration) return NotFound("calibration", id);
  return *std::move(calibration);
}

Status Insert(Database& database, const std::string& id, const Calibration& calibration,
              const std::string& made_from) {
  std::optional<double> rms_px, held_out_px;
  if (calibration.residuals) {
    rms_px = calibration.residuals->rms_px;
    held_out_px = calibration.residuals->held_out_rms_px;
  }
  Statement insert = database.Prepare(
      "INSERT INTO calibrations (id, created_at, source, made_from, cameras, rms_px, held_out_px) "
      "VALUES (?, ?, ?, ?, ?, ?, ?)");
  insert.Bind(id).Bind(calibration.created_at).Bind(SourceName(calibration.source));
  insert.Bind(made_from);
  return insert.Bind(uint64_t{calibration.cameras.size()}).Bind(rms_px).Bind(held_out_px).Run();
}

/// The text of its made_from.json; empty: it was made elsewhere, or that cannot be read.
std::string MadeFromIn(const std::filesystem::path& folder) {
  const Result<std::string> text = ReadFile(folder / kMadeFromName);
  if (!text) return "";
  const Result<nlohmann::json> value = ParseJson(*text, kMadeFromName);
  return value && value->is_object() ? *text : "";
}

}  // namespace

Result<std::string> FreeCalibrationId(Store& store, const std::string& wanted) {
  for (int n = 1; n <= kMaxCopies; ++n) {
    std::string id = n == 1 ? wanted : wanted + "-" + std::to_string(n);
    std::error_code failed;
    if (std::filesystem::exists(store.CalibrationFolder(id), failed)) continue;
    const Result<CalibrationRecord> known = FindCalibration(store, id);
    if (!known && known.error().code != ErrorCode::kNotFound) return known.error();
    if (known) continue;
    ROTUNDA_ASSIGN_OR_RETURN(const auto reserved_by, FindJobByProduct(store, id));
    if (!reserved_by) return id;
  }
  return Error{ErrorCode::kAlreadyExists, "there are too many of this name", wanted};
}

Result<CalibrationRecord> RecordCalibration(Store& store, const std::string& id) {
  const std::filesystem::path folder = store.CalibrationFolder(id);
  ROTUNDA_ASSIGN_OR_RETURN(const Calibration calibration,
                           ReadCalibration(folder / "calibration.json"));
  if (!IsStoreId(id) || calibration.id != id) {
    return Error{
        ErrorCode::kBadInput,
        "its calibration.json has the id \"" + calibration.id + "\", expected the folder's name",
        folder.string()};
  }
  const std::string made_from = MadeFromIn(folder);
  ROTUNDA_RETURN_IF_ERROR(store.Write([&](Database& database, auto& events) -> Status {
    const Result<CalibrationRecord> known = Select(database, id);
    if (known) return {};
    if (known.error().code != ErrorCode::kNotFound) return known.error();
    events.push_back(
        MakeEvent("calibration_stored", id, {{"cameras", calibration.cameras.size()}}));
    return Insert(database, id, calibration, made_from);
  }));
  return FindCalibration(store, id);
}

Result<std::string> CalibrationText(const Store& store, const std::string& id) {
  const std::filesystem::path file = store.CalibrationFolder(id) / "calibration.json";
  const auto broken = [&id](const Error& error) {
    return Error{error.code,
                 error.message + "; put the file back, or activate another calibration than " + id,
                 error.context};
  };
  Result<std::string> text = ReadFile(file);
  if (!text) return broken(text.error());
  const Result<Calibration> calibration = CalibrationFromJson(*text, file.string());
  if (!calibration) return broken(calibration.error());
  return text;
}

Result<CalibrationRecord> ActivateCalibration(Store& store, const std::string& id) {
  ROTUNDA_ASSIGN_OR_RETURN(const CalibrationRecord known, FindCalibration(store, id));
  ROTUNDA_RETURN_IF_ERROR(ReadCalibration(store.CalibrationFolder(known.id) / "calibration.json"));
  ROTUNDA_RETURN_IF_ERROR(store.Write([&](Database& database, auto& events) -> Status {
    ROTUNDA_ASSIGN_OR_RETURN(const CalibrationRecord wanted, Select(database, id));
    if (wanted.active) return {};
    ROTUNDA_RETURN_IF_ERROR(
        database.Execute("UPDATE calibrations SET active = 0 WHERE active = 1"));
    events.push_back(MakeEvent("calibration_activated", id, Json::object()));
    return database.Prepare("UPDATE calibrations SET active = 1, activated_at = ? WHERE id = ?")
        .Bind(store.Now())
        .Bind(id)
        .Run();
  }));
  return FindCalibration(store, id);
}

Result<CalibrationRecord> FindCalibration(Store& store, const std::string& id) {
  Result<CalibrationRecord> calibration = NotFound("calibration", id);
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    calibration = Select(database, id);
    return Status();
  }));
  return calibration;
}

Result<std::optional<CalibrationRecord>> ActiveCalibration(Store& store) {
  std::optional<CalibrationRecord> active;
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    Statement row = database.Prepare(std::string(kSelect) + "WHERE active = 1");
    if (row.Step()) active = ReadRow(row);
    return row.status();
  }));
  return active;
}

Result<Listing<CalibrationRecord>> ListCalibrations(Store& store, const Page& page) {
  ROTUNDA_RETURN_IF_ERROR(CheckPage(page));
  Result<Listing<CalibrationRecord>> listing = Listing<CalibrationRecord>();
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) -> Status {
    std::string where;
    std::optional<CalibrationRecord> after;
    if (!page.after.empty()) {
      ROTUNDA_ASSIGN_OR_RETURN(after, Select(database, page.after));
      where = "WHERE (created_at, id) < (?, ?) ";
    }
    Statement rows =
        database.Prepare(kSelect + where + "ORDER BY created_at DESC, id DESC LIMIT ?");
    if (after) rows.Bind(after->created_at).Bind(after->id);
    rows.Bind(uint64_t{page.limit + 1});
    listing = ReadListing<CalibrationRecord>(
        rows, page.limit, ReadRow,
        [](const CalibrationRecord& calibration) { return calibration.id; });
    return Status();
  }));
  return listing;
}

}  // namespace rotunda::daemon
