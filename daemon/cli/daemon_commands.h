#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "daemon/cli/commands.h"

namespace rotunda::cli {

/// --socket: where the daemon serves.
CLI::Option* AddSocketOption(CLI::App* command, std::filesystem::path& socket);

/// What is said of a shot that cameras missed, before its summary.
inline constexpr char kIncompleteSet[] = "the set is written, but incomplete";

/// A shot by the daemon, with its progress; the exit code.
struct DaemonShot {
  std::filesystem::path socket;
  std::optional<std::string> subject;
  bool reconstruct = true;
  bool follow = false;  // to the end of its reconstruction
};
int CaptureByDaemon(const DaemonShot& shot, const CommonOptions& common);

/// The daemon's cameras.
int CamerasOfDaemon(const std::filesystem::path& socket, const CommonOptions& common);

}  // namespace rotunda::cli
