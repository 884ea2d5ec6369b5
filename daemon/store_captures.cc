#include "daemon/store_captures.h"

#include <algorithm>
#include <map>
#include <system_error>
#include <utility>

#include "daemon/store_internal.h"
#include "daemon/store_sql.h"
#include "sfm/core/calibration.h"
#include "sfm/core/file_io.h"
#include "sfm/core/frame_set.h"
#include "sfm/core/json_reader.h"

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxIdsASecond = 1000;

// SpeaksOfTheRig() of a row.
constexpr char kSpeaksOfTheRig[] = "(prior = 'none' AND preset IN ('rig', ''))";

// With the reconstruction that speaks for it, of those whose files are there: a later one that is
// not sure does not take the place of one that is, nor one that does not speak of the rig that of
// one that does.
std::string SelectText(Speakers speakers) {
  return std::string(R"sql(
SELECT c.id, c.captured_at, c.subject, c.ok_frames, c.frames, c.calibration, c.files_gone,
       r.id, r.verdict, r.verdict_reason
FROM captures c LEFT JOIN reconstructions r ON r.id =
  (SELECT id FROM reconstructions WHERE capture = c.id AND files_gone = 0 )sql") +
         (speakers == Speakers::kOfTheRig ? std::string("AND ") + kSpeaksOfTheRig : "") +
         " ORDER BY (verdict = 'sure') * (1 + " + kSpeaksOfTheRig + ") DESC, " +
         kNewestReconstructionFirst + " LIMIT 1) ";
}

CaptureRecord ReadCapture(Statement& row) {
  CaptureRecord capture;
  capture.id = row.Id();
  capture.captured_at = row.Text();
  capture.subject = row.OptionalText();
  capture.ok_frames = row.Count();
  capture.frames = row.Count();
  capture.calibration = row.OptionalText();
  capture.files_gone = row.Bool();
  capture.reconstruction = row.OptionalId();
  capture.verdict = row.Text();
  capture.verdict_reason = row.Text();
  return capture;
}

/// "2026-11-22T23:05:01Z", with or without decimals: its order as text is that of time.
bool IsUtcTime(const std::string& text) {
  constexpr std::string_view kShape = "dddd-dd-ddTdd:dd:dd";
  if (text.size() <= kShape.size() || text.back() != 'Z') return false;
  for (size_t i = 0; i + 1 < text.size(); ++i) {
    const char expected = i < kShape.size() ? kShape[i] : i == kShape.size() ? '.' : 'd';
    const bool is_digit = text[i] >= '0' && text[i] <= '9';
    if (expected == 'd' ? !is_digit : text[i] != expected) return false;
  }
  return true;
}

Result<bool> IsTaken(Store& store, const std::string& id) {
  std::error_code failed;
  if (fs::exists(store.CaptureFolder(id), failed)) return true;
  bool taken = false;
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    Statement found = database.Prepare(
        "SELECT 1 FROM captures WHERE id = ?1 UNION ALL SELECT 1 FROM jobs WHERE product = ?1");
    taken = found.Bind(id).Step();
    return found.status();
  }));
  return taken;
}

/// The calibration that came with the set. A copy that cannot be read is told of by the
/// reconstruction, not by the shot.
std::optional<std::string> CalibrationInSet(const fs::path& folder) {
  const Result<Calibration> calibration = ReadCalibration(folder / "calibration.json");
  return calibration ? std::optional(calibration->id) : std::nullopt;
}

using Reasons = std::map<std::string, std::string>;

/// Why frames are not usable, by camera, as the shot.json beside the set has it; nothing of sets
/// that came without one that can be read.
Reasons ReasonsInSet(const fs::path& folder) {
  Reasons reasons;
  const Result<std::string> text = ReadFile(folder / "shot.json");
  const Result<nlohmann::json> shot =
      text ? ParseJson(*text, "shot.json") : Result<nlohmann::json>(text.error());
  if (!shot) return reasons;
  JsonReader reader("shot.json", *shot);
  for (const JsonField& camera : reader.root()["cameras"].Items()) {
    if (camera["reason"].present()) reasons[camera["camera"].String()] = camera["reason"].String();
  }
  return reasons;
}

