#pragma once

#include <optional>

#include "sfm/reconstruction.h"

namespace rotunda::sfm {

/// How the cameras of a model stand around what they look at.
struct CameraRing {
  Eigen::Vector3d centre;  // nearest to all optical axes (least squares), in the model frame
  Eigen::Vector3d axis;    // unit; the direction in which the cameras leave the centre least
  double widest_gap_rad;   // around the axis, between one camera and the next; 2 pi: one camera
};

/// nullopt with fewer than two registered cameras, or when their optical axes are parallel.
std::optional<CameraRing> FindCameraRing(const Reconstruction& model);

}  // namespace rotunda::sfm
