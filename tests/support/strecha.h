#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "sfm/core/calibration.h"

namespace rotunda::test {

/// The folder with real data that is not shipped: $ROTUNDA_SHARED, else "shared" beside the source
/// tree; nullopt when there is none.
std::optional<std::filesystem::path> SharedFolder();

/// Truth of a set of Strecha et al. (CVPR 2008): rows K, distortion, R, C, size in
/// gt_dense_cameras/<picture>.camera with P = K [R^T | -R^T C]; metres. Camera = name of the
/// picture without its ending. Aborts on a malformed file.
Calibration ReadStrechaTruth(const std::filesystem::path& set);

}  // namespace rotunda::test
