#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "daemon/cli/commands.h"
#include "rig/sim/rig_options.h"
#include "rig/sim/simulate.h"

namespace rotunda::cli {

/// `rotunda simulate --serve` and `--send`.
struct ServeArguments {
  bool serve = false;
  std::vector<std::filesystem::path> frame_sets;  // none: render
  std::vector<std::string> send;                  // words of one command
  std::string block = "127.0.1";
  std::optional<std::filesystem::path> socket;
  std::string format;  // empty: as the frame set has it, or BayerRG8
  bool hold = false;
  double delay_us = 0;
  double jitter_us = 0;
};

/// Where the socket is unless the user says so: the user's own folder for such things.
std::filesystem::path DefaultCameraSocket();

void AddServeOptions(CLI::App* command, ServeArguments& arguments);

/// Serves simulated cameras until Ctrl-C.
Status ServeCameras(const ServeArguments& arguments, const sim::RigOptions& rig,
                    const sim::SimulateOptions& simulate, const CommonOptions& common);

/// Sends a command to the cameras that another process serves.
Status SendToCameras(const ServeArguments& arguments, const CommonOptions& common);

}  // namespace rotunda::cli
