#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace rotunda::rig {

/// A point of a face (squares) and where it is in the picture.
struct PlanePoint {
  Eigen::Vector2d on_face;
  Eigen::Vector2d pixel;
};

/// The homography pixel ~ H (on_face, 1), least squares over at least four points (normalised DLT,
/// Hartley and Zisserman, 4.4.4). nullopt when they do not determine it.
class PlaneFit {
 public:
  static std::optional<PlaneFit> Fit(const std::vector<PlanePoint>& points);
  Eigen::Vector2d Pixel(const Eigen::Vector2d& on_face) const;
  /// Derivative of Pixel.
  Eigen::Matrix2d PixelsPerSquare(const Eigen::Vector2d& on_face) const;

 private:
  explicit PlaneFit(const Eigen::Matrix3d& h) : h_(h) {}
  Eigen::Matrix3d h_;
};

}  // namespace rotunda::rig
