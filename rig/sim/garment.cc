#include "rig/sim/garment.h"

#include <algorithm>
#include <cmath>

#include "rig/sim/noise.h"
#include "sfm/core/run_context.h"

namespace rotunda::sim {
namespace {

constexpr float kHalfPi = 1.5707963f;
constexpr float kPlaidPeriod_m = 0.16f;

/// Quarter of an ellipse's circumference (Ramanujan 1914).
float QuarterArc(float a, float b) {
  const float h = (a - b) * (a - b) / ((a + b) * (a + b));
  return 0.5f * kHalfPi * (a + b) * (1.0f + 3.0f * h / (10.0f + std::sqrt(4.0f - 3.0f * h)));
}

}  // namespace

PanelPoint ToPanel(const BodyLayout& layout, const Eigen::Vector3f& p) {
  PanelPoint point;
  Eigen::Vector3f q = p;
  point.front = p.x() >= layout.axis(layout.PartAt(p)).x_m;
  if (!point.front) {
    // Seen from behind: turned by 180 degrees about the vertical through the part's plane.
    const float x_m = layout.axis(layout.PartAt(p)).x_m;
    q = {2 * x_m - p.x(), -p.y(), p.z()};
  }
  point.part = layout.PartAt(q);
  const PartAxis& axis = layout.axis(point.part);
  const AxisPoint on_axis = ToAxis(axis, q);
  const float angle =
      std::atan2(on_axis.e_m / axis.half_width_m, (q.x() - axis.x_m) / axis.half_depth_m);
  const float across = angle / kHalfPi * QuarterArc(axis.half_width_m, axis.half_depth_m);
  const Eigen::Vector2f along = (axis.end_yz - axis.start_yz).normalized();
  point.at_m =
      axis.start_yz + on_axis.s_m * along + across * Eigen::Vector2f(-along.y(), along.x());
  return point;
}

Garment::Garment(GarmentTexture texture, uint64_t seed, const BodyLayout& layout)
    : layout_(layout), periodic_(texture == GarmentTexture::kPlaid) {
  const uint64_t style = DeriveSeed(seed, 1);
  if (periodic_) {
    front_ = std::make_unique<Texture>(DrawPlaid(style), Texture::Wrap::kRepeat);
    return;
  }
  front_ = std::make_unique<Texture>(DrawPanel(style, DeriveSeed(seed, 2), layout.hem_z_m));
  if (texture == GarmentTexture::kUnique) {
    back_ = std::make_unique<Texture>(DrawPanel(style, DeriveSeed(seed, 3), layout.hem_z_m));
  }
}

Eigen::Vector3f Garment::Albedo(const SurfacePoint& point) const {
  const PanelPoint panel = ToPanel(layout_, point.position);
  const Texture& texture = panel.front || !back_ ? *front_ : *back_;
  const float footprint = point.footprint_m * kTexelsPerMetre;
  if (periodic_) {
    const float texels = static_cast<float>(texture.width()) / kPlaidPeriod_m;
    return texture.Sample(panel.at_m.x() * texels, -panel.at_m.y() * texels,
                          point.footprint_m * texels);
  }
  return texture.Sample((panel.at_m.x() + 0.5f * kPanelWidth_m) * kTexelsPerMetre,
                        (kPanelHeight_m - panel.at_m.y()) * kTexelsPerMetre, footprint);
}

}  // namespace rotunda::sim
