#include "daemon/systemd_notify.h"

#include <systemd/sd-daemon.h>

#include <ctime>

namespace rotunda::daemon {
namespace {

constexpr int kKeepEnvironment = 0;
// For a hundred found folders on a slow disk.
constexpr int64_t kMoreTime_us = 60000000;
// A daemon that hangs ends by itself before systemd kills it.
constexpr auto kEndMargin = std::chrono::seconds(5);

}  // namespace

void NotifyStillStarting() {
  sd_notify(kKeepEnvironment, ("EXTEND_TIMEOUT_USEC=" + std::to_string(kMoreTime_us)).c_str());
}

void NotifyReady(const std::string& status) {
  sd_notify(kKeepEnvironment, ("READY=1\nSTATUS=" + status).c_str());
}

void NotifyStatus(const std::string& status) {
  sd_notify(kKeepEnvironment, ("STATUS=" + status).c_str());
}

void NotifyReloading() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  const int64_t now_us = int64_t{1000000} * now.tv_sec + now.tv_nsec / 1000;
  sd_notify(kKeepEnvironment, ("RELOADING=1\nMONOTONIC_USEC=" + std::to_string(now_us)).c_str());
}

void NotifyStopping(std::chrono::milliseconds longest) {
  const std::chrono::microseconds allowed = longest + kEndMargin;
  sd_notify(kKeepEnvironment,
            ("STOPPING=1\nEXTEND_TIMEOUT_USEC=" + std::to_string(allowed.count())).c_str());
}

void NotifyAlive() { sd_notify(kKeepEnvironment, "WATCHDOG=1"); }

std::optional<std::chrono::microseconds> WatchdogInterval() {
  uint64_t interval_us = 0;
  if (sd_watchdog_enabled(kKeepEnvironment, &interval_us) <= 0) return std::nullopt;
  return std::chrono::microseconds(interval_us);
}

Result<std::optional<int>> InheritedSocket() {
  const int count = sd_listen_fds(kKeepEnvironment);
  if (count <= 0) return std::optional<int>();
  if (count == 1) return std::optional<int>(SD_LISTEN_FDS_START);
  return Error{ErrorCode::kInvalidArgument,
               "systemd handed over " + std::to_string(count) + ", expected one", "sockets"};
}

}  // namespace rotunda::daemon
