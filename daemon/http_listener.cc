#include "daemon/http_listener.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;

constexpr int kBacklog = 64;

Result<sockaddr_un> SocketAddress(const fs::path& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.native().size() >= sizeof(address.sun_path)) {
    return Error{ErrorCode::kInvalidArgument,
                 "is longer than the " + std::to_string(sizeof(address.sun_path) - 1) +
                     " bytes that a socket's name may have",
                 path.string()};
  }
  std::memcpy(address.sun_path, path.c_str(), path.native().size());
  return address;
}

}  // namespace

Result<int> ListenOn(const fs::path& path) {
  const auto failed = [&path](const std::string& what) {
    return Error{ErrorCode::kIo, what + ": " + std::strerror(errno), path.string()};
  };
  ROTUNDA_ASSIGN_OR_RETURN(const sockaddr_un address, SocketAddress(path));
  const auto* name = reinterpret_cast<const sockaddr*>(&address);
  struct stat there {};
  if (lstat(path.c_str(), &there) == 0) {
    if (!S_ISSOCK(there.st_mode)) {
      return Error{ErrorCode::kAlreadyExists, "is there and not a socket", path.string()};
    }
    if (IsLivingSocket(path)) {
      return Error{ErrorCode::kAlreadyExists, "another program serves there", path.string()};
    }
    unlink(path.c_str());
  }
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return failed("no socket");
  if (bind(fd, name, sizeof(address)) != 0 || chmod(path.c_str(), 0660) != 0 ||
      listen(fd, kBacklog) != 0) {
    const Error error = failed("cannot be listened on");
    close(fd);
    return error;
  }
  return fd;
}

bool IsLivingSocket(const fs::path& path) {
  const Result<sockaddr_un> address = SocketAddress(path);
  if (!address) return false;
  const int probe = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (probe < 0) return false;
  // One that is listened on is of the wrong type for this one; a dead one refuses it.
  const bool is_living =
      connect(probe, reinterpret_cast<const sockaddr*>(&*address), sizeof(*address)) == 0 ||
      errno == EPROTOTYPE;
  close(probe);
  return is_living;
}

}  // namespace rotunda::daemon
