#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/events.h"
#include "daemon/store_records.h"
#include "sfm/core/result.h"

namespace rotunda::daemon {

class Database;  // daemon/store_sql.h
class Store;

using WallClock = std::function<std::chrono::system_clock::time_point()>;
/// "2026-11-22T23:05:01.123Z".
std::string TimeText(std::chrono::system_clock::time_point time);

/// Whether `id` may be the name of a capture, calibration or reconstruction: 1 to 100 letters,
/// digits, '-', '_' and '.', the first a letter or digit. What passes cannot leave its folder.
bool IsStoreId(std::string_view id);

struct StoreOptions {
  std::filesystem::path state_folder;  // made when it is missing
  WallClock clock;
  DriftLimits drift;
  /// What a capture job asks to be done with its shot: queued when a start finds the shot on the
  /// disk that the job, which did not come to its end, had taken. Null: nothing.
  std::function<std::optional<NewJob>(const Store&, const JobRecord& capture_job)> follow_up =
      nullptr;
  /// Called now and then while Open() goes through what lies on the disk, which may take minutes.
  /// Null: nobody waits.
  std::function<void()> still_opening = nullptr;
};

/// A folder, and what is free on its disk.
struct DiskRoom {
  std::filesystem::path folder;
  uint64_t free_bytes = 0;
};

/// What Open() found and put right.
struct RecoveryReport {
  std::vector<std::string> adopted;     // folders on disk that had no row: now they have
  std::vector<std::string> gone;        // rows whose folder is missing: marked
  std::vector<std::string> unreadable;  // folders without a row that are not what they should be
  std::vector<int64_t> interrupted;     // jobs whose end was not stored
  size_t removed_temporaries = 0;       // what killed writers left half-written
};

/// The daemon's memory: one SQLite file (rotunda.db) and the folders captures, calibrations and
/// reconstructions beside it, which hold the files. What a Record... function has returned for
/// survives a crash and a power cut. May be used from any thread; the tables' own functions are in
/// store_captures.h, store_calibrations.h, store_reconstructions.h, store_jobs.h, store_events.h.
class Store {
 public:
  /// Opens or makes the store, brings the schema up to date, checks the file's integrity, and puts
  /// right what a crash left. `events` outlives the store. Errors: another daemon has the folder;
  /// a database of another program, of a newer version, or damaged (says what to do); kIo.
  static Result<std::unique_ptr<Store>> Open(StoreOptions options, EventHub& events);
  ~Store();
  Store(const Store&) = delete;
  Store& operator=(const Store&) = delete;

  const RecoveryReport& recovery() const { return recovery_; }
  const StoreOptions& options() const { return options_; }
  std::string Now() const { return TimeText(options_.clock()); }

  /// The folder, of the state folder and those in it, whose disk has least room: any of them may be
  /// a mount or a link to another disk. kIo names one whose disk cannot be asked. Who asks while an
  /// earlier look still hangs is not held up: kIo.
  Result<DiskRoom> LeastRoom();
  /// Gives the disk back what was set aside, so that on a full one it can be stored how the daemon
  /// ends, or that something goes. From any thread, as often as one likes.
  void FreeSpareRoom();
  /// Room for FreeSpareRoom(), as at the start. A disk that is full has none, which is no error.
  void SetSpareRoomAside();
  std::filesystem::path CaptureFolder(const std::string& id) const;
  std::filesystem::path CalibrationFolder(const std::string& id) const;
  std::filesystem::path ReconstructionFolder(const std::string& id) const;

  /// For the tables' functions. Reads see the last commit and do not wait for writers.
  using Reading = std::function<Status(Database& database)>;
  Status Read(const Reading& reading);
  /// All of it or nothing, durable on return. What `writing` appends to `events` (without number
  /// and time) is stored with it and published after the commit.
  using Writing = std::function<Status(Database& database, std::vector<EventRecord>& events)>;
  Status Write(const Writing& writing);
  /// All reads and writes of `many` are one transaction, made durable once; each write alone is
  /// still all or nothing. For Open(), as long as nobody else uses the store.
  Status WriteTogether(const std::function<Status()>& many);

 private:
  struct Connections;
  Store(StoreOptions options, EventHub& events);
  Status WriteWithin(const Writing& writing);
  /// The state folder and those in it.
  std::vector<std::filesystem::path> Folders() const;
  Status LockFolder();
  Status OpenDatabase();

  const StoreOptions options_;
  EventHub& hub_;
  std::unique_ptr<Connections> connections_;
  RecoveryReport recovery_;
};

/// A copy of the database of a state folder, whole and consistent, while a daemon uses it or not.
/// `file` must not exist; its owner alone may read it. Pictures and other files are not in it: copy
/// the folders beside it.
Status BackUpStore(const std::filesystem::path& state_folder, const std::filesystem::path& file);

}  // namespace rotunda::daemon
