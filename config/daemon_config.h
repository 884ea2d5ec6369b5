#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "rig/capture_options.h"
#include "sfm/core/result.h"

namespace rotunda::config {

class TomlFile;

/// What rotundad is told (config/rotundad.toml says what each key means and what is allowed).
/// What is left out keeps the value below.
struct DaemonConfig {
  struct Service {
    std::string socket = "/run/rotunda/api.sock";
    std::string state_folder = "/var/lib/rotunda";
    std::string log_level = "info";
    int stop_ms = 10000;
    int end_ms = 45000;
  } service;

  struct Access {
    std::string viewer_group = "rotunda";
    std::string operator_group = "rotunda-operator";
  } access;

  struct Http {
    int header_bytes = 16384;
    int body_bytes = 1048576;
    int connections = 128;
    int streams = 64;
    int request_ms = 15000;
    int write_ms = 15000;
    int heartbeat_ms = 15000;
    int threads = 4;
  } http;

  struct Devices {
    std::string capture = "capture.toml";  // file; a relative one lies beside the daemon's own
    std::string board = "cuboid.toml";     // likewise
    std::string simulated_socket;
    int ready_ms = 5000;
  } devices;

  struct Storage {
    int keep_days = 0;
    int keep_count = 0;
    int reserve_mb = 20000;
  } storage;

  struct Drift {
    double position_mm = 2.5;
    double rotation_deg = 0.07;
    int captures = 2;
  } drift;

  struct Jobs {
    int threads = 0;
    int capture_silence_s = 120;
    int computing_silence_s = 1200;
  } jobs;

  rig::CaptureOptions capture;  // what the file `devices.capture` says
  std::string capture_text;     // that file
};

/// The configuration in `file` and in the files it names, or all that is wrong with them: file,
/// line, key, what was found, what is allowed.
struct CheckedDaemonConfig {
  DaemonConfig config;  // to be used only when there are no problems
  std::vector<Error> problems;
  std::shared_ptr<const TomlFile> file = nullptr;  // what was checked; null: it cannot be parsed

  /// The error of a check whose context is "table.key", with the file and the line the key was on
  /// when it was checked. `file` is not null.
  Error Located(const Error& error) const;
};
CheckedDaemonConfig CheckDaemonConfig(const std::filesystem::path& file);

/// The same for one text, without looking at the files that it names. `source` names it in errors.
CheckedDaemonConfig CheckDaemonConfigText(const std::string& text, const std::string& source);

/// What differs and takes a new start to take effect ("service.socket", ...); the rest is reloaded.
std::vector<std::string> NeedsRestart(const DaemonConfig& running, const DaemonConfig& wanted);

}  // namespace rotunda::config
