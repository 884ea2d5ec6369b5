#include "daemon/service_log.h"

#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/stdout_sinks.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "sfm/core/name_list.h"

namespace rotunda::daemon {
namespace {

/// "<4>" for a warning, and so on: what journald makes a priority of (sd-daemon(3)).
class PriorityFlag : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& message, const std::tm&,
              spdlog::memory_buf_t& out) override {
    const char* text = message.level >= spdlog::level::err    ? "<3>"
                       : message.level == spdlog::level::warn ? "<4>"
                       : message.level == spdlog::level::info ? "<6>"
                                                              : "<7>";
    out.append(text, text + 3);
  }
  std::unique_ptr<custom_flag_formatter> clone() const override {
    return std::make_unique<PriorityFlag>();
  }
};

/// A reconstruction that nobody should build on.
bool IsNotSure(const EventRecord& event) {
  if (event.kind != "reconstruction_stored") return false;
  const nlohmann::json data = nlohmann::json::parse(event.data, nullptr, false);
  const std::string verdict = data.is_object() ? data.value("verdict", "") : "";
  return verdict == "unsure" || verdict == "folded";
}

bool IsTrouble(const EventRecord& event) {
  static const std::set<std::string> kKinds = {"camera_moved", "camera_unregistered",
                                               "job_failed",   "job_interrupted",
                                               "capture_gone", "capture_waits"};
  return kKinds.contains(event.kind) || IsNotSure(event);
}

}  // namespace

std::unique_ptr<spdlog::logger> MakeLog(const std::string& level) {
  auto log = std::make_unique<spdlog::logger>("rotundad",
                                              std::make_shared<spdlog::sinks::stderr_sink_mt>());
  auto formatter = std::make_unique<spdlog::pattern_formatter>();
  // systemd sets it for what it connects with the journal.
  if (std::getenv("JOURNAL_STREAM") != nullptr) {
    formatter->add_flag<PriorityFlag>('*').set_pattern("%*%v");
  } else {
    formatter->set_pattern("%Y-%m-%d %H:%M:%S.%e %l: %v");
  }
  log->set_formatter(std::move(formatter));
  SetLevel(*log, level);
  return log;
}

void SetLevel(spdlog::logger& log, const std::string& level) {
  log.set_level(spdlog::level::from_str(level));
}

void LogAccess(spdlog::logger& log, const AccessEntry& entry) {
  const std::string end = !entry.trouble.empty() ? "cut off (" + entry.trouble + ")"
                          : entry.status == 0    ? "client left"
                                                 : std::to_string(entry.status);
  const std::string request = entry.method.empty() ? "-" : entry.method + " " + entry.target;
  log.log(entry.trouble.empty() ? spdlog::level::info : spdlog::level::err,
          "access uid={} pid={} \"{}\" {} {} bytes {:.1f} ms", entry.peer.uid, entry.peer.pid,
          request, end, entry.sent_bytes, 1000 * entry.seconds);
}

void LogEvent(spdlog::logger& log, const EventRecord& event) {
  if (event.kind == "job_progress") return;
  const auto level = event.kind == "capture_lost" ? spdlog::level::err
                     : IsTrouble(event)           ? spdlog::level::warn
                                                  : spdlog::level::info;
  log.log(level, "event {} {} {} {}", event.number, event.kind, event.about, event.data);
}

void LogRecovery(spdlog::logger& log, const RecoveryReport& report) {
  if (!report.adopted.empty()) {
    log.warn("found on disk and taken into the database: {}", Joined(report.adopted));
  }
  if (!report.gone.empty()) log.error("their files are gone: {}", Joined(report.gone));
  if (!report.unreadable.empty()) {
    log.error("left alone, not what they should be: {}", Joined(report.unreadable));
  }
  for (const int64_t job : report.interrupted) {
    log.warn(
        "job {} was under way when the daemon ended without storing how: it is interrupted and can "
        "be run again",
        job);
  }
  if (report.removed_temporaries > 0) {
    log.info("removed {} half-written folders", report.removed_temporaries);
  }
}

}  // namespace rotunda::daemon
