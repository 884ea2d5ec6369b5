#include "daemon/store_folder.h"

#include <fcntl.h>
#include <grp.h>
#include <pwd.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <string>
#include <system_error>

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;

constexpr char kExpected[] = ": expected a folder that the daemon's user can write";

/// Numbers where there is no name.
std::string UserName(uid_t user) {
  const passwd* const known = ::getpwuid(user);
  return known != nullptr ? known->pw_name : std::to_string(user);
}
std::string GroupName(gid_t group) {
  const ::group* const known = ::getgrgid(group);
  return known != nullptr ? known->gr_name : std::to_string(group);
}

/// What keeps this process's user from `access` to `place`, an errno; 0: nothing.
int Refusal(const fs::path& place, int access) {
  return ::faccessat(AT_FDCWD, place.c_str(), access, AT_EACCESS) == 0 ? 0 : errno;
}

/// Whether whose a place is decides it.
bool IsForbidden(int error) { return error == EACCES || error == EPERM; }

/// Whether this process's user cannot know if it is there.
bool IsHidden(const fs::path& place) {
  std::error_code failed;
  return !fs::exists(place, failed) && failed == std::errc::permission_denied;
}

/// Itself, or the nearest folder above it that is seen to be there.
fs::path NearestThere(fs::path place) {
  std::error_code ignored;
  while (!fs::exists(place, ignored) && place.has_relative_path()) place = place.parent_path();
  return place.empty() ? "." : place;
}

/// "rotunda:rotunda, mode 0700".
std::string AccessOf(const fs::path& place) {
  struct stat found {};
  if (::stat(place.c_str(), &found) != 0) return "unknown";
  char mode[16];
  std::snprintf(mode, sizeof(mode), "%04o", found.st_mode & 07777);
  return UserName(found.st_uid) + ":" + GroupName(found.st_gid) + ", mode " + mode;
}

Error NotWritable(const fs::path& place, int error) {
  const std::string why = "cannot be written: " + std::generic_category().message(error);
  if (error == EROFS) {
    return {ErrorCode::kIo,
            why + "; if it is only so for the service, give that ReadWritePaths=" + place.string() +
                " (systemctl edit rotunda)",
            place.string()};
  }
  if (!IsForbidden(error)) return {ErrorCode::kIo, why, place.string()};
  const fs::path there = NearestThere(place);
  const std::string user = UserName(::geteuid()), group = GroupName(::getegid());
  const std::string name = place.string();
  const std::string remedy =
      there == place ? "chown " + user + ":" + group + " " + name + " && chmod u+rwX " + name
                     : "install -d -o " + user + " -g " + group + " -m 0700 " + name;
  return {ErrorCode::kIo,
          why + "; " + there.string() + " is of " + AccessOf(there) + ", and " + user + ":" +
              group + " is to read and write " + name + ": " + remedy,
          name};
}

Error NotSeen(const fs::path& folder) {
  const fs::path there = NearestThere(folder);
  const bool is_closed = Refusal(there, X_OK) != 0;  // else it is where a link leads
  return {ErrorCode::kIo,
          folder.string() + " cannot be seen by " + UserName(::geteuid()) +
              (is_closed ? "; " + there.string() + " is of " + AccessOf(there) : "") + kExpected,
          ""};
}

}  // namespace

Status MakeWritableFolder(const fs::path& folder) {
  std::error_code failed;
  fs::create_directories(folder, failed);
  if (failed) return NotWritable(folder, failed.value());
  const int error = Refusal(folder, R_OK | W_OK | X_OK);
  return error == 0 ? Status() : NotWritable(folder, error);
}

Status CheckFolderForWriting(const fs::path& folder, int access) {
  if (IsHidden(folder)) return NotSeen(folder);
  const fs::path there = NearestThere(folder);
  const int error = Refusal(there, there == folder ? access : W_OK | X_OK);
  if (error == 0) return {};
  if (!IsForbidden(error)) return NotWritable(folder, error);
  const std::string missing = there == folder ? "" : folder.string() + " is not there; ";
  return Error{ErrorCode::kIo,
               missing + there.string() + " is of " + AccessOf(there) + ", and " +
                   UserName(::geteuid()) + " cannot write it" + kExpected,
               ""};
}

Status CheckWritableFile(const fs::path& file) {
  const int error = Refusal(file, R_OK | W_OK);
  return error == 0 || error == ENOENT ? Status() : NotWritable(file, error);
}

}  // namespace rotunda::daemon
