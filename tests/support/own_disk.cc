#include "tests/support/own_disk.h"

#include <sched.h>
#include <sys/mount.h>
#include <sys/wait.h>
#include <unistd.h>

namespace rotunda::test {

std::optional<int> OnOwnDisk(const std::filesystem::path& folder, unsigned long flags,
                             const char* options, const std::function<int()>& work) {
  constexpr int kCannotMount = 77;
  const pid_t child = fork();
  if (child == 0) {
    const bool mounted = (unshare(CLONE_NEWNS) == 0 || unshare(CLONE_NEWUSER | CLONE_NEWNS) == 0) &&
                         mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) == 0 &&
                         mount("tmpfs", folder.c_str(), "tmpfs", flags, options) == 0;
    _exit(mounted ? work() : kCannotMount);
  }
  int status = 0;
  waitpid(child, &status, 0);
  const int code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return code == kCannotMount ? std::nullopt : std::optional(code);
}

}  // namespace rotunda::test
