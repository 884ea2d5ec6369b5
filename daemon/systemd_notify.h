#pragma once

#include <chrono>
#include <optional>
#include <string>

#include "sfm/core/result.h"

namespace rotunda::daemon {

// What systemd and the daemon tell each other (sd_notify(3), sd_listen_fds(3)). Without systemd
// there is nobody to tell, and nothing comes.

/// EXTEND_TIMEOUT_USEC: the start goes on for at least another minute, whatever TimeoutStartSec
/// says.
void NotifyStillStarting();
/// READY=1, with a line for `systemctl status`.
void NotifyReady(const std::string& status);
/// STATUS: another line for `systemctl status`.
void NotifyStatus(const std::string& status);
/// RELOADING=1; NotifyReady() follows.
void NotifyReloading();
/// STOPPING=1. The end takes `longest` at most, whatever TimeoutStopSec says.
void NotifyStopping(std::chrono::milliseconds longest);
void NotifyAlive();

/// How often NotifyAlive() is expected at least; nullopt: not at all.
std::optional<std::chrono::microseconds> WatchdogInterval();

/// The listening socket that systemd opened for us; nullopt: none. kInvalidArgument: more than one.
Result<std::optional<int>> InheritedSocket();

}  // namespace rotunda::daemon
