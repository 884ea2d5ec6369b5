#pragma once

#include <optional>
#include <vector>

#include "sfm/reconstruction.h"

namespace rotunda::sfm {

/// How the cameras of a model stand around what they look at.
struct CameraRing {
  Eigen::Vector3d centre;  // nearest to all optical axes (least squares), in the model frame
  /// Unit; the direction in which the cameras leave the centre least, to where the upper edges of
  /// most pictures are.
  Eigen::Vector3d axis;
  /// Whether the upper edges tell which way along the axis is up: not of cameras on their side.
  bool upright;
  double widest_gap_rad;  // around the axis, between one camera and the next; 2 pi: one camera
};

/// nullopt with fewer than two registered cameras, or when their optical axes are parallel.
std::optional<CameraRing> FindCameraRing(const Reconstruction& model);

/// By ImageId, around the ring's axis, counter-clockwise seen from where it points to, from an
/// arbitrary zero; in (-pi, pi]; nullopt: not registered.
std::vector<std::optional<double>> AzimuthsAround(const CameraRing& ring,
                                                  const Reconstruction& model);

}  // namespace rotunda::sfm
