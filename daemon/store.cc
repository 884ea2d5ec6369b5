#include "daemon/store.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <iterator>
#include <mutex>
#include <system_error>
#include <utility>

#include "daemon/migrations.h"
#include "daemon/slow_look.h"
#include "daemon/store_folder.h"
#include "daemon/store_recovery.h"
#include "daemon/store_sql.h"
#include "sfm/core/durability.h"

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;

constexpr char kDatabaseName[] = "rotunda.db";
constexpr char kLockName[] = "lock";
constexpr char kSpareRoomName[] = "spare-room";
// A hundred times what the end of a job takes in the database and its log.
constexpr off_t kSpareRoom_bytes = 1 << 20;
constexpr char kCaptures[] = "captures";
constexpr char kCalibrations[] = "calibrations";
constexpr char kReconstructions[] = "reconstructions";
constexpr size_t kMaxIdLength = 100;

Error Damaged(const std::string& finding, const fs::path& file) {
  return {ErrorCode::kBadInput,
          "is damaged (" + finding +
              "): move it away with its -wal and -shm and put the newest backup in its place, or "
              "none: captures, calibrations and reconstructions on disk are found again; nothing "
              "was changed",
          file.string()};
}

/// What SQLite says of a file that is no database, in our words.
Error AsDamaged(const Error& error, const fs::path& file) {
  return error.code == ErrorCode::kBadInput ? Damaged(error.message, file) : error;
}

Status CheckIntegrity(Database& database) {
  Statement check = database.Prepare("PRAGMA integrity_check(1)");
  const std::string finding = check.Step() ? check.Text() : "";
  if (!check.status()) return AsDamaged(check.status().error(), database.name());
  if (finding != "ok") return Damaged(finding, database.name());
  ROTUNDA_ASSIGN_OR_RETURN(const int64_t orphans,
                           database.Number("SELECT count(*) FROM pragma_foreign_key_check"));
  if (orphans == 0) return {};
  return Damaged(std::to_string(orphans) + " rows without the row they belong to", database.name());
}

Result<DiskRoom> FindLeastRoom(const std::vector<fs::path>& folders) {
  std::optional<DiskRoom> least;
  for (const fs::path& folder : folders) {
    struct statvfs disk = {};
    if (::statvfs(folder.c_str(), &disk) != 0) {
      return Error{ErrorCode::kIo, std::generic_category().message(errno), folder.string()};
    }
    const uint64_t free_bytes = uint64_t{disk.f_bavail} * disk.f_frsize;
    if (!least || free_bytes < least->free_bytes) least = DiskRoom{folder, free_bytes};
  }
  return least.value();
}

Status AppendEvents(Database& database, const std::string& now, std::vector<EventRecord>& events) {
  for (EventRecord& event : events) {
    event.at = now;
    ROTUNDA_RETURN_IF_ERROR(
        database.Prepare("INSERT INTO events (at, kind, about, data) VALUES (?, ?, ?, ?)")
            .Bind(event.at)
            .Bind(event.kind)
            .Bind(event.about)
            .Bind(event.data)
            .Run());
    event.number = database.LastInsertedRow();
  }
  return {};
}

}  // namespace

std::string TimeText(std::chrono::system_clock::time_point time) {
  using std::chrono::milliseconds;
  const auto since_epoch = std::chrono::floor<milliseconds>(time.time_since_epoch());
  const auto whole = std::chrono::floor<std::chrono::seconds>(since_epoch);
  const std::time_t seconds = whole.count();
  std::tm utc = {};
  gmtime_r(&seconds, &utc);
  char text[64];
  const size_t size = std::strftime(text, sizeof(text), "%Y-%m-%dT%H:%M:%S", &utc);
  std::snprintf(text + size, sizeof(text) - size, ".%03dZ",
                static_cast<int>((since_epoch - whole).count()));
  return text;
}

bool IsStoreId(std::string_view id) {
  const auto is_alnum = [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
  };
  return !id.empty() && id.size() <= kMaxIdLength && is_alnum(id.front()) &&
         std::all_of(id.begin(), id.end(),
                     [&](char c) { return is_alnum(c) || c == '-' || c == '_' || c == '.'; });
}

namespace {

/// Undoes what was begun unless it was ended: also when a caller's function throws.
class OpenTransaction {
 public:
  explicit OpenTransaction(Database& database, const char* undo = "ROLLBACK",
                           const char* end = "COMMIT")
      : database_(database), undo_(undo), end_(end) {}
  ~OpenTransaction() {
    if (open_) static_cast<void>(database_.Execute(undo_));
  }
  OpenTransaction(const OpenTransaction&) = delete;
  OpenTransaction& operator=(const OpenTransaction&) = delete;
  Status Commit() {
    Status status = database_.Execute(end_);
    open_ = !status.ok();
    return status;
  }

