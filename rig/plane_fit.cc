#include "rig/plane_fit.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>

namespace rotunda::rig {
namespace {

/// Takes the points' mean to 0 and their mean distance from it to sqrt(2).
Eigen::Matrix3d Normalisation(const std::vector<PlanePoint>& points,
                              Eigen::Vector2d PlanePoint::*member) {
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const PlanePoint& point : points) mean += point.*member;
  mean /= static_cast<double>(points.size());
  double spread = 0;
  for (const PlanePoint& point : points) spread += (point.*member - mean).norm();
  const double scale = std::sqrt(2.0) * static_cast<double>(points.size()) / spread;
  Eigen::Matrix3d m;
  m << scale, 0, -scale * mean.x(), 0, scale, -scale * mean.y(), 0, 0, 1;
  return m;
}

}  // namespace

std::optional<PlaneFit> PlaneFit::Fit(const std::vector<PlanePoint>& points) {
  if (points.size() < 4) return std::nullopt;
  const Eigen::Matrix3d from_face = Normalisation(points, &PlanePoint::on_face);
  const Eigen::Matrix3d from_pixel = Normalisation(points, &PlanePoint::pixel);
  if (!from_face.allFinite() || !from_pixel.allFinite()) return std::nullopt;
  Eigen::Matrix<double, 9, 9> normal = Eigen::Matrix<double, 9, 9>::Zero();
  for (const PlanePoint& point : points) {
    const Eigen::Vector3d a = from_face * point.on_face.homogeneous();
    const Eigen::Vector3d b = from_pixel * point.pixel.homogeneous();
    Eigen::Matrix<double, 2, 9> rows;
    rows << a.transpose(), Eigen::RowVector3d::Zero(), -b.x() * a.transpose(),
        Eigen::RowVector3d::Zero(), a.transpose(), -b.y() * a.transpose();
    normal += rows.transpose() * rows;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 9, 9>> solver(normal);
  // A second small value: more than one homography fits.
  constexpr double kDegenerate = 1e-10;
  if (!(solver.eigenvalues()[1] > kDegenerate * solver.eigenvalues()[8])) return std::nullopt;
  const Eigen::Matrix<double, 9, 1> h = solver.eigenvectors().col(0);
  Eigen::Matrix3d normalised;
  normalised << h.segment<3>(0).transpose(), h.segment<3>(3).transpose(),
      h.segment<3>(6).transpose();
  const Eigen::Matrix3d full = from_pixel.inverse() * normalised * from_face;
  return full.allFinite() ? std::optional(PlaneFit(full)) : std::nullopt;
}

Eigen::Vector2d PlaneFit::Pixel(const Eigen::Vector2d& on_face) const {
  return (h_ * on_face.homogeneous()).hnormalized();
}

Eigen::Matrix2d PlaneFit::PixelsPerSquare(const Eigen::Vector2d& on_face) const {
  const Eigen::Vector3d p = h_ * on_face.homogeneous();
  const Eigen::Vector2d pixel = p.hnormalized();
  return (h_.topLeftCorner<2, 2>() - pixel * h_.row(2).head<2>()) / p.z();
}

}  // namespace rotunda::rig
