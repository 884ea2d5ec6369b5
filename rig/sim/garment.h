#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "rig/sim/body_shape.h"
#include "rig/sim/texture.h"
#include "rig/sim/world.h"

namespace rotunda::sim {

enum class GarmentTexture { kUnique, kTwin, kPlaid, kOwn };

/// What is worn besides the garment. kHeadAndShoes: a hood over face and neck and shoes, each of
/// one colour, so that only hair and hands differ between front and back.
enum class Cover { kNone, kHeadAndShoes };
inline const Eigen::Vector3f kHoodAlbedo(0.16f, 0.16f, 0.18f);
inline const Eigen::Vector3f kPlainShoeAlbedo(0.08f, 0.08f, 0.09f);

/// Size of a panel of cloth, metres, and its resolution.
inline constexpr float kPanelWidth_m = 1.7f;
inline constexpr float kPanelHeight_m = 2.0f;
inline constexpr float kTexelsPerMetre = 1500.0f;

/// Draws one printed panel: `design` decides what is printed where, `style` (the same for both
/// sides of a garment) colours, print scale, contrast and density.
Picture DrawPanel(uint64_t style, uint64_t design, float hem_z_m);
/// A checked weave that repeats.
Picture DrawPlaid(uint64_t style);

/// Where a point of the garment lies on its panel.
struct PanelPoint {
  bool front = true;
  Part part = Part::kTorso;
  Eigen::Vector2f at_m;  // x to the viewer's right, from the body's middle; y up from the floor
};
/// Panels are sewn at the body's sides and wrapped around each part, so that the print is not
/// stretched at the sides; a viewer in front (behind) sees the front (back) panel upright. The back
/// is the front turned by 180 degrees about the vertical axis.
PanelPoint ToPanel(const BodyLayout& layout, const Eigen::Vector3f& p);

/// Both panels of a garment.
class Garment {
 public:
  Garment(GarmentTexture texture, uint64_t seed, const BodyLayout& layout);
  Eigen::Vector3f Albedo(const SurfacePoint& point) const;

 private:
  BodyLayout layout_;
  bool periodic_ = false;
  std::unique_ptr<Texture> front_;
  std::unique_ptr<Texture> back_;  // null: the same as the front
};

}  // namespace rotunda::sim
