#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "sfm/core/run_context.h"

namespace rotunda::bench {

/// What a calibration of real cameras reached, with the lens model of the command's default.
struct RealFit {
  double rms_px = 0;
  double kept = 0;                       // share of the corners found
  double posed = 0;                      // share of the cameras, or of the shots when that is less
  std::vector<std::string> doubts = {};  // what the command would say of it
  /// Greatest difference from mrcal's result, both with k3, over both sigmas: of a camera's focal
  /// length, rotation and position. nullopt for boards that mrcal does not know.
  std::optional<double> peer_sigmas = std::nullopt;
};

/// Calibrates real cameras from the shots in `folder` of the board in `board_file`, with its time
/// by stage. A board of one face also goes through mrcal, and both results are compared. nullopt
/// when the folder is not there.
std::optional<RealFit> BenchReal(const std::filesystem::path& board_file,
                                 const std::filesystem::path& folder, ThreadPool& threads);

}  // namespace rotunda::bench