 private:
  Database& database_;
  const char* const undo_;
  const char* const end_;
  bool open_ = true;
};

}  // namespace

struct Store::Connections {
  std::mutex writer_mutex, reader_mutex;
  std::optional<Database> writer, reader;
  std::optional<std::vector<EventRecord>> together;  // events of WriteTogether() under way
  int lock_fd = -1;
  SlowLook<Result<DiskRoom>> room{DiskRoom()};

  ~Connections() {
    if (lock_fd >= 0) ::close(lock_fd);
  }
};

Store::Store(StoreOptions options, EventHub& events)
    : options_(std::move(options)), hub_(events), connections_(std::make_unique<Connections>()) {}

Store::~Store() = default;

Result<std::unique_ptr<Store>> Store::Open(StoreOptions options, EventHub& events) {
  std::unique_ptr<Store> store(new Store(std::move(options), events));
  const fs::path& state = store->options_.state_folder;
  for (const fs::path& folder : store->Folders()) {
    ROTUNDA_RETURN_IF_ERROR(MakeWritableFolder(folder));
  }
  for (const char* file : {kLockName, kDatabaseName}) {
    ROTUNDA_RETURN_IF_ERROR(CheckWritableFile(state / file));
  }
  ROTUNDA_RETURN_IF_ERROR(store->LockFolder());
  // What an earlier run left of it is for recovery, which writes too.
  store->FreeSpareRoom();
  ROTUNDA_RETURN_IF_ERROR(store->OpenDatabase());
  Result<RecoveryReport> recovery = Recover(*store);
  if (!recovery) {
    return AsDamaged(recovery.error(), state / kDatabaseName);
  }
  store->recovery_ = *std::move(recovery);
  store->SetSpareRoomAside();
  // So that there is an answer for those who ask while the next look is under way.
  static_cast<void>(store->LeastRoom());
  return store;
}

Status Store::LockFolder() {
  const fs::path file = options_.state_folder / kLockName;
  connections_->lock_fd = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (connections_->lock_fd < 0) {
    return Error{ErrorCode::kIo, std::generic_category().message(errno), file.string()};
  }
  if (::flock(connections_->lock_fd, LOCK_EX | LOCK_NB) == 0) return {};
  return Error{ErrorCode::kAlreadyExists, "another rotundad is using this state folder",
               options_.state_folder.string()};
}

void Store::SetSpareRoomAside() {
  const fs::path file = options_.state_folder / kSpareRoomName;
  const int fd = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (fd < 0) return;
  static_cast<void>(::posix_fallocate(fd, 0, kSpareRoom_bytes));
  ::close(fd);
}

void Store::FreeSpareRoom() { ::unlink((options_.state_folder / kSpareRoomName).c_str()); }

Status Store::OpenDatabase() {
  const fs::path file = options_.state_folder / kDatabaseName;
  if (options_.still_opening) options_.still_opening();
  Result<Database> opened = Database::Open(file, Database::Access::kReadWrite);
  if (!opened) return AsDamaged(opened.error(), file);
  Database& writer = connections_->writer.emplace(std::move(*opened));
  // Asked before anything is written: a foreign or damaged file is left as it is.
  const Result<int64_t> version = writer.Number("PRAGMA user_version");
  if (!version) return AsDamaged(version.error(), file);
  ROTUNDA_RETURN_IF_ERROR(CheckSchema(writer, SchemaSteps()));
  ROTUNDA_RETURN_IF_ERROR(CheckIntegrity(writer));
  ROTUNDA_RETURN_IF_ERROR(
      writer.Execute("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL;"
                     "PRAGMA foreign_keys = ON"));
  ROTUNDA_RETURN_IF_ERROR(Migrate(writer, SchemaSteps()));
  ROTUNDA_ASSIGN_OR_RETURN(Database reader, Database::Open(file, Database::Access::kReadOnly));
  connections_->reader.emplace(std::move(reader));
  return {};
}

std::vector<fs::path> Store::Folders() const {
  std::vector<fs::path> folders = {options_.state_folder};
  for (const char* name : {kCaptures, kCalibrations, kReconstructions}) {
    folders.push_back(options_.state_folder / name);
  }
  return folders;
}

Result<DiskRoom> Store::LeastRoom() {
  const std::vector<fs::path> folders = Folders();
  const auto room =
      connections_->room.Look([&](const Result<DiskRoom>&) { return FindLeastRoom(folders); });
  if (room) return *room;
  return Error{ErrorCode::kIo, "does not answer: are all disks and shares of its folders there?",
               options_.state_folder.string()};
}

