// Loaded before libc into a program under test: while the file $ROTUNDA_TEST_HANG exists, the disk
// does not answer; "$ROTUNDA_TEST_HANG.waiting" tells that somebody waits for it.

#include <fcntl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cstdlib>
#include <string>

extern "C" int fsync(int fd) {
  const char* hang = std::getenv("ROTUNDA_TEST_HANG");
  while (hang != nullptr && ::access(hang, F_OK) == 0) {
    ::close(::open((std::string(hang) + ".waiting").c_str(), O_CREAT | O_WRONLY | O_CLOEXEC, 0600));
    ::usleep(10'000);
  }
  return static_cast<int>(::syscall(SYS_fsync, fd));
}
