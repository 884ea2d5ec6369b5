#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "rig/sim/mesh.h"

namespace rotunda::sim {

enum class Relief { kNatural, kSymmetric };

/// The parts garments are cut for. Left and right are the subject's; the subject faces +x, its left
/// is +y.
enum class Part { kTorso, kLeftArm, kRightArm, kLeftLeg, kRightLeg };

/// A straight axis in the plane x = x_m, from `start` to `end` in (y, z), with the half widths of
/// the part along its two cross directions: what a panel is wrapped around.
struct PartAxis {
  Eigen::Vector2f start_yz;
  Eigen::Vector2f end_yz;
  float x_m = 0;
  float half_width_m = 0.1f;  // in the y-z plane, across the axis
  float half_depth_m = 0.1f;  // along x
};

/// Where a body's parts are. All in metres in the rig frame; the garment covers what lies between
/// the limits.
struct BodyLayout {
  std::array<PartAxis, 5> parts;  // index: Part
  float neck_z_m = 1.5f;          // the garment ends here on the neck
  float neck_slope = 0.25f;       // its edge rises by this per metre towards the back (-x)
  float cuff_s_m = 0.5f;          // and here along each arm's axis
  float ankle_z_m = 0.1f;         // and here on each leg
  float hem_z_m = 0.86f;          // shirt above, trousers below
  float crotch_z_m = 0.80f;
  float height_m = 1.75f;

  const PartAxis& axis(Part part) const { return parts[static_cast<size_t>(part)]; }
  /// The part nearest to a point.
  Part PartAt(const Eigen::Vector3f& p) const;
  /// Signed distance along the surface to the garment's nearest edge, about metres, positive on
  /// the garment.
  float GarmentInside_m(const Eigen::Vector3f& p) const;
  /// Whether a point is beyond the garment's edge on the neck, or below those on the legs.
  bool OnHead(const Eigen::Vector3f& p) const;
  bool OnFoot(const Eigen::Vector3f& p) const { return p.z() < ankle_z_m; }
};

/// Coordinates of a point along and across a part's axis: s from the start, e across (towards +y
/// for the torso, away from the body's middle line's direction rotated with the axis for limbs).
struct AxisPoint {
  float s_m = 0;
  float e_m = 0;
};
AxisPoint ToAxis(const PartAxis& axis, const Eigen::Vector3f& p);

/// Places on the head that the painter needs, in the head's own frame at a height of 1.75 m.
struct HeadFrame {
  float yaw_rad = 0;
  float scale = 1;  // rig metres per metre of the 1.75 m body
  /// A rig point in the head's frame.
  Eigen::Vector3f FromRig(const Eigen::Vector3f& p) const;
};

/// Proportions that vary between people, by the seed. Lengths in metres for a height of 1.75 m.
struct BodyProportions {
  float shoulder_half_width = 0.185f;
  float hip = 1, waist = 1, chest = 1, limb = 1;  // factors
  float belly = 0;                                // extra depth in front
  float arm_angle_rad = 0.6f;                     // from straight down
  float stance_half_width = 0.13f;
  float nose = 1, jaw = 1, ears = 1;
  float head_yaw_rad = 0;
  float toe_out_rad = 0.15f;
  float hair_length = 0;  // 0 short .. 1 to the neck
  float fold_depth = 1;   // factor on the cloth's folds
  uint32_t noise_seed = 1;
};
BodyProportions DrawProportions(uint64_t seed);

/// The procedural person: an implicit surface made of lofted, smoothly joined parts.
class BodyShape {
 public:
  BodyShape(const BodyProportions& proportions, Relief relief, float height_m);

  /// Distance-like function in rig metres; see DistanceFunction.
  float Distance(const Eigen::Vector3f& p_in_rig) const;
  const BodyLayout& layout() const { return layout_; }
  const HeadFrame& head() const { return head_; }
  const BodyProportions& proportions() const { return proportions_; }
  /// Thickness of hair at a point of the head's frame, metres; positive: hair is what is seen.
  float HairThickness(const Eigen::Vector3f& p_in_head) const;

 private:
  float Whole(const Eigen::Vector3f& p) const;  // both in metres of the 1.75 m body
  float Head(const Eigen::Vector3f& p_in_head) const;
  float Torso(const Eigen::Vector3f& p) const;
  float Arm(const Eigen::Vector3f& p) const;  // these four for y >= 0
  float Hand(const Eigen::Vector3f& p) const;
  float Leg(const Eigen::Vector3f& p) const;
  float Shoe(const Eigen::Vector3f& p) const;
  float Folds(const Eigen::Vector3f& p) const;

  BodyProportions proportions_;
  Relief relief_;
  float scale_;
  BodyLayout unit_layout_;  // for the 1.75 m body
  BodyLayout layout_;       // in rig metres
  HeadFrame head_;
};

/// The person's closed mesh.
Mesh MakeBodyMesh(const BodyShape& shape, float voxel_m, ThreadPool& threads);

}  // namespace rotunda::sim
