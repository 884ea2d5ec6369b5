#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace rotunda {

/// x_in_b = b_from_a * x_in_a: rotation, then translation (metres, or the model's unit).
struct Rigid3 {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Rigid3 Inverse() const {
    const Eigen::Quaterniond inverse = rotation.conjugate();
    return {inverse, -(inverse * translation)};
  }
  Eigen::Matrix3d RotationMatrix() const { return rotation.toRotationMatrix(); }
  Eigen::Matrix<double, 3, 4> Matrix() const {
    Eigen::Matrix<double, 3, 4> m;
    m << RotationMatrix(), translation;
    return m;
  }
  /// For a cam_from_rig: the camera's centre in the rig frame.
  Eigen::Vector3d OriginInSource() const { return -(rotation.conjugate() * translation); }
};

inline Eigen::Vector3d operator*(const Rigid3& b_from_a, const Eigen::Vector3d& x_in_a) {
  return b_from_a.rotation * x_in_a + b_from_a.translation;
}
/// c_from_a = c_from_b * b_from_a.
inline Rigid3 operator*(const Rigid3& c_from_b, const Rigid3& b_from_a) {
  return {(c_from_b.rotation * b_from_a.rotation).normalized(),
          c_from_b.rotation * b_from_a.translation + c_from_b.translation};
}

/// Angle of the rotation that takes a to b, in radians, in [0, pi].
double RotationAngle_rad(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b);

/// [v]x: CrossMatrix(v) * w = v.cross(w).
Eigen::Matrix3d CrossMatrix(const Eigen::Vector3d& v);

/// x_in_b = scale * rotation * x_in_a + translation.
struct Sim3 {
  double scale = 1.0;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Sim3 Inverse() const {
    const Eigen::Quaterniond inverse = rotation.conjugate();
    return {1.0 / scale, inverse, -(inverse * translation) / scale};
  }
};

inline Eigen::Vector3d operator*(const Sim3& b_from_a, const Eigen::Vector3d& x_in_a) {
  return b_from_a.scale * (b_from_a.rotation * x_in_a) + b_from_a.translation;
}

/// The camera pose in frame b for a pose in frame a: the picture stays the same (x_cam is scaled
/// by b_from_a.scale, which projection does not see).
Rigid3 TransformPose(const Sim3& b_from_a, const Rigid3& cam_from_a);

constexpr double kPi = 3.14159265358979323846;
constexpr double RadFromDeg(double deg) { return deg * kPi / 180.0; }
constexpr double DegFromRad(double rad) { return rad * 180.0 / kPi; }

}  // namespace rotunda
