#pragma once

#include <spdlog/logger.h>

#include <memory>
#include <string>

#include "daemon/events.h"
#include "daemon/http_server.h"
#include "daemon/store.h"
#include "sfm/core/result.h"

namespace rotunda::daemon {

/// The daemon's log on standard error: for journald with the priority of each line, else with the
/// time.
std::unique_ptr<spdlog::logger> MakeLog(const std::string& level);
/// "debug", "info", "warning" or "error".
void SetLevel(spdlog::logger& log, const std::string& level);

void LogAccess(spdlog::logger& log, const AccessEntry& entry);
void LogEvent(spdlog::logger& log, const EventRecord& event);
/// What a crash had left behind, and what became of it.
void LogRecovery(spdlog::logger& log, const RecoveryReport& report);

}  // namespace rotunda::daemon
