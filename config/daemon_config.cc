#include "config/daemon_config.h"

#include <sys/un.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <memory>
#include <sstream>
#include <utility>

#include "config/board_config.h"
#include "config/capture_config.h"
#include "config/toml_reader.h"
#include "sfm/core/file_io.h"

namespace rotunda::config {
namespace {

namespace fs = std::filesystem;

constexpr int kAnyAmount = std::numeric_limits<int>::max();
constexpr int kHour_ms = 3600 * 1000;
// TimeoutStopSec of rotunda.service is 60 s: the daemon ends, and says why, before it is killed.
constexpr int kMaxStop_ms = 20000;
constexpr int kMaxEnd_ms = 55000;
constexpr size_t kMaxSocketName = sizeof(sockaddr_un::sun_path) - 1;

std::vector<Section> Sections(DaemonConfig& config) {
  DaemonConfig::Http& http = config.http;
  return {{"service",
           {{"socket", &config.service.socket},
            {"state_folder", &config.service.state_folder},
            {"log_level", &config.service.log_level},
            {"stop_ms", &config.service.stop_ms},
            {"end_ms", &config.service.end_ms}}},
          {"access",
           {{"viewer_group", &config.access.viewer_group},
            {"operator_group", &config.access.operator_group}}},
          {"http",
           {{"header_bytes", &http.header_bytes},
            {"body_bytes", &http.body_bytes},
            {"connections", &http.connections},
            {"streams", &http.streams},
            {"request_ms", &http.request_ms},
            {"write_ms", &http.write_ms},
            {"heartbeat_ms", &http.heartbeat_ms},
            {"threads", &http.threads}}},
          {"devices",
           {{"capture", &config.devices.capture},
            {"board", &config.devices.board},
            {"simulated_socket", &config.devices.simulated_socket},
            {"ready_ms", &config.devices.ready_ms}}},
          {"storage",
           {{"keep_days", &config.storage.keep_days},
            {"keep_count", &config.storage.keep_count},
            {"reserve_mb", &config.storage.reserve_mb}}},
          {"drift",
           {{"position_mm", &config.drift.position_mm},
            {"rotation_deg", &config.drift.rotation_deg},
            {"captures", &config.drift.captures}}},
          {"jobs",
           {{"threads", &config.jobs.threads},
            {"capture_silence_s", &config.jobs.capture_silence_s},
            {"computing_silence_s", &config.jobs.computing_silence_s}}}};
}

struct Range {
  const char* key;
  double value;
  double min, max;
};

std::vector<Range> Ranges(const DaemonConfig& config) {
  const DaemonConfig::Http& http = config.http;
  return {{"service.stop_ms", 1.0 * config.service.stop_ms, 100, kMaxStop_ms},
          {"service.end_ms", 1.0 * config.service.end_ms, 1000, kMaxEnd_ms},
          // A header must hold what curl and browsers send.
          {"http.header_bytes", 1.0 * http.header_bytes, 1024, 1 << 20},
          {"http.body_bytes", 1.0 * http.body_bytes, 1024, 1 << 26},
          {"http.connections", 1.0 * http.connections, 2, 4096},
          {"http.streams", 1.0 * http.streams, 1, 4096},
          {"http.request_ms", 1.0 * http.request_ms, 100, kHour_ms},
          {"http.write_ms", 1.0 * http.write_ms, 100, kHour_ms},
          {"http.heartbeat_ms", 1.0 * http.heartbeat_ms, 100, kHour_ms},
          // A preview and an export may hold one each; one more feeds the watchdog.
          {"http.threads", 1.0 * http.threads, 3, 64},
          {"devices.ready_ms", 1.0 * config.devices.ready_ms, 0, kHour_ms},
          {"storage.keep_days", 1.0 * config.storage.keep_days, 0, 36500},
          {"storage.keep_count", 1.0 * config.storage.keep_count, 0, kAnyAmount},
          {"storage.reserve_mb", 1.0 * config.storage.reserve_mb, 0, kAnyAmount},
          {"drift.position_mm", config.drift.position_mm, 0.01, 1000},
          {"drift.rotation_deg", config.drift.rotation_deg, 0.001, 180},
          {"drift.captures", 1.0 * config.drift.captures, 1, 1000},
          {"jobs.threads", 1.0 * config.jobs.threads, 0, 1024},
          {"jobs.capture_silence_s", 1.0 * config.jobs.capture_silence_s, 1, 86400},
          {"jobs.computing_silence_s", 1.0 * config.jobs.computing_silence_s, 1, 86400}};
}

std::string Plain(double number) {
  std::ostringstream text;
  text.precision(12);
  text << number;
  return text.str();
}

/// Takes what is wrong: "table.key", and why.
using Refuse = std::function<void(const std::string& key, const std::string& why)>;

/// Every path that cannot be one.
void CheckPaths(const DaemonConfig& config, const Refuse& refuse) {
  const auto absolute = [&](const char* key, const std::string& path) {
    if (!fs::path(path).is_absolute()) {
      refuse(key, "is \"" + path + "\", expected an absolute path");
    }
  };
  const auto socket = [&](const char* key, const std::string& path) {
    absolute(key, path);
    if (path.size() > kMaxSocketName) {
      refuse(key, "has " + std::to_string(path.size()) + " bytes, expected at most " +
                      std::to_string(kMaxSocketName) + ", as the name of a socket");
    }
  };
  socket("service.socket", config.service.socket);
  absolute("service.state_folder", config.service.state_folder);
  if (!config.devices.simulated_socket.empty()) {
    socket("devices.simulated_socket", config.devices.simulated_socket);
  }
}

/// Values out of range; the context is "table.key".
std::vector<Error> WrongValues(const DaemonConfig& config) {
  std::vector<Error> wrong;
  const auto refuse = [&wrong](const std::string& key, const std::string& why) {
    wrong.push_back({ErrorCode::kInvalidArgument, why, key});
  };
  for (const Range& range : Ranges(config)) {
    if (range.value >= range.min && range.value <= range.max) continue;
    refuse(range.key, "is " + Plain(range.value) + ", expected " + Plain(range.min) + " to " +
                          Plain(range.max));
  }
  if (config.http.streams >= config.http.connections) {
    refuse("http.streams", "is " + std::to_string(config.http.streams) +
                               ", expected less than http.connections, which is " +
                               std::to_string(config.http.connections));
  }
  if (config.service.end_ms <= config.service.stop_ms) {
    refuse("service.end_ms", "is " + std::to_string(config.service.end_ms) +
                                 ", expected more than service.stop_ms, which is " +
                                 std::to_string(config.service.stop_ms));
  }
  CheckPaths(config, refuse);
  const std::string& level = config.service.log_level;
  if (level != "debug" && level != "info" && level != "warning" && level != "error") {
    refuse("service.log_level",
           "is \"" + level + "\", expected \"debug\", \"info\", \"warning\" or \"error\"");
  }
  return wrong;
}

/// Whether something is there that is known to be of another kind.
bool IsOther(fs::file_type found, fs::file_type expected) {
  return found != expected && found != fs::file_type::not_found && found != fs::file_type::none &&
         found != fs::file_type::unknown;
}

/// What keeps `folder` from being there or being made: itself or one above it; empty: nothing. A
/// link that leads nowhere does.
fs::path InTheWayOf(const fs::path& folder) {
  for (fs::path place = folder; place.has_relative_path(); place = place.parent_path()) {
    std::error_code failed, ignored;
    const fs::file_type found = fs::status(place, failed).type();
    if (IsOther(found, fs::file_type::directory)) return place;
    const bool leads_nowhere =
        found == fs::file_type::not_found || failed == std::errc::too_many_symbolic_link_levels;
    if (!leads_nowhere) break;
    if (fs::is_symlink(place, ignored)) return place;
  }
  return {};
}

/// What is at `place`, where a `kind` is to be.
std::string FoundAt(const fs::path& place, const std::string& kind) {
  std::error_code no_link, failed;
  const fs::path target = fs::read_symlink(place, no_link);
  if (no_link) return "is there and no " + kind;
  const bool leads_there = fs::exists(fs::status(place, failed));
  return "is a link to \"" + target.string() + "\"" +
         (leads_there ? " and no " + kind : " (" + failed.message() + ")");
}

/// Refuses folders and sockets in whose place something else is.
void CheckPlaces(const DaemonConfig& config, const Refuse& refuse) {
  const auto check_folder = [&](const char* key, const std::string& path, const fs::path& folder) {
    const fs::path found = InTheWayOf(folder);
    if (found.empty()) return;
    refuse(key, "is \"" + path + "\", " +
                    (found == path ? "which " : "but \"" + found.string() + "\" ") +
                    FoundAt(found, "folder") + ", expected a folder that is there or can be made");
  };
  const auto check_socket = [&](const char* key, const std::string& path, fs::file_status there) {
    check_folder(key, path, fs::path(path).parent_path());
    if (!IsOther(there.type(), fs::file_type::socket)) return;
    refuse(key, "is \"" + path + "\", which " + FoundAt(path, "socket") +
                    ", expected a socket or a name that is free");
  };
  std::error_code ignored;
  const std::string& state_folder = config.service.state_folder;
  check_folder("service.state_folder", state_folder, state_folder);
  const std::string& socket = config.service.socket;
  check_socket("service.socket", socket, fs::symlink_status(socket, ignored));  // no link is bound
  const std::string& simulated = config.devices.simulated_socket;
  if (!simulated.empty()) {
    check_socket("devices.simulated_socket", simulated, fs::status(simulated, ignored));
  }
}

/// Reads and checks the files that the configuration names, a relative one in `folder`.
void CheckNamedFiles(const fs::path& folder, const Refuse& refuse, CheckedDaemonConfig& checked) {
  DaemonConfig::Devices& devices = checked.config.devices;
  devices.capture = folder / devices.capture;
  devices.board = folder / devices.board;
  std::vector<Error>& problems = checked.problems;
  if (const Result<std::string> capture = ReadFile(devices.capture)) {
    CheckedCaptureOptions options = CheckCaptureOptions(*capture, devices.capture);
    checked.config.capture = std::move(options.options);
    checked.config.capture_text = *capture;
    problems.insert(problems.end(), options.problems.begin(), options.problems.end());
  } else {
    refuse("devices.capture", capture.error().ToString());
  }
  if (const Result<std::string> board = ReadFile(devices.board)) {
    const CheckedBoard target = CheckBoard(*board, devices.board);
    problems.insert(problems.end(), target.problems.begin(), target.problems.end());
  } else {
    refuse("devices.board", board.error().ToString());
  }
}

}  // namespace

CheckedDaemonConfig CheckDaemonConfigText(const std::string& text, const std::string& source) {
  CheckedDaemonConfig checked;
  Result<TomlFile> file = TomlFile::Parse(text, source);
  if (!file) return {{}, {file.error()}};
  checked.file = std::make_shared<const TomlFile>(*std::move(file));
  checked.problems = checked.file->ReadAll(Sections(checked.config));
  checked.file->AddLocated(WrongValues(checked.config), checked.problems);
  return checked;
}

CheckedDaemonConfig CheckDaemonConfig(const fs::path& file) {
  const Result<std::string> text = ReadFile(file);
  if (!text) return {{}, {text.error()}};
  CheckedDaemonConfig checked = CheckDaemonConfigText(*text, file.string());
  if (!checked.file) return checked;
  const auto refuse = [&](const std::string& key, const std::string& why) {
    checked.problems.push_back(checked.Located({ErrorCode::kBadInput, why, key}));
  };
  CheckPlaces(checked.config, refuse);
  CheckNamedFiles(file.parent_path(), refuse, checked);
  return checked;
}

Error CheckedDaemonConfig::Located(const Error& error) const { return file->Located(error); }

std::vector<std::string> NeedsRestart(const DaemonConfig& running, const DaemonConfig& wanted) {
  std::vector<std::string> keys;
  // Sections() gives places to write to; both are copies.
  DaemonConfig before = running, after = wanted;
  const std::vector<Section> old_sections = Sections(before), new_sections = Sections(after);
  for (size_t s = 0; s < old_sections.size(); ++s) {
    const std::string& name = old_sections[s].name;
    if (name == "access" || name == "storage") continue;  // reloaded
    for (size_t f = 0; f < old_sections[s].fields.size(); ++f) {
      const Field& field = old_sections[s].fields[f];
      const std::string key = name + "." + std::string(field.key);
      if (key == "service.log_level") continue;  // reloaded
      const bool same = std::visit(
          [&](auto* value) {
            return *value == *std::get<decltype(value)>(new_sections[s].fields[f].target);
          },
          field.target);
      if (!same) keys.push_back(key);
    }
  }
  if (running.capture_text != wanted.capture_text) {
    keys.push_back("what devices.capture, " + wanted.devices.capture + ", says");
  }
  return keys;
}

}  // namespace rotunda::config
