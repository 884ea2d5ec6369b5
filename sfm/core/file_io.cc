#include "sfm/core/file_io.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cerrno>
#include <functional>
#include <system_error>
#include <utility>

#include "sfm/core/durability.h"

namespace rotunda {
namespace {

namespace fs = std::filesystem;

constexpr size_t kReadBlock = 1 << 16;
constexpr int kMaxTemporaryNames = 10000;

Error IoError(const std::string& what, int error, const fs::path& path) {
  const ErrorCode code = error == ENOENT ? ErrorCode::kNotFound : ErrorCode::kIo;
  return {code, what + ": " + std::generic_category().message(error), path.string()};
}

/// Failing to write is kIo whatever the reason: nothing that was looked for is missing.
Error WriteError(const std::string& what, int error, const fs::path& path) {
  return {ErrorCode::kIo, what + ": " + std::generic_category().message(error), path.string()};
}

/// Owns a descriptor. Close() reports what a delayed write has to say.
class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  int get() const { return fd_; }
  bool ok() const { return fd_ >= 0; }
  int Close() { return ::close(std::exchange(fd_, -1)); }

 private:
  int fd_;
};

Status WriteAll(const Descriptor& file, std::string_view bytes, const fs::path& path) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(file.get(), bytes.data(), bytes.size());
    if (written < 0) {
      if (errno == EINTR) continue;
      return WriteError("cannot write", errno, path);
    }
    bytes.remove_prefix(static_cast<size_t>(written));
  }
  return {};
}

fs::path ParentOf(const fs::path& path) {
  return path.has_parent_path() ? path.parent_path() : fs::path(".");
}

/// Tries `make` on ".<name>.tmp-<pid>-<n>" beside `target` for n = 0, 1, ... until it says
/// something else than EEXIST (0: made).
Result<fs::path> MakeTemporary(const fs::path& target,
                               const std::function<int(const fs::path&)>& make) {
  std::string stem = ".";
  stem += target.filename().string() + ".tmp-" + std::to_string(::getpid()) + "-";
  int error = EEXIST;
  for (int n = 0; n < kMaxTemporaryNames && error == EEXIST; ++n) {
    const fs::path temporary = ParentOf(target) / (stem + std::to_string(n));
    error = make(temporary);
    if (error == 0) return temporary;
  }
  return WriteError("cannot write in " + ParentOf(target).string(), error, target);
}

Status WriteAndSync(Descriptor& file, std::string_view bytes, const fs::path& path) {
  ROTUNDA_RETURN_IF_ERROR(WriteAll(file, bytes, path));
  if (::fsync(file.get()) != 0) return WriteError("cannot make durable", errno, path);
  if (file.Close() != 0) return WriteError("cannot close", errno, path);
  return {};
}

/// Every file and folder below `folder`, then the folder itself.
Status SyncTree(const fs::path& folder) {
  std::error_code error;
  for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const fs::file_status status = entry->symlink_status(error);
    if (error) break;
    if (fs::is_directory(status)) ROTUNDA_RETURN_IF_ERROR(MakeDurable(entry->path(), O_DIRECTORY));
    if (fs::is_regular_file(status)) ROTUNDA_RETURN_IF_ERROR(MakeDurable(entry->path()));
  }
  if (error) return WriteError("cannot list", error.value(), folder);
  return MakeDurable(folder, O_DIRECTORY);
}

/// Whether something can be made at `place`, as far as its folder is concerned; `target` is what
/// the user called it.
Status CheckParent(const fs::path& place, const fs::path& target) {
  std::error_code error;
  const fs::path parent = ParentOf(place);
  if (!fs::is_directory(parent, error)) {
    return Error{ErrorCode::kNotFound,
                 parent.string() + (fs::exists(parent, error) ? " is not a folder"
                                                              : " does not exist: make it first"),
                 target.string()};
  }
  if (::faccessat(AT_FDCWD, parent.c_str(), W_OK | X_OK, AT_EACCESS) == 0) return {};
  return Error{ErrorCode::kInvalidArgument,
               "cannot write in " + parent.string() + ": " + std::generic_category().message(errno),
               target.string()};
}

}  // namespace