Status InsertFrames(Database& database, const std::string& id, const FrameSet& set,
                    const Reasons& reasons) {
  Statement insert = database.Prepare(
      "INSERT INTO frames (capture, camera, serial, file, status, reason, xxh3, width_px, "
      "height_px) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)");
  for (const Frame& frame : set.frames) {
    const std::string file = frame.file.empty() ? "" : "captures/" + id + "/" + frame.file;
    const auto reason = reasons.find(frame.camera);
    insert.Reset()
        .Bind(id)
        .Bind(frame.camera)
        .Bind(frame.serial)
        .Bind(file)
        .Bind(frame.status)
        .Bind(reason == reasons.end() ? "" : reason->second)
        .Bind(frame.xxh3)
        .Bind(frame.width_px)
        .Bind(frame.height_px);
    ROTUNDA_RETURN_IF_ERROR(insert.Run());
  }
  return {};
}

Status InsertCapture(Database& database, const CaptureRecord& capture, const FrameSet& set,
                     const Reasons& reasons) {
  Statement insert = database.Prepare(
      "INSERT INTO captures (id, captured_at, subject, ok_frames, frames, calibration) "
      "VALUES (?, ?, ?, ?, ?, ?)");
  insert.Bind(capture.id).Bind(capture.captured_at).Bind(capture.subject);
  insert.Bind(capture.ok_frames).Bind(capture.frames).Bind(capture.calibration);
  ROTUNDA_RETURN_IF_ERROR(insert.Run());
  return InsertFrames(database, capture.id, set, reasons);
}

Result<CaptureRecord> SelectCapture(Database& database, const std::string& id) {
  Statement row = database.Prepare(SelectText(Speakers::kAll) + "WHERE c.id = ?");
  ROTUNDA_ASSIGN_OR_RETURN(std::optional<CaptureRecord> capture,
                           ReadOne(row.Bind(id), ReadCapture));
  if (!capture) return NotFound("capture", id);
  return *std::move(capture);
}

Place PlaceOf(const CaptureRecord& capture) { return {capture.captured_at, capture.id}; }

Result<Place> PlaceOfCapture(Database& database, const std::string& id) {
  ROTUNDA_ASSIGN_OR_RETURN(const CaptureRecord capture, SelectCapture(database, id));
  return PlaceOf(capture);
}

/// Whether `file`, as InsertFrames() writes it, lies in the folder of its capture.
bool IsInCapture(const std::string& file, const std::string& capture) {
  if (!file.starts_with("captures/" + capture + "/") || file.find('\0') != std::string::npos) {
    return false;
  }
  const fs::path path = file;
  return std::find(path.begin(), path.end(), "..") == path.end();
}

Result<FrameRecord> ReadFrame(Statement& row, const std::string& capture) {
  FrameRecord frame;
  frame.camera = row.Text();
  frame.serial = row.Text();
  frame.file = row.Text();
  frame.status = row.Text();
  frame.reason = row.Text();
  frame.xxh3 = row.Text();
  frame.width_px = row.Count();
  frame.height_px = row.Count();
  if (frame.file.empty() || IsInCapture(frame.file, capture)) return frame;
  return Error{ErrorCode::kBadInput,
               "database: the picture of camera \"" + frame.camera + "\" in capture \"" + capture +
                   "\" is \"" + frame.file + "\", expected a file below captures/" + capture,
               ""};
}

/// The job, unless there is one for the same already: from the run that was interrupted.
Status AddFollowUp(Database& database, const NewJob& job, const std::string& now,
                   std::vector<EventRecord>& events) {
  Statement same = database.Prepare("SELECT 1 FROM jobs WHERE kind = ? AND body = ?");
  const bool is_known = same.Bind(JobKindName(job.kind)).Bind(job.body).Step();
  ROTUNDA_RETURN_IF_ERROR(same.status());
  if (is_known) return {};
  const auto added = AddJobRow(database, job, now, events);
  return added ? Status() : Status(added.error());
}

}  // namespace

