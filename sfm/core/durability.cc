#include "sfm/core/durability.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

namespace rotunda {

Status MakeDurable(const std::filesystem::path& path, int flags) {
  const auto refused = [&path](const char* what, int error) {
    return Error{ErrorCode::kIo, what + (": " + std::generic_category().message(error)),
                 path.string()};
  };
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | flags);
  if (fd < 0) return refused("cannot open to make durable", errno);
  // Some file systems have no fsync for folders and say EINVAL.
  const int failed = ::fsync(fd) != 0 && errno != EINVAL ? errno : 0;
  const int closed = ::close(fd) != 0 ? errno : 0;
  if (failed != 0) return refused("cannot make durable", failed);
  return closed != 0 ? Status(refused("cannot close", closed)) : Status();
}

}  // namespace rotunda
