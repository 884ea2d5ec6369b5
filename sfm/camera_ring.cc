#include "sfm/camera_ring.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace rotunda::sfm {
namespace {

/// Optical axes that diverge by less have no point they look at: sine of the angle, root mean
/// square.
constexpr double kParallel = 1e-3;

/// Mean cosine of the angle between the axis and the pictures' upward direction.
constexpr double kUpright = 0.5;

struct Axes {
  std::vector<Eigen::Vector3d> centres;
  std::vector<Eigen::Vector3d> directions;
  Eigen::Vector3d up = Eigen::Vector3d::Zero();  // sum of the pictures' upward directions
};

Axes OpticalAxes(const Reconstruction& model) {
  Axes axes;
  for (const std::optional<Rigid3>& cam_from_model : model.cam_from_model) {
    if (!cam_from_model) continue;
    axes.centres.push_back(cam_from_model->OriginInSource());
    axes.directions.push_back(cam_from_model->rotation.conjugate() * Eigen::Vector3d::UnitZ());
    axes.up -= cam_from_model->rotation.conjugate() * Eigen::Vector3d::UnitY();
  }
  return axes;
}

/// argmin over x of the sum of squared distances to the axes: sum (I - d d^T) (x - c) = 0.
std::optional<Eigen::Vector3d> NearestPoint(const Axes& axes) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (size_t i = 0; i < axes.centres.size(); ++i) {
    const Eigen::Vector3d& d = axes.directions[i];
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - d * d.transpose();
    normal += across;
    right += across * axes.centres[i];
  }
  normal /= static_cast<double>(axes.centres.size());
  right /= static_cast<double>(axes.centres.size());
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(normal);
  if (eigen.eigenvalues()[0] < kParallel * kParallel) return std::nullopt;
  return normal.ldlt().solve(right);
}

double Azimuth_rad(const CameraRing& ring, const Eigen::Vector3d& camera) {
  const Eigen::Vector3d u = ring.axis.unitOrthogonal(), v = ring.axis.cross(u);
  const Eigen::Vector3d from_centre = camera - ring.centre;
  return std::atan2(v.dot(from_centre), u.dot(from_centre));
}

double WidestGap_rad(const Axes& axes, const CameraRing& ring) {
  std::vector<double> azimuths_rad;
  for (const Eigen::Vector3d& camera : axes.centres) {
    azimuths_rad.push_back(Azimuth_rad(ring, camera));
  }
  std::sort(azimuths_rad.begin(), azimuths_rad.end());
  double widest_rad = azimuths_rad.front() + 2 * kPi - azimuths_rad.back();
  for (size_t i = 1; i < azimuths_rad.size(); ++i) {
    widest_rad = std::max(widest_rad, azimuths_rad[i] - azimuths_rad[i - 1]);
  }
  return widest_rad;
}

}  // namespace

std::optional<CameraRing> FindCameraRing(const Reconstruction& model) {
  const Axes axes = OpticalAxes(model);
  if (axes.centres.size() < 2) return std::nullopt;
  const std::optional<Eigen::Vector3d> centre = NearestPoint(axes);
  if (!centre) return std::nullopt;
  // Moments about the centre, not the mean: an arc then has the same axis as the whole ring.
  Eigen::Matrix3d moments = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& camera : axes.centres) {
    const Eigen::Vector3d from_centre = camera - *centre;
    moments += from_centre * from_centre.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(moments);
  const Eigen::Vector3d axis = eigen.eigenvectors().col(0);
  const double up = axis.dot(axes.up) / static_cast<double>(axes.centres.size());
  CameraRing ring{*centre, up < 0 ? -axis : axis, std::abs(up) > kUpright, 0};
  ring.widest_gap_rad = WidestGap_rad(axes, ring);
  return ring;
}

std::vector<std::optional<double>> AzimuthsAround(const CameraRing& ring,
                                                  const Reconstruction& model) {
  std::vector<std::optional<double>> azimuths_rad;
  for (const std::optional<Rigid3>& cam_from_model : model.cam_from_model) {
    std::optional<double>& azimuth_rad = azimuths_rad.emplace_back();
    if (cam_from_model) azimuth_rad = Azimuth_rad(ring, cam_from_model->OriginInSource());
  }
  return azimuths_rad;
}

}  // namespace rotunda::sfm
