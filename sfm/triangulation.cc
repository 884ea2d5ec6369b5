#include "sfm/triangulation.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace rotunda::sfm {
namespace {

/// Pairs of views tried for one point; beyond that the pairs are a spread-out subset.
constexpr size_t kMaxPairs = 45;

Eigen::Vector3d ToCamera(const TriangulationView& view, const Eigen::Vector3d& position) {
  return view.cam_from_model.leftCols<3>() * position + view.cam_from_model.col(3);
}

/// The point with the least sum of squared distances to the rays of the views in `used`.
std::optional<Eigen::Vector3d> ClosestToRays(std::span<const TriangulationView> views,
                                             std::span<const size_t> used) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const size_t i : used) {
    const Eigen::Vector3d ray =
        (views[i].cam_from_model.leftCols<3>().transpose() * views[i].normalized.homogeneous())
            .normalized();
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - ray * ray.transpose();
    normal += across;
    right += across * views[i].center;
  }
  const Eigen::Vector3d position = normal.ldlt().solve(right);
  if (!position.allFinite()) return std::nullopt;
  return position;
}

/// Gauss-Newton on the reprojection error, in pixels.
Eigen::Vector3d Refined(std::span<const TriangulationView> views, std::span<const size_t> used,
                        Eigen::Vector3d position) {
  constexpr int kMaxSteps = 10;
  for (int step = 0; step < kMaxSteps; ++step) {
    Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    for (const size_t i : used) {
      const Eigen::Vector3d x = ToCamera(views[i], position);
      if (!(x.z() > 0)) continue;
      Eigen::Matrix<double, 2, 3> by_x;
      by_x << 1, 0, -x.x() / x.z(), 0, 1, -x.y() / x.z();
      const Eigen::Matrix<double, 2, 3> jacobian =
          views[i].focal_px / x.z() * by_x * views[i].cam_from_model.leftCols<3>();
      hessian += jacobian.transpose() * jacobian;
      gradient +=
          jacobian.transpose() * (views[i].focal_px * (x.hnormalized() - views[i].normalized));
    }
    const Eigen::Vector3d update = hessian.ldlt().solve(gradient);
    if (!update.allFinite()) break;
    position -= update;
    if (update.squaredNorm() < 1e-20 * position.squaredNorm()) break;
  }
  return position;
}

std::vector<size_t> Agreeing(std::span<const TriangulationView> views,
                             const Eigen::Vector3d& position, double max_error_px) {
  std::vector<size_t> inliers;
  for (size_t i = 0; i < views.size(); ++i) {
    if (ReprojectionError_px(views[i], position) < max_error_px) inliers.push_back(i);
  }
  return inliers;
}

double TruncatedCost(std::span<const TriangulationView> views, const Eigen::Vector3d& position,
                     double max_error_px) {
  double cost = 0;
  for (const TriangulationView& view : views) {
    const double error = std::min(ReprojectionError_px(view, position), max_error_px);
    cost += error * error;
  }
  return cost;
}

double AngleOfViews_rad(std::span<const TriangulationView> views, std::span<const size_t> used,
                        const Eigen::Vector3d& position) {
  std::vector<Eigen::Vector3d> centers;
  for (const size_t i : used) centers.push_back(views[i].center);
  return LargestAngle_rad(centers, position);
}

/// Refines on the views that agree and takes the views that agree then.
std::optional<TriangulatedPoint> Settled(std::span<const TriangulationView> views,
                                         const Eigen::Vector3d& start,
                                         const TriangulationOptions& options) {
  std::vector<size_t> inliers = Agreeing(views, start, options.max_error_px);
  if (inliers.size() < 2) return std::nullopt;
  const Eigen::Vector3d position = Refined(views, inliers, start);
  inliers = Agreeing(views, position, options.max_error_px);
  if (inliers.size() < 2) return std::nullopt;
  if (AngleOfViews_rad(views, inliers, position) < options.min_angle_rad) return std::nullopt;
  return TriangulatedPoint{position, std::move(inliers)};
}

}  // namespace

TriangulationView MakeTriangulationView(const Rigid3& cam_from_model,
                                        const Eigen::Vector2d& normalized, double focal_px) {
  return {cam_from_model.Matrix(), cam_from_model.OriginInSource(), normalized, focal_px};
}

double ReprojectionError_px(const TriangulationView& view, const Eigen::Vector3d& position) {
  const Eigen::Vector3d x = ToCamera(view, position);
  if (!(x.z() > 0)) return std::numeric_limits<double>::infinity();
  return view.focal_px * (x.hnormalized() - view.normalized).norm();
}

double LargestAngle_rad(std::span<const Eigen::Vector3d> centers, const Eigen::Vector3d& position) {
  std::vector<Eigen::Vector3d> rays;
  for (const Eigen::Vector3d& center : centers) rays.push_back((position - center).normalized());
  double smallest_cosine = 1.0;
  for (size_t i = 0; i < rays.size(); ++i) {
    for (size_t j = 0; j < i; ++j)
      smallest_cosine = std::min(smallest_cosine, rays[i].dot(rays[j]));
  }
  return std::acos(std::clamp(smallest_cosine, -1.0, 1.0));
}

std::optional<TriangulatedPoint> Triangulate(std::span<const TriangulationView> views,
                                             const TriangulationOptions& options) {
  if (views.size() < 2) return std::nullopt;
  std::vector<size_t> all(views.size());
  for (size_t i = 0; i < all.size(); ++i) all[i] = i;
  if (const auto position = ClosestToRays(views, all)) {
    auto point = Settled(views, *position, options);
    if (point && point->inliers.size() == views.size()) return point;
  }
  if (views.size() == 2) return std::nullopt;
  const size_t pairs = views.size() * (views.size() - 1) / 2;
  const size_t stride = (pairs + kMaxPairs - 1) / kMaxPairs;
  std::optional<TriangulatedPoint> best;
  double best_cost = std::numeric_limits<double>::infinity();
  size_t pair = 0;
  for (size_t gap = views.size() - 1; gap > 0; --gap) {
    for (size_t i = 0; i + gap < views.size(); ++i) {
      if (pair++ % stride != 0) continue;
      const std::array<size_t, 2> used = {i, i + gap};
      const auto position = ClosestToRays(views, used);
      if (!position) continue;
      const double cost = TruncatedCost(views, *position, options.max_error_px);
      if (!(cost < best_cost)) continue;
      auto point = Settled(views, *position, options);
      if (!point) continue;
      best = std::move(point);
      best_cost = cost;
    }
  }
  return best;
}

}  // namespace rotunda::sfm
