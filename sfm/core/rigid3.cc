#include "sfm/core/rigid3.h"

#include <cmath>

namespace rotunda {

double RotationAngle_rad(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  const Eigen::Quaterniond b_from_a = b.conjugate() * a;
  return 2.0 * std::atan2(b_from_a.vec().norm(), std::abs(b_from_a.w()));
}

Eigen::Matrix3d CrossMatrix(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

Rigid3 TransformPose(const Sim3& b_from_a, const Rigid3& cam_from_a) {
  const Eigen::Quaterniond cam_from_b =
      (cam_from_a.rotation * b_from_a.rotation.conjugate()).normalized();
  return {cam_from_b, b_from_a.scale * cam_from_a.translation - cam_from_b * b_from_a.translation};
}

}  // namespace rotunda
