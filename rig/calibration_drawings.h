#pragma once

#include <string>

#include "rig/calibration_checks.h"

namespace rotunda::rig {

/// Drawings of the calibration report, each one SVG.

enum class LayoutView { kTop, kSide };
/// Cameras with their viewing direction, and the outlines of the target in every shot.
std::string DrawLayout(const Board& board, const RigCalibration& result, LayoutView view);

/// A camera's picture: cells shaded by their corners (`most`: the darkest), with the mean residual
/// of each as a bar (`longest_px`: as long as half a cell).
std::string DrawCameraMap(const CameraCheck& check, const CameraIntrinsics& intrinsics, size_t most,
                          double longest_px);

}  // namespace rotunda::rig
