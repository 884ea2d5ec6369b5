#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "daemon/cli/commands.h"

namespace rotunda::cli {

/// --socket: where the daemon serves.
CLI::Option* AddSocketOption(CLI::App* command, std::filesystem::path& socket);

/// --preset and --prior of a reconstruction by the daemon.
CLI::Option* AddPresetOption(CLI::App* command, std::string& preset);
CLI::Option* AddPriorOption(CLI::App* command, std::string& prior);

/// What is said of a shot that cameras missed, before its summary.
inline constexpr char kIncompleteSet[] = "the set is written, but incomplete";

/// A shot by the daemon, with its progress; the exit code.
struct DaemonShot {
  std::filesystem::path socket;
  std::optional<std::string> subject;
  bool reconstruct = true;
  std::string preset, prior;  // of its reconstruction; empty: left to the daemon
  bool follow = false;        // to the end of its reconstruction
};
int CaptureByDaemon(const DaemonShot& shot, const CommonOptions& common);

/// The daemon's cameras.
int CamerasOfDaemon(const std::filesystem::path& socket, const CommonOptions& common);

}  // namespace rotunda::cli
