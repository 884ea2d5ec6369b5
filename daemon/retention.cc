#include "daemon/retention.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <system_error>

#include "daemon/store_captures.h"
#include "daemon/store_internal.h"
#include "daemon/store_reconstructions.h"
#include "daemon/store_sql.h"
#include "sfm/core/bytes_text.h"

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxDays = 36500;
constexpr char kBelowReserve[] = "the disk has less room than the reserve";

/// A job that has not ended names its captures by their ids in its body, or makes one.
constexpr char kUnclaimed[] =
    "NOT EXISTS (SELECT 1 FROM jobs WHERE state IN ('queued', 'running') AND "
    "(product = c.id OR instr(body, '\"' || c.id || '\"') > 0)) ";

/// The captures that every given rule names and no job needs, oldest first. Days are counted from
/// the newest capture when the clock is ahead of it: one that is wrong must not take everything.
Result<std::vector<std::string>> NamedByPolicy(Store& store, const RetentionPolicy& policy) {
  std::string query = "SELECT id FROM captures AS c WHERE 1 ";
  if (policy.keep_count) {
    query += "AND id NOT IN (SELECT id FROM captures ORDER BY captured_at DESC, id DESC LIMIT " +
             std::to_string(*policy.keep_count) + ") ";
  }
  if (policy.keep_days) {
    query +=
        "AND captured_at < strftime('%Y-%m-%dT%H:%M:%fZ', "
        "min(?1, (SELECT max(captured_at) FROM captures)), '-" +
        std::to_string(*policy.keep_days) + " days') ";
  }
  query += "AND " + std::string(kUnclaimed) + "ORDER BY captured_at, id";
  std::vector<std::string> named;
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    Statement row = database.Prepare(query);
    if (policy.keep_days) row.Bind(store.Now());
    while (row.Step()) named.push_back(row.Id());
    return row.status();
  }));
  return named;
}

/// Out of sight in one step, so that no crash leaves half a folder under its name; what is left of
/// it goes at the next start.
Status RemoveFolder(const fs::path& folder) {
  fs::path hidden = folder.parent_path() / ("." + folder.filename().string() + ".tmp-removed");
  std::error_code failed;
  fs::remove_all(hidden, failed);
  if (!failed && fs::exists(folder, failed)) fs::rename(folder, hidden, failed);
  if (!failed) fs::remove_all(hidden, failed);
  return failed ? Status(Error{ErrorCode::kIo, failed.message(), folder.string()}) : Status();
}

/// The row of a capture, with those that hang on it. False: a job has claimed the capture since it
/// was named, and it stays.
Result<bool> RemoveRow(Store& store, const std::string& id) {
  bool removed = false;
  ROTUNDA_RETURN_IF_ERROR(store.Write([&](Database& database, auto& events) -> Status {
    ROTUNDA_RETURN_IF_ERROR(
        database.Prepare("DELETE FROM captures AS c WHERE id = ? AND " + std::string(kUnclaimed))
            .Bind(id)
            .Run());
    ROTUNDA_ASSIGN_OR_RETURN(const int64_t rows, database.Number("SELECT changes()"));
    removed = rows == 1;
    if (removed) {
      events.push_back(MakeEvent("capture_removed", id, {{"reason", "retention policy"}}));
    }
    return {};
  }));
  return removed;
}

/// Rows first: a crash in between leaves folders, which are adopted and named by the policy again.
/// The capture's folder last: without it its reconstructions could not be adopted. A full disk has
/// no room to store that something goes but what was set aside. False: as RemoveRow.
Result<bool> RemoveCapture(Store& store, const std::string& id) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<ReconstructionRecord> reconstructions,
                           ListReconstructions(store, id));
  Result<bool> removed = RemoveRow(store, id);
  if (!removed) {
    store.FreeSpareRoom();
    removed = RemoveRow(store, id);
    if (!removed) store.SetSpareRoomAside();  // it was not for want of room
  }
  if (!removed || !*removed) return removed;
  for (const ReconstructionRecord& reconstruction : reconstructions) {
    ROTUNDA_RETURN_IF_ERROR(RemoveFolder(store.ReconstructionFolder(reconstruction.id)));
  }
  ROTUNDA_RETURN_IF_ERROR(RemoveFolder(store.CaptureFolder(id)));
  store.SetSpareRoomAside();
  return true;
}

}  // namespace

Status RetentionPolicy::Validate() const {
  if (keep_count && *keep_count < 1) {
    return Error{ErrorCode::kInvalidArgument, "is 0, expected at least 1", "retention.keep_count"};
  }
  if (keep_days && (*keep_days < 1 || *keep_days > kMaxDays)) {
    return Error{ErrorCode::kInvalidArgument,
                 "is " + std::to_string(*keep_days) + ", expected 1 to " + std::to_string(kMaxDays),
                 "retention.keep_days"};
  }
  return {};
}

Result<std::vector<std::string>> ApplyRetention(Store& store, const RetentionPolicy& policy,
                                                std::stop_token stop) {
  ROTUNDA_RETURN_IF_ERROR(policy.Validate());
  if (!policy.keep_count && !policy.keep_days) return std::vector<std::string>();
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<std::string> named, NamedByPolicy(store, policy));
  std::vector<std::string> gone;
  for (const std::string& id : named) {
    if (stop.stop_requested()) break;
    ROTUNDA_ASSIGN_OR_RETURN(const bool removed, RemoveCapture(store, id));
    if (removed) gone.push_back(id);
  }
  return gone;
}

Status CheckDiskReserve(Store& store, uint64_t reserve_bytes) {
  ROTUNDA_ASSIGN_OR_RETURN(const DiskRoom room, store.LeastRoom());
  if (room.free_bytes >= reserve_bytes) return {};
  return Error{ErrorCode::kIo,
               std::string(kBelowReserve) + ": " + BytesText(room.free_bytes) + " are free, " +
                   BytesText(reserve_bytes) +
                   " are kept in reserve; make room (move captures away, or set a retention "
                   "policy), then try again",
               room.folder.string()};
}

bool IsBelowReserve(const Error& error) { return error.message.starts_with(kBelowReserve); }

}  // namespace rotunda::daemon