fs::path Store::CaptureFolder(const std::string& id) const {
  return options_.state_folder / kCaptures / id;
}
fs::path Store::CalibrationFolder(const std::string& id) const {
  return options_.state_folder / kCalibrations / id;
}
fs::path Store::ReconstructionFolder(const std::string& id) const {
  return options_.state_folder / kReconstructions / id;
}

Status Store::Read(const Reading& reading) {
  if (connections_->together) return reading(*connections_->writer);  // sees what is not committed
  const std::lock_guard lock(connections_->reader_mutex);
  Database& database = *connections_->reader;
  ROTUNDA_RETURN_IF_ERROR(database.Execute("BEGIN"));
  const OpenTransaction transaction(database);
  return reading(database);
}

Status Store::Write(const Writing& writing) {
  if (connections_->together) return WriteWithin(writing);
  const std::lock_guard lock(connections_->writer_mutex);
  Database& database = *connections_->writer;
  std::vector<EventRecord> events;
  ROTUNDA_RETURN_IF_ERROR(database.Execute("BEGIN IMMEDIATE"));
  OpenTransaction transaction(database);
  ROTUNDA_RETURN_IF_ERROR(writing(database, events));
  ROTUNDA_RETURN_IF_ERROR(AppendEvents(database, Now(), events));
  ROTUNDA_RETURN_IF_ERROR(transaction.Commit());
  hub_.Publish(events);
  return {};
}

Status Store::WriteWithin(const Writing& writing) {
  Database& database = *connections_->writer;
  std::vector<EventRecord> events;
  ROTUNDA_RETURN_IF_ERROR(database.Execute("SAVEPOINT one"));
  OpenTransaction savepoint(database, "ROLLBACK TO one; RELEASE one", "RELEASE one");
  ROTUNDA_RETURN_IF_ERROR(writing(database, events));
  ROTUNDA_RETURN_IF_ERROR(AppendEvents(database, Now(), events));
  ROTUNDA_RETURN_IF_ERROR(savepoint.Commit());
  std::move(events.begin(), events.end(), std::back_inserter(*connections_->together));
  return {};
}

Status Store::WriteTogether(const std::function<Status()>& many) {
  struct Ended {  // also when `many` throws
    std::optional<std::vector<EventRecord>>& together;
    ~Ended() { together.reset(); }
  };
  Database& database = *connections_->writer;
  ROTUNDA_RETURN_IF_ERROR(database.Execute("BEGIN IMMEDIATE"));
  OpenTransaction transaction(database);
  connections_->together.emplace();
  const Ended ended{connections_->together};
  ROTUNDA_RETURN_IF_ERROR(many());
  ROTUNDA_RETURN_IF_ERROR(transaction.Commit());
  hub_.Publish(*connections_->together);
  return {};
}

namespace {

/// An empty file beside `file` that its owner alone may read, under a name that nobody else has.
Result<fs::path> MakePrivateFile(const fs::path& file) {
  std::string name = file.string() + ".XXXXXX";
  const int fd = ::mkostemp(name.data(), O_CLOEXEC);  // 0600, O_EXCL
  if (fd < 0) return Error{ErrorCode::kIo, std::generic_category().message(errno), file.string()};
  ::close(fd);
  return fs::path(name);
}

/// Puts the copy that was made under `partial` into place, durably.
Status PutIntoPlace(const fs::path& partial, const fs::path& file) {
  ROTUNDA_RETURN_IF_ERROR(MakeDurable(partial));
  if (::rename(partial.c_str(), file.c_str()) != 0) {
    return Error{ErrorCode::kIo, std::generic_category().message(errno), file.string()};
  }
  return MakeDurable(file.has_parent_path() ? file.parent_path() : ".", O_DIRECTORY);
}

}  // namespace

Status BackUpStore(const fs::path& state_folder, const fs::path& file) {
  const fs::path source = state_folder / kDatabaseName;
  std::error_code ignored;
  if (!fs::exists(source, ignored)) {
    return Error{ErrorCode::kNotFound, "there is no database", source.string()};
  }
  if (fs::exists(file, ignored)) {
    return Error{ErrorCode::kAlreadyExists, "exists already", file.string()};
  }
  ROTUNDA_ASSIGN_OR_RETURN(Database database, Database::Open(source, Database::Access::kReadOnly));
  ROTUNDA_RETURN_IF_ERROR(CheckSchema(database, SchemaSteps()));
  ROTUNDA_ASSIGN_OR_RETURN(const fs::path partial, MakePrivateFile(file));
  Status status = database.CopyTo(partial);
  if (status) status = PutIntoPlace(partial, file);
  if (!status) fs::remove(partial, ignored);
  return status;
}

}  // namespace rotunda::daemon
