#include "daemon/store_recovery.h"

#include <algorithm>
#include <functional>
#include <set>
#include <span>
#include <string_view>
#include <system_error>
#include <tuple>
#include <utility>

#include "daemon/store_calibrations.h"
#include "daemon/store_captures.h"
#include "daemon/store_internal.h"
#include "daemon/store_reconstructions.h"
#include "daemon/store_sql.h"

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;

// Folders whose rows are made durable together: a thousand found ones must not take a thousand
// times the disk's wait.
constexpr size_t kBatch = 100;

/// A table whose rows stand for folders.
struct FolderTable {
  const char* table;  // and name of the folder that holds the folders
  const char* what;   // in events
  const char* file;   // that makes a folder one of these
  std::function<Status(Store&, const std::string& id)> record;
};

/// What the job that took the shot, and was killed or stopped before it could enter it, asked for.
Result<std::optional<NewJob>> FollowUpOf(Store& store, const std::string& capture) {
  ROTUNDA_ASSIGN_OR_RETURN(const auto job, FindJobByProduct(store, capture));
  if (!job || job->kind != JobKind::kCapture || !store.options().follow_up) {
    return std::optional<NewJob>();
  }
  const bool unfinished = job->state == JobState::kRunning || job->state == JobState::kInterrupted;
  return unfinished ? store.options().follow_up(store, *job) : std::nullopt;
}

const std::vector<FolderTable>& Tables() {
  // Reconstructions refer to captures, so they come last.
  static const std::vector<FolderTable> tables = {
      {"calibrations", "calibration", "calibration.json",
       [](Store& store, const std::string& id) -> Status {
         ROTUNDA_RETURN_IF_ERROR(RecordCalibration(store, id));
         return {};
       }},
      {"captures", "capture", "frameset.json",
       [](Store& store, const std::string& id) -> Status {
         ROTUNDA_ASSIGN_OR_RETURN(const auto follow_up, FollowUpOf(store, id));
         ROTUNDA_RETURN_IF_ERROR(RecordCapture(store, id, follow_up));
         return {};
       }},
      {"reconstructions", "reconstruction", "poses.json",
       [](Store& store, const std::string& id) -> Status {
         ROTUNDA_RETURN_IF_ERROR(RecordReconstruction(store, id));
         return {};
       }}};
  return tables;
}

/// ".<name>.tmp-<pid>-<n>", as OutputFolder makes them; the lock on the state folder says that
/// nobody is writing one.
bool IsTemporary(const std::string& name) {
  return name.starts_with('.') && name.find(".tmp-") != std::string::npos;
}

/// An id without the digits it ends with, how many these are, and these: "x-r9" comes before
/// "x-r10".
std::tuple<std::string_view, size_t, std::string_view> OrderOf(std::string_view id) {
  const size_t digits = id.find_last_not_of("0123456789") + 1;
  return {id.substr(0, digits), id.size() - digits, id.substr(digits)};
}

struct FolderListing {
  std::vector<std::string> ids;  // by their numbers (OrderOf)
  std::vector<fs::path> temporaries;
};

Result<FolderListing> ListFolder(const fs::path& folder) {
  FolderListing listing;
  std::error_code failed;
  for (fs::directory_iterator entry(folder, failed), end; !failed && entry != end;
       entry.increment(failed)) {
    const std::string name = entry->path().filename().string();
    if (IsTemporary(name)) {
      listing.temporaries.push_back(entry->path());
    } else if (entry->is_directory(failed) && !failed) {
      listing.ids.push_back(name);
    }
  }
  if (failed) return Error{ErrorCode::kIo, failed.message(), folder.string()};
  std::sort(listing.ids.begin(), listing.ids.end(),
            [](const auto& a, const auto& b) { return OrderOf(a) < OrderOf(b); });
  return listing;
}

struct KnownRow {
  std::string id;
  bool files_gone = false;
};

Result<std::vector<KnownRow>> KnownRows(Store& store, const FolderTable& table) {
  std::vector<KnownRow> rows;
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    Statement row = database.Prepare("SELECT id, files_gone FROM " + std::string(table.table));
    while (row.Step()) {
      KnownRow& known = rows.emplace_back();
      known.id = row.Id();
      known.files_gone = row.Bool();
    }
    return row.status();
  }));
  return rows;
}

Status MarkGone(Store& store, const FolderTable& table, const std::string& id, bool gone) {
  return store.Write([&](Database& database, auto& events) {
    if (gone) events.push_back(MakeEvent(std::string(table.what) + "_gone", id, Json::object()));
    return database
        .Prepare("UPDATE " + std::string(table.table) +
                 " SET files_gone = ? "
                 "WHERE id = ?")
        .Bind(gone)
        .Bind(id)
        .Run();
  });
}

std::string PlaceOf(const FolderTable& table, const std::string& id) {
  return std::string(table.table) + "/" + id;
}

