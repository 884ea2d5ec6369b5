#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "rig/sim/body_shape.h"

namespace rotunda::sim {

AxisPoint ToAxis(const PartAxis& axis, const Eigen::Vector3f& p) {
  const Eigen::Vector2f along = (axis.end_yz - axis.start_yz).normalized();
  const Eigen::Vector2f offset = p.tail<2>() - axis.start_yz;
  // Across: the direction that is +y when the axis points straight down.
  return {along.dot(offset), Eigen::Vector2f(-along.y(), along.x()).dot(offset)};
}

Part BodyLayout::PartAt(const Eigen::Vector3f& p) const {
  const bool left = p.y() >= 0;
  if (p.z() < crotch_z_m + 0.35f * std::abs(p.y()) * height_m / 1.75f) {
    const Part leg = left ? Part::kLeftLeg : Part::kRightLeg;
    const Part arm = left ? Part::kLeftArm : Part::kRightArm;
    const float to_leg = std::abs(ToAxis(axis(leg), p).e_m) / axis(leg).half_width_m;
    const float to_arm = std::abs(ToAxis(axis(arm), p).e_m) / axis(arm).half_width_m;
    return to_leg < to_arm ? leg : arm;
  }
  const Part arm = left ? Part::kLeftArm : Part::kRightArm;
  const AxisPoint on_arm = ToAxis(axis(arm), p);
  const bool beyond_shoulder = std::abs(p.y()) > std::abs(axis(arm).start_yz.x());
  const bool on_limb = on_arm.s_m > 0 && std::abs(on_arm.e_m) < 1.6f * axis(arm).half_width_m;
  const float to_torso = std::abs(p.y()) / axis(Part::kTorso).half_width_m;
  if (beyond_shoulder && on_limb) return arm;
  return on_limb && to_torso > 1.05f ? arm : Part::kTorso;
}

bool BodyLayout::OnHead(const Eigen::Vector3f& p) const {
  return neck_z_m - neck_slope * p.x() - p.z() < 0.0f;
}

float BodyLayout::GarmentInside_m(const Eigen::Vector3f& p) const {
  const float neck = neck_z_m - neck_slope * p.x() - p.z();
  const float ankle = p.z() - ankle_z_m;
  const Part arm = p.y() >= 0 ? Part::kLeftArm : Part::kRightArm;
  const AxisPoint on_arm = ToAxis(axis(arm), p);
  const bool near_arm = std::abs(p.y()) > axis(Part::kTorso).half_width_m;
  const float reach = 3.0f * axis(arm).half_width_m;
  const float cuff = near_arm && std::abs(on_arm.e_m) < reach ? cuff_s_m - on_arm.s_m : 1.0f;
  return std::min({neck, ankle, cuff});
}

}  // namespace rotunda::sim