Result<std::string> ReadFile(const fs::path& file) {
  Descriptor descriptor(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  if (!descriptor.ok()) return IoError("cannot open", errno, file);
  std::string bytes;
  size_t size = 0;
  while (true) {
    if (bytes.size() < size + kReadBlock) bytes.resize(2 * size + kReadBlock);
    const ssize_t count = ::read(descriptor.get(), bytes.data() + size, bytes.size() - size);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return IoError("cannot read", errno, file);
    if (count == 0) break;
    size += static_cast<size_t>(count);
  }
  bytes.resize(size);
  return bytes;
}

Status WriteNewFile(const fs::path& file, std::string_view bytes) {
  Descriptor descriptor(::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
  if (!descriptor.ok()) return WriteError("cannot make", errno, file);
  ROTUNDA_RETURN_IF_ERROR(WriteAll(descriptor, bytes, file));
  if (descriptor.Close() != 0) return WriteError("cannot close", errno, file);
  return {};
}

Status WriteFileAtomically(const fs::path& file, std::string_view bytes) {
  if (!file.has_filename()) {
    return Error{ErrorCode::kInvalidArgument, "expected the name of a file", file.string()};
  }
  int fd = -1;
  ROTUNDA_ASSIGN_OR_RETURN(
      const fs::path temporary, MakeTemporary(file, [&fd](const fs::path& path) {
        fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        return fd >= 0 ? 0 : errno;
      }));
  Descriptor descriptor(fd);
  Status status = WriteAndSync(descriptor, bytes, file);
  if (status.ok() && ::rename(temporary.c_str(), file.c_str()) != 0) {
    status = WriteError("cannot put into place", errno, file);
  }
  if (!status.ok()) {
    ::unlink(temporary.c_str());
    return status;
  }
  return MakeDurable(ParentOf(file), O_DIRECTORY);
}

OutputFolder::OutputFolder(fs::path target, fs::path temporary)
    : target_(std::move(target)), temporary_(std::move(temporary)) {}

OutputFolder::OutputFolder(OutputFolder&& other) noexcept
    : target_(std::move(other.target_)), temporary_(std::exchange(other.temporary_, fs::path())) {}

OutputFolder::~OutputFolder() {
  std::error_code ignored;
  if (!temporary_.empty()) fs::remove_all(temporary_, ignored);
}

Result<OutputFolder> OutputFolder::Begin(const fs::path& target) {
  std::error_code error;
  fs::path place = fs::absolute(target, error).lexically_normal();
  if (target.empty() || error) {
    return Error{ErrorCode::kInvalidArgument, "expected the name of a folder", target.string()};
  }
  if (!place.has_filename()) place = place.parent_path();
  const fs::file_status status = fs::symlink_status(place, error);
  if (fs::exists(status)) {
    if (!fs::is_directory(status)) {
      return Error{ErrorCode::kAlreadyExists, "exists and is not a folder", target.string()};
    }
    const bool is_empty = fs::is_empty(place, error);
    if (error) return IoError("cannot list", error.value(), target);
    if (!is_empty) {
      return Error{ErrorCode::kAlreadyExists, "the folder exists and is not empty",
                   target.string()};
    }
  }
  ROTUNDA_ASSIGN_OR_RETURN(fs::path temporary, MakeTemporary(place, [](const fs::path& path) {
                             return ::mkdir(path.c_str(), 0777) == 0 ? 0 : errno;
                           }));
  return OutputFolder(place, std::move(temporary));
}

Status CheckOutputFile(const fs::path& file) {
  std::error_code error;
  const fs::path place = fs::absolute(file, error).lexically_normal();
  if (error || !place.has_filename()) {
    return Error{ErrorCode::kInvalidArgument, "expected the name of a file", file.string()};
  }
  if (fs::is_directory(place, error)) {
    return Error{ErrorCode::kInvalidArgument, "is a folder, expected the name of a file",
                 file.string()};
  }
  return CheckParent(place, file);
}

Status CheckOutputPlace(const fs::path& target, uint64_t bytes) {
  std::error_code error;
  fs::path place = fs::absolute(target, error).lexically_normal();
  if (!place.has_filename()) place = place.parent_path();
  const fs::path parent = ParentOf(place);
  ROTUNDA_RETURN_IF_ERROR(CheckParent(place, target));
  // Only making a folder there tells all reasons that there may be.
  const Result<OutputFolder> probe = OutputFolder::Begin(place);
  if (!probe) return probe.error();
  struct statvfs room {};
  if (::statvfs(parent.c_str(), &room) != 0) return WriteError("cannot look at", errno, parent);
  const uint64_t free_bytes = uint64_t{room.f_bavail} * room.f_frsize;
  if (free_bytes >= bytes) return {};
  return Error{ErrorCode::kIo,
               "has room for " + std::to_string(free_bytes >> 20) + " MiB, expected " +
                   std::to_string(bytes >> 20) + " MiB",
               parent.string()};
}

Error OutputFolder::InPlace(const Error& error) const {
  const std::string temporary = temporary_.string();
  const size_t place = temporary.empty() ? std::string::npos : error.context.find(temporary);
  if (place == std::string::npos) return error;
  Error told = error;
  told.context.replace(place, temporary.size(), target_.string());
  return told;
}

Status OutputFolder::Commit() {
  if (const Status synced = SyncTree(temporary_); !synced.ok()) return InPlace(synced.error());
  if (::rename(temporary_.c_str(), target_.c_str()) != 0) {
    if (errno == ENOTEMPTY || errno == EEXIST || errno == ENOTDIR) {
      return Error{ErrorCode::kAlreadyExists, "has come into being while the work was going on",
                   target_.string()};
    }
    return WriteError("cannot put into place", errno, target_);
  }
  // What is not durable is taken back: whoever tries again finds the place as it was.
  const Status synced = MakeDurable(ParentOf(target_), O_DIRECTORY);
  if (!synced.ok() && ::rename(target_.c_str(), temporary_.c_str()) == 0) return synced;
  temporary_.clear();
  return synced;
}

}  // namespace rotunda
