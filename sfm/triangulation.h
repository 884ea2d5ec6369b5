#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "sfm/core/rigid3.h"

namespace rotunda::sfm {

/// One sight of a point.
struct TriangulationView {
  Eigen::Matrix<double, 3, 4> cam_from_model;
  Eigen::Vector3d center;      // of the camera, model frame
  Eigen::Vector2d normalized;  // x/z, y/z without distortion
  double focal_px = 0;         // turns normalised distances into pixels
};
TriangulationView MakeTriangulationView(const Rigid3& cam_from_model,
                                        const Eigen::Vector2d& normalized, double focal_px);

struct TriangulationOptions {
  double max_error_px = 4.0;
  double min_angle_rad = RadFromDeg(1.5);  // the largest angle between two of the rays
};

struct TriangulatedPoint {
  Eigen::Vector3d position;     // model frame
  std::vector<size_t> inliers;  // places in the views, ascending, at least two
};

/// The point that most views agree on: candidates from all views together and from pairs of views
/// (least distance to the rays), scored by the truncated squared reprojection error of points in
/// front; refined by Gauss-Newton on the reprojection error of its inliers. nullopt: no two views
/// agree within max_error_px at an angle of at least min_angle_rad.
std::optional<TriangulatedPoint> Triangulate(std::span<const TriangulationView> views,
                                             const TriangulationOptions& options);

/// Reprojection error in pixels (of the undistorted picture); infinity behind the camera.
double ReprojectionError_px(const TriangulationView& view, const Eigen::Vector3d& position);

/// Largest angle between the rays from `centers` to `position`.
double LargestAngle_rad(std::span<const Eigen::Vector3d> centers, const Eigen::Vector3d& position);

}  // namespace rotunda::sfm
