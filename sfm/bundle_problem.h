#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "sfm/bundle_adjustment.h"

// Private to bundle adjustment: what its solvers are given and move.

namespace rotunda::sfm {

/// x_in_cam = rotation (x_in_model - center).
struct BundlePose {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d center = Eigen::Vector3d::Zero();  // model frame
  size_t lens = 0;
  bool used = false;  // sees a point
  bool free = false;  // moves; only what is used does
};

struct BundleObservation {
  Eigen::Vector2d pixel;
  double inverse_sigma;  // 1 / px
  uint32_t image;
};

/// Keeps the centre of `image` at its distance from a fixed one, along the line between them:
/// residual weight (direction^T (center - from) - 1), direction = (start - from) / |start -
/// from|^2.
struct ScaleGauge {
  size_t image = 0;
  Eigen::Vector3d from, direction;
  double weight = 0;

  double Residual(const Eigen::Vector3d& center) const {
    return weight * (direction.dot(center - from) - 1.0);
  }
  /// By the centre.
  Eigen::Vector3d Gradient() const { return weight * direction; }
};

/// Residuals are (projection - pixel) * inverse_sigma.
struct BundleProblem {
  std::vector<BundlePose> poses;  // by ImageId
  std::vector<CameraIntrinsics> lenses;
  std::vector<Eigen::Vector3d> points;
  std::vector<BundleObservation> observations;  // point by point, by image
  std::vector<size_t> first_observation;        // by point, and one past the last
  std::optional<ScaleGauge> scale_gauge;
};

/// Reduced camera systems of more images than this are factorised as sparse matrices.
inline constexpr size_t kMaxDenseImages = 150;

size_t FreeImages(const BundleProblem& problem);

}  // namespace rotunda::sfm