/// kIo: the disk or the database refused.
Status AdoptFolder(Store& store, const FolderTable& table, const std::string& id,
                   RecoveryReport& report) {
  if (const Status recorded = table.record(store, id); !recorded) {
    if (recorded.error().code == ErrorCode::kIo) return recorded;
    // Stays where it is, for a person to look at; the next start tries again.
    report.unreadable.push_back(PlaceOf(table, id) + ": " + recorded.error().ToString());
    return {};
  }
  ROTUNDA_RETURN_IF_ERROR(store.Write([&](Database&, auto& events) {
    events.push_back(MakeEvent(std::string(table.what) + "_adopted", id, Json::object()));
    return Status();
  }));
  report.adopted.push_back(PlaceOf(table, id));
  return {};
}

void AdoptFolders(Store& store, const FolderTable& table, std::span<const std::string> ids,
                  RecoveryReport& report) {
  RecoveryReport batch = report;
  const Status together = store.WriteTogether([&]() -> Status {
    for (const std::string& id : ids) {
      ROTUNDA_RETURN_IF_ERROR(AdoptFolder(store, table, id, batch));
    }
    return {};
  });
  if (together) {
    report = std::move(batch);
    return;
  }
  // One that the disk refuses must not keep the others out.
  for (const std::string& id : ids) {
    if (const Status alone = AdoptFolder(store, table, id, report); !alone) {
      report.unreadable.push_back(PlaceOf(table, id) + ": " + alone.error().ToString());
    }
  }
}

void StillHere(const Store& store) {
  if (store.options().still_opening) store.options().still_opening();
}

/// Marks rows whose folder is missing and those whose folder is back.
Status CheckRows(Store& store, const FolderTable& table, const std::vector<KnownRow>& rows,
                 RecoveryReport& report) {
  const fs::path folder = store.options().state_folder / table.table;
  return store.WriteTogether([&]() -> Status {
    for (size_t i = 0; i < rows.size(); ++i) {
      if (i % kBatch == 0) StillHere(store);
      std::error_code failed;
      const bool is_gone = !fs::exists(folder / rows[i].id / table.file, failed);
      if (is_gone) report.gone.push_back(PlaceOf(table, rows[i].id));
      if (is_gone != rows[i].files_gone) {
        ROTUNDA_RETURN_IF_ERROR(MarkGone(store, table, rows[i].id, is_gone));
      }
    }
    return {};
  });
}

Status RecoverTable(Store& store, const FolderTable& table, RecoveryReport& report) {
  const fs::path folder = store.options().state_folder / table.table;
  ROTUNDA_ASSIGN_OR_RETURN(const FolderListing listing, ListFolder(folder));
  for (const fs::path& temporary : listing.temporaries) {
    StillHere(store);
    std::error_code failed;
    fs::remove_all(temporary, failed);
    if (failed) return Error{ErrorCode::kIo, failed.message(), temporary.string()};
    ++report.removed_temporaries;
  }
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<KnownRow> rows, KnownRows(store, table));
  ROTUNDA_RETURN_IF_ERROR(CheckRows(store, table, rows, report));
  std::set<std::string> known;
  for (const KnownRow& row : rows) known.insert(row.id);
  std::vector<std::string> found;
  for (const std::string& id : listing.ids) {
    if (!known.contains(id)) found.push_back(id);
  }
  for (size_t begin = 0; begin < found.size(); begin += kBatch) {
    StillHere(store);
    const size_t count = std::min(kBatch, found.size() - begin);
    AdoptFolders(store, table, std::span(found).subspan(begin, count), report);
  }
  return {};
}

/// What jobs have reserved are names of folders, too.
Status CheckProducts(Store& store) {
  return store.Read([](Database& database) {
    Statement row = database.Prepare("SELECT product FROM jobs");
    while (row.Step()) static_cast<void>(row.OptionalId());
    return row.status();
  });
}

Status InterruptJobs(Store& store, RecoveryReport& report) {
  while (true) {
    ROTUNDA_ASSIGN_OR_RETURN(const Listing<JobRecord> running,
                             ListJobs(store, {kMaxPageLimit, ""}, JobState::kRunning));
    if (running.items.empty()) return {};
    for (JobRecord job : running.items) {
      job.state = JobState::kInterrupted;
      job.error =
          "the daemon ended while it ran and could not store how: it died, hung, or had no room on "
          "its disk (its log says more)";
      ROTUNDA_RETURN_IF_ERROR(EndJob(store, job));
      report.interrupted.push_back(job.number);
    }
  }
}

}  // namespace

Result<RecoveryReport> Recover(Store& store) {
  RecoveryReport report;
  ROTUNDA_RETURN_IF_ERROR(CheckProducts(store));
  for (const FolderTable& table : Tables()) {
    ROTUNDA_RETURN_IF_ERROR(RecoverTable(store, table, report));
  }
  ROTUNDA_RETURN_IF_ERROR(InterruptJobs(store, report));
  return report;
}

}  // namespace rotunda::daemon
