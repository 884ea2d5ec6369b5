#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <cstring>
#include <string>

#include "daemon/systemd_notify.h"
#include "tests/support/process.h"

namespace rotunda::daemon {
namespace {

/// Stands in for systemd: takes what is sent to NOTIFY_SOCKET.
class Listener {
 public:
  Listener() : fd_(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    const std::string path = folder_ / "notify";
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, path.c_str(), sizeof(address.sun_path) - 1);
    EXPECT_EQ(bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
    setenv("NOTIFY_SOCKET", path.c_str(), 1);
  }
  ~Listener() {
    unsetenv("NOTIFY_SOCKET");
    close(fd_);
  }
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  /// Empty: nothing was sent.
  std::string Next() {
    char text[1000];
    const ssize_t size = recv(fd_, text, sizeof(text), MSG_DONTWAIT);
    return size > 0 ? std::string(text, static_cast<size_t>(size)) : "";
  }

 private:
  test::TemporaryFolder folder_;
  int fd_;
};

TEST(SystemdNotify, SaysWhatSystemdUnderstands) {
  Listener systemd;
  NotifyStillStarting();
  EXPECT_EQ(systemd.Next(), "EXTEND_TIMEOUT_USEC=60000000");
  NotifyReady("90 of 90 cameras ready");
  EXPECT_EQ(systemd.Next(), "READY=1\nSTATUS=90 of 90 cameras ready");
  NotifyStatus("89 of 90 cameras ready");
  EXPECT_EQ(systemd.Next(), "STATUS=89 of 90 cameras ready");
  NotifyAlive();
  EXPECT_EQ(systemd.Next(), "WATCHDOG=1");
  NotifyStopping(std::chrono::milliseconds(45000));
  EXPECT_EQ(systemd.Next(), "STOPPING=1\nEXTEND_TIMEOUT_USEC=50000000");
  EXPECT_EQ(systemd.Next(), "");
}

}  // namespace
}  // namespace rotunda::daemon