Result<std::string> FreeCaptureId(Store& store) {
  std::string stem;  // 20261122T230501Z of 2026-11-22T23:05:01.123Z
  for (const char c : store.Now()) {
    if (c == '.') break;
    if (c != '-' && c != ':') stem += c;
  }
  stem += 'Z';
  for (int n = 1; n <= kMaxIdsASecond; ++n) {
    std::string id = n == 1 ? stem : stem + "-" + std::to_string(n);
    ROTUNDA_ASSIGN_OR_RETURN(const bool taken, IsTaken(store, id));
    if (!taken) return id;
  }
  return Error{ErrorCode::kFailed, "too many captures in one second", stem};
}

Result<CaptureRecord> RecordCapture(Store& store, const std::string& id,
                                    const std::optional<NewJob>& follow_up) {
  const fs::path folder = store.CaptureFolder(id);
  ROTUNDA_ASSIGN_OR_RETURN(const FrameSet set, ReadFrameSet(folder));
  if (!IsStoreId(id) || set.plain_folder) {
    return Error{ErrorCode::kBadInput, "is not a frame set with a usable name", folder.string()};
  }
  CaptureRecord capture;
  capture.id = id;
  capture.captured_at = IsUtcTime(set.captured_at) ? set.captured_at : store.Now();
  capture.subject = set.subject;
  capture.frames = set.frames.size();
  for (const Frame& frame : set.frames) capture.ok_frames += frame.status == "ok";
  capture.calibration = CalibrationInSet(folder);
  const Reasons reasons = ReasonsInSet(folder);

  ROTUNDA_RETURN_IF_ERROR(store.Write([&](Database& database, auto& events) -> Status {
    const Result<CaptureRecord> known = SelectCapture(database, id);
    if (!known && known.error().code != ErrorCode::kNotFound) return known.error();
    if (!known) {
      ROTUNDA_RETURN_IF_ERROR(InsertCapture(database, capture, set, reasons));
      events.push_back(
          MakeEvent("capture_stored", id, {{"ok", capture.ok_frames}, {"of", capture.frames}}));
    }
    return follow_up ? AddFollowUp(database, *follow_up, store.Now(), events) : Status();
  }));
  return FindCapture(store, id);
}

Result<CaptureRecord> FindCapture(Store& store, const std::string& id) {
  Result<CaptureRecord> capture = NotFound("capture", id);
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    capture = SelectCapture(database, id);
    return Status();
  }));
  return capture;
}

Result<Listing<CaptureRecord>> ListCaptures(Store& store, const Page& page, Speakers speakers) {
  ROTUNDA_RETURN_IF_ERROR(CheckPage(page));
  Result<Listing<CaptureRecord>> listing = Listing<CaptureRecord>();
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) -> Status {
    std::string where;
    Place after;
    if (!page.after.empty()) {
      ROTUNDA_ASSIGN_OR_RETURN(after, PlaceAfter(page.after, 2, [&](const std::string& id) {
                                 return PlaceOfCapture(database, id);
                               }));
      where = "WHERE (c.captured_at, c.id) < (?, ?) ";
    }
    Statement rows = database.Prepare(SelectText(speakers) + where +
                                      "ORDER BY c.captured_at DESC, c.id DESC LIMIT ?");
    for (const std::string& value : after) rows.Bind(value);
    rows.Bind(uint64_t{page.limit + 1});
    listing = ReadListing<CaptureRecord>(
        rows, page.limit, ReadCapture,
        [](const CaptureRecord& capture) { return PlaceText(PlaceOf(capture)); });
    return Status();
  }));
  return listing;
}

Result<std::vector<FrameRecord>> ListFrames(Store& store, const std::string& capture) {
  std::vector<FrameRecord> frames;
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) -> Status {
    ROTUNDA_RETURN_IF_ERROR(SelectCapture(database, capture));
    Statement row = database.Prepare(
        "SELECT camera, serial, file, status, reason, xxh3, width_px, height_px FROM frames "
        "WHERE capture = ? ORDER BY camera");
    row.Bind(capture);
    while (row.Step()) {
      ROTUNDA_ASSIGN_OR_RETURN(frames.emplace_back(), ReadFrame(row, capture));
    }
    return row.status();
  }));
  return frames;
}

}  // namespace rotunda::daemon
