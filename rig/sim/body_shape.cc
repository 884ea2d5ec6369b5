#include "rig/sim/body_shape.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <initializer_list>

#include "rig/sim/noise.h"

namespace rotunda::sim {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;

constexpr float kUnitHeight_m = 1.75f;  // the height all the constants below are for
constexpr float kShoulderZ = 1.390f;
constexpr float kArmToWrist = 0.535f;
constexpr float kAnkleZ = 0.085f;
constexpr float kHipZ = 0.86f;
const Vector3f kHeadPivot(-0.01f, 0.0f, 1.56f);

/// Smooth minimum with a blend of width k (Quilez, polynomial).
float SmoothMin(float a, float b, float k) {
  const float h = std::max(k - std::abs(a - b), 0.0f) / k;
  return std::min(a, b) - 0.25f * h * h * k;
}
float SmoothMax(float a, float b, float k) { return -SmoothMin(-a, -b, k); }

float Ellipsoid(const Vector3f& p, const Vector3f& centre, const Vector3f& radii) {
  const Vector3f q = (p - centre).cwiseQuotient(radii);
  const float k = q.norm();
  const float gradient = q.cwiseQuotient(radii).norm();
  return gradient < 1e-6f ? -radii.minCoeff() : k * (k - 1.0f) / gradient;
}

/// A capsule whose radius runs from ra to rb.
float Cone(const Vector3f& p, const Vector3f& a, const Vector3f& b, Vector2f radii) {
  const Vector3f axis = b - a;
  const float t = std::clamp((p - a).dot(axis) / axis.squaredNorm(), 0.0f, 1.0f);
  return (p - a - t * axis).norm() - (radii.x() + (radii.y() - radii.x()) * t);
}

struct Key {
  float at;
  float value;
};
/// Cubic (Catmull-Rom on uneven knots) through the keys, constant outside.
float Spline(std::initializer_list<Key> keys, float at) {
  const Key* k = keys.begin();
  const int count = static_cast<int>(keys.size());
  if (at <= k[0].at) return k[0].value;
  if (at >= k[count - 1].at) return k[count - 1].value;
  int i = 0;
  while (k[i + 1].at < at) ++i;
  const auto slope = [&](int j) {
    if (j == 0 || j == count - 1) return 0.0f;
    return (k[j + 1].value - k[j - 1].value) / (k[j + 1].at - k[j - 1].at);
  };
  const float h = k[i + 1].at - k[i].at, t = (at - k[i].at) / h;
  const float t2 = t * t, t3 = t2 * t;
  return (2 * t3 - 3 * t2 + 1) * k[i].value + (t3 - 2 * t2 + t) * h * slope(i) +
         (3 * t2 - 2 * t3) * k[i + 1].value + (t3 - t2) * h * slope(i + 1);
}

/// Distance to a cross-section |x/rx|^n + |y/ry|^n = 1 measured along the ray from its centre,
/// n = 2.5: between an ellipse and a rounded box, as chests are.
float SuperEllipse(const Vector2f& q, const Vector2f& radii) {
  const auto power = [](float v) { return v * v * std::sqrt(v); };
  const Vector2f n = q.cwiseAbs().cwiseQuotient(radii);
  const float k = std::pow(power(n.x()) + power(n.y()), 0.4f);
  return k < 1e-3f ? -radii.minCoeff() : q.norm() * (1.0f - 1.0f / k);
}

float Ellipse(const Vector2f& q, const Vector2f& radii) {
  const Vector2f n = q.cwiseQuotient(radii);
  const float k = n.norm(), gradient = n.cwiseQuotient(radii).norm();
  return gradient < 1e-6f ? -radii.minCoeff() : k * (k - 1.0f) / gradient;
}

Vector3f RotatedZ(const Vector3f& p, const Vector3f& pivot, float angle_rad) {
  return Eigen::AngleAxisf(angle_rad, Vector3f::UnitZ()) * (p - pivot) + pivot;
}

/// Lower bound of the distance to a box; used to leave out parts that cannot matter.
float BoxBound(const Vector3f& p, const Vector3f& low, const Vector3f& high) {
  return (low - p).cwiseMax(p - high).cwiseMax(0.0f).norm();
}

Vector3f WithMirroredY(const Vector3f& p) { return {p.x(), std::abs(p.y()), p.z()}; }

BodyLayout UnitLayout(const BodyProportions& p) {
  BodyLayout layout;
  const float arm = p.arm_angle_rad;
  for (float side : {1.0f, -1.0f}) {
    const Vector2f shoulder(side * p.shoulder_half_width, kShoulderZ);
    const Vector2f wrist = shoulder + kArmToWrist * Vector2f(side * std::sin(arm), -std::cos(arm));
    const Vector2f hip(side * 0.092f, kHipZ), ankle(side * p.stance_half_width, kAnkleZ);
    const Part arm_part = side > 0 ? Part::kLeftArm : Part::kRightArm;
    const Part leg_part = side > 0 ? Part::kLeftLeg : Part::kRightLeg;
    layout.parts[static_cast<size_t>(arm_part)] = {shoulder, wrist, 0.0f, 0.056f, 0.056f};
    layout.parts[static_cast<size_t>(leg_part)] = {hip, ankle, 0.0f, 0.078f, 0.082f};
  }
  layout.parts[static_cast<size_t>(Part::kTorso)] = {Vector2f(0, 1.5f), Vector2f(0, 0.8f), 0.0f,
                                                     0.172f, 0.115f};
  layout.neck_z_m = 1.478f;
  layout.cuff_s_m = kArmToWrist - 0.02f;
  layout.ankle_z_m = 0.105f;
  layout.hem_z_m = 0.85f;
  layout.crotch_z_m = 0.79f;
  layout.height_m = kUnitHeight_m;
  return layout;
}

BodyLayout Scaled(BodyLayout layout, float scale) {
  for (PartAxis& axis : layout.parts) {
    axis.start_yz *= scale;
    axis.end_yz *= scale;
    for (float* value : {&axis.x_m, &axis.half_width_m, &axis.half_depth_m}) *value *= scale;
  }
  for (float* value : {&layout.neck_z_m, &layout.cuff_s_m, &layout.ankle_z_m, &layout.hem_z_m,
                       &layout.crotch_z_m, &layout.height_m}) {
    *value *= scale;
  }
  return layout;
}

}  // namespace

BodyProportions DrawProportions(uint64_t seed) {
  Random random(seed);
  const auto between = [&](double low, double high) {
    return static_cast<float>(random.Uniform(low, high));
  };
  BodyProportions p;
  p.shoulder_half_width = between(0.165, 0.195);
  p.hip = between(0.95, 1.1);
  p.waist = between(0.95, 1.15);
  p.chest = between(0.94, 1.08);
  p.limb = between(0.92, 1.1);
  p.belly = between(0.0, 0.03);
  p.arm_angle_rad = between(0.50, 0.62);
  p.stance_half_width = between(0.12, 0.16);
  p.nose = between(0.85, 1.2);
  p.jaw = between(0.9, 1.12);
  p.ears = between(0.9, 1.15);
  p.head_yaw_rad = between(-0.10, 0.10);
  p.toe_out_rad = between(0.08, 0.25);
  p.hair_length = random.Chance(0.4) ? between(0.6, 1.0) : between(0.0, 0.2);
  p.fold_depth = between(0.7, 1.2);
  p.noise_seed = static_cast<uint32_t>(random.Bits());
  return p;
}

Vector3f HeadFrame::FromRig(const Vector3f& p) const {
  return RotatedZ(p / scale, kHeadPivot, -yaw_rad);
}

BodyShape::BodyShape(const BodyProportions& proportions, Relief relief, float height_m)
    : proportions_(proportions),
      relief_(relief),
      scale_(height_m / kUnitHeight_m),
      unit_layout_(UnitLayout(proportions)),
      layout_(Scaled(unit_layout_, scale_)),
      head_{proportions.head_yaw_rad, scale_} {}

float BodyShape::Distance(const Vector3f& p_in_rig) const {
  const Vector3f p = p_in_rig / scale_;
  if (relief_ == Relief::kNatural || p.x() >= 0) return scale_ * Whole(p);
  // The front's shape behind the garment, the back's own where skin and shoes show; the two agree
  // at x = 0.
  const float weight = SmoothStep(-0.025f, 0.0f, unit_layout_.GarmentInside_m(p));
  const float mirrored = weight > 0 ? Whole({-p.x(), p.y(), p.z()}) : 0.0f;
  const float own = weight < 1 ? Whole(p) : 0.0f;
  return scale_ * (weight * mirrored + (1 - weight) * own);
}

float BodyShape::Whole(const Vector3f& p) const {
  constexpr float kFar = 0.10f;  // beyond this a part's box stands for it
  const Vector3f q = WithMirroredY(p);
  float d = BoxBound(q, {-0.16f, 0, 0.72f}, {0.18f, 0.26f, 1.56f});
  if (d < kFar) d = Torso(q);
  const auto join = [&](float bound, float blend, auto&& part) {
    if (bound < std::max(d, 0.0f) + kFar) d = SmoothMin(d, bound > kFar ? bound : part(), blend);
  };
  join(BoxBound(q, {-0.12f, 0.10f, 0.85f}, {0.12f, 0.56f, 1.48f}), 0.07f, [&] { return Arm(q); });
  join(BoxBound(q, {-0.12f, 0.0f, 0.06f}, {0.12f, 0.27f, 0.92f}), 0.03f, [&] { return Leg(q); });
  if (d < 0.06f && unit_layout_.GarmentInside_m(q) > -0.01f) d -= Folds(p);
  join(BoxBound(q, {-0.09f, 0.38f, 0.72f}, {0.11f, 0.66f, 1.02f}), 0.008f, [&] { return Hand(q); });
  join(BoxBound(q, {-0.12f, 0.02f, 0.0f}, {0.26f, 0.28f, 0.16f}), 0.008f, [&] { return Shoe(q); });
  join(BoxBound(q, {-0.16f, 0, 1.40f}, {0.16f, 0.13f, 1.80f}), 0.012f,
       [&] { return Head(RotatedZ(p, kHeadPivot, -proportions_.head_yaw_rad)); });
  return d;
}

float BodyShape::Torso(const Vector3f& p) const {
  const BodyProportions& f = proportions_;
  const float z = p.z();
  const float half_width = Spline({{0.74f, 0.150f * f.hip},
                                   {0.82f, 0.170f * f.hip},
                                   {0.90f, 0.176f * f.hip},
                                   {1.00f, 0.162f * f.waist},
                                   {1.08f, 0.150f * f.waist},
                                   {1.20f, 0.160f * f.chest},
                                   {1.30f, 0.172f * f.chest},
                                   {1.37f, f.shoulder_half_width - 0.004f},
                                   {1.415f, f.shoulder_half_width - 0.022f},
                                   {1.445f, 0.125f},
                                   {1.468f, 0.090f},
                                   {1.49f, 0.068f},
                                   {1.52f, 0.064f}},
                                  z);
  const float front = Spline({{0.74f, 0.080f},
                              {0.82f, 0.100f},
                              {0.90f, 0.110f + 0.5f * f.belly},
                              {1.00f, 0.112f + f.belly},
                              {1.08f, 0.108f + f.belly},
                              {1.20f, 0.118f},
                              {1.28f, 0.128f * f.chest},
                              {1.36f, 0.108f},
                              {1.43f, 0.070f},
                              {1.47f, 0.058f},
                              {1.52f, 0.058f}},
                             z);
  const float back = Spline({{0.74f, 0.105f},
                             {0.82f, 0.128f * f.hip},
                             {0.88f, 0.128f * f.hip},
                             {0.97f, 0.108f},
                             {1.06f, 0.094f},
                             {1.18f, 0.106f},
                             {1.30f, 0.118f},
                             {1.38f, 0.112f},
                             {1.43f, 0.092f},
                             {1.47f, 0.072f},
                             {1.52f, 0.066f}},
                            z);
  // The shirt hangs a little outside of the trousers.
  const float shirt =
      0.009f * SmoothStep(unit_layout_.hem_z_m - 0.003f, unit_layout_.hem_z_m + 0.003f, z);
  const Vector2f radii(shirt + (p.x() > 0 ? front : back), shirt + half_width);
  const float side = 0.93f * SuperEllipse({p.x(), p.y()}, radii);
  const float collar = z - (unit_layout_.neck_z_m - unit_layout_.neck_slope * p.x());
  return SmoothMax(SmoothMax(side, collar, 0.012f), 0.76f - z, 0.04f);
}

float BodyShape::Arm(const Vector3f& p) const {
  const PartAxis& axis = unit_layout_.axis(Part::kLeftArm);
  const AxisPoint at = ToAxis(axis, p);
  const float radius = proportions_.limb * Spline({{0.0f, 0.062f},
                                                   {0.06f, 0.061f},
                                                   {0.16f, 0.054f},
                                                   {0.25f, 0.049f},
                                                   {0.30f, 0.050f},
                                                   {0.38f, 0.047f},
                                                   {0.52f, 0.039f}},
                                                  at.s_m);
  const float s = std::clamp(at.s_m, -0.01f, unit_layout_.cuff_s_m + 0.004f);
  const float over = at.s_m - s;
  const float d = Ellipse({p.x(), at.e_m}, {radius * 1.04f, radius * 0.97f});
  const float cap = std::hypot(std::max(d + 0.5f * radius, 0.0f), over) - 0.5f * radius;
  return over > 0 ? SmoothMax(d, over, 0.008f) : cap;
}

float BodyShape::Hand(const Vector3f& p) const {
  const PartAxis& axis = unit_layout_.axis(Part::kLeftArm);
  const AxisPoint at = ToAxis(axis, p);
  // Hand frame: x forward (the thumb's side), y out of the palm's back, z along the arm from the
  // wrist.
  const Vector3f h(p.x() - 0.002f, at.e_m, at.s_m - kArmToWrist);
  float d = Cone(h, {0, 0, -0.09f}, {0, 0, 0.0f}, {0.030f, 0.024f});
  d = SmoothMin(d, Ellipsoid(h, {0.002f, 0, 0.052f}, {0.042f, 0.0165f, 0.058f}), 0.03f);
  constexpr std::array<float, 4> kLength = {0.072f, 0.080f, 0.074f, 0.058f};
  for (int finger = 0; finger < 4; ++finger) {
    const float place = 1.5f - static_cast<float>(finger);  // the index finger is foremost
    const float spread = 0.085f * place;
    const float length = kLength[finger];
    const Vector3f root(0.002f + 0.0205f * place, 0.0f, 0.088f - 0.003f * place * place);
    const Vector3f knuckle = root + 0.45f * length * Vector3f(spread, -0.10f, 1.0f);
    const Vector3f middle = knuckle + 0.32f * length * Vector3f(spread, -0.32f, 0.95f);
    const Vector3f tip = middle + 0.23f * length * Vector3f(spread, -0.55f, 0.85f);
    float f = Cone(h, root, knuckle, {0.0092f, 0.0086f});
    f = SmoothMin(f, Cone(h, knuckle, middle, {0.0086f, 0.0079f}), 0.004f);
    f = SmoothMin(f, Cone(h, middle, tip, {0.0079f, 0.0070f}), 0.004f);
    d = SmoothMin(d, f, 0.008f);
  }
  float thumb = Cone(h, {0.022f, -0.004f, 0.022f}, {0.050f, -0.012f, 0.055f}, {0.0150f, 0.0115f});
  thumb = SmoothMin(
      thumb, Cone(h, {0.050f, -0.012f, 0.055f}, {0.062f, -0.018f, 0.085f}, {0.0108f, 0.0085f}),
      0.006f);
  return SmoothMin(d, thumb, 0.015f);
}

float BodyShape::Leg(const Vector3f& p) const {
  const AxisPoint at = ToAxis(unit_layout_.axis(Part::kLeftLeg), p);
  const float s = at.s_m;
  const float radius = proportions_.limb * Spline({{-0.04f, 0.090f},
                                                   {0.05f, 0.093f},
                                                   {0.15f, 0.089f},
                                                   {0.30f, 0.077f},
                                                   {0.42f, 0.068f},
                                                   {0.55f, 0.068f},
                                                   {0.66f, 0.062f},
                                                   {0.78f, 0.060f}},
                                                  s);
  const float forward = Spline({{0.0f, 0.0f},
                                {0.2f, 0.010f},
                                {0.42f, 0.008f},
                                {0.56f, -0.014f},
                                {0.70f, -0.010f},
                                {0.78f, -0.008f}},
                               s);
  const float d = Ellipse({p.x() - forward, at.e_m}, {radius * 1.05f, radius * 0.98f});
  const float hem = unit_layout_.ankle_z_m - 0.002f - p.z();
  const float trousers = SmoothMax(SmoothMax(d, hem, 0.008f), p.z() - 0.90f, 0.05f);
  const float ankle = Ellipse({p.x() + 0.008f, at.e_m}, {0.043f, 0.036f});
  const float sock = std::max({ankle, p.z() - 0.20f, 0.05f - p.z()});
  return std::min(trousers, sock);
}

float BodyShape::Shoe(const Vector3f& p) const {
  const Vector3f ankle(-0.008f, proportions_.stance_half_width, 0.0f);
  const Vector3f q = RotatedZ(p, ankle, -proportions_.toe_out_rad) - ankle;
  float d = Cone(q, {-0.045f, 0, 0.046f}, {0.11f, 0.006f, 0.040f}, {0.041f, 0.043f});
  d = SmoothMin(d, Cone(q, {0.11f, 0.006f, 0.038f}, {0.165f, 0.0f, 0.032f}, {0.044f, 0.032f}),
                0.03f);
  d = SmoothMin(d, Cone(q, {0.012f, 0, 0.092f}, {0.095f, 0.0f, 0.050f}, {0.038f, 0.032f}), 0.035f);
  d = SmoothMin(d, Cone(q, {-0.012f, 0, 0.05f}, {0.0f, 0, 0.105f}, {0.042f, 0.044f}), 0.02f);
  d = SmoothMax(d, q.z() - 0.112f, 0.01f);
  const float sole = d - 0.0055f;
  d = SmoothMin(d, SmoothMax(sole, q.z() - 0.026f, 0.004f), 0.003f);
  return SmoothMax(d, 0.0005f - q.z(), 0.006f);
}

float BodyShape::HairThickness(const Vector3f& h) const {
  const float around = std::atan2(std::abs(h.y()), h.x() + 0.01f);  // 0 front, pi back
  const float nape = 1.575f - 0.085f * proportions_.hair_length;
  const float line = Spline({{0.0f, 1.700f},
                             {0.7f, 1.692f},
                             {1.15f, 1.655f},
                             {1.45f, 1.648f},
                             {1.75f, 1.640f},
                             {2.1f, nape + 0.025f},
                             {3.1416f, nape}},
                            around);
  const float ragged = 0.004f * ValueNoise({around * 14.0f, h.y() * 30.0f, 0.5f}, 77);
  return 0.013f * SmoothStep(-0.004f, 0.022f, h.z() - line + ragged) - 0.0008f;
}

float BodyShape::Head(const Vector3f& h) const {
  const BodyProportions& f = proportions_;
  const Vector3f q = WithMirroredY(h);
  const float cranium = Ellipsoid(q, {-0.012f, 0, 1.650f}, {0.098f, 0.077f, 0.094f});
  float d = SmoothMin(cranium, Ellipsoid(q, {0.034f, 0, 1.600f}, {0.060f, 0.060f, 0.080f}), 0.03f);
  d = SmoothMin(d, Ellipsoid(q, {0.048f, 0, 1.545f}, {0.042f, 0.040f * f.jaw, 0.026f}), 0.035f);
  d = SmoothMin(d, Ellipsoid(q, {0.010f, 0.046f * f.jaw, 1.572f}, {0.035f, 0.014f, 0.03f}), 0.03f);
  d = SmoothMin(d, Cone(q, {-0.020f, 0, 1.42f}, {-0.012f, 0, 1.58f}, {0.058f, 0.050f}), 0.025f);
  if (q.x() > 0.0f && q.z() > 1.5f) {
    d = SmoothMin(d, Ellipsoid(q, {0.074f, 0.026f, 1.654f}, {0.016f, 0.026f, 0.009f}), 0.014f);
    d = SmoothMin(d, Ellipsoid(q, {0.062f, 0.044f, 1.606f}, {0.016f, 0.016f, 0.014f}), 0.02f);
    d = SmoothMax(d, -Ellipsoid(q, {0.106f, 0.033f, 1.633f}, {0.020f, 0.020f, 0.013f}), 0.014f);
    d = SmoothMin(d, Ellipsoid(q, {0.0745f, 0.0325f, 1.633f}, {0.0125f, 0.015f, 0.0105f}), 0.004f);
    const float bridge =
        Cone(q, {0.0885f, 0, 1.640f}, {0.099f + 0.011f * f.nose, 0, 1.598f}, {0.008f, 0.0115f});
    d = SmoothMin(d, bridge, 0.014f);
    d = SmoothMin(d, Ellipsoid(q, {0.099f, 0.0125f, 1.594f}, {0.0125f, 0.0075f, 0.008f}), 0.007f);
    d = SmoothMax(d, -Ellipsoid(q, {0.106f, 0.007f, 1.5865f}, {0.007f, 0.0035f, 0.004f}), 0.003f);
    const float bow = 4.0f * q.y() * q.y();
    d = SmoothMin(d,
                  Cone(q + Vector3f(bow * 3, 0, 0), {0.0935f, 0, 1.5725f},
                       {0.0925f, 0.020f, 1.5695f}, {0.0075f, 0.004f}),
                  0.006f);
    d = SmoothMin(d,
                  Cone(q + Vector3f(bow * 3, 0, 0), {0.0920f, 0, 1.5615f},
                       {0.0905f, 0.016f, 1.5640f}, {0.0085f, 0.005f}),
                  0.006f);
    d = SmoothMin(d, Ellipsoid(q, {0.082f, 0, 1.538f}, {0.014f, 0.018f, 0.014f}), 0.016f);
  }
  const Vector3f ear(-0.012f, 0.079f, 1.618f);
  const Vector3f e = Eigen::AngleAxisf(0.35f, Vector3f::UnitZ()) * (q - ear);
  float lobe = Ellipsoid(e, Vector3f::Zero(), {0.0185f, 0.0085f, 0.031f * f.ears});
  lobe = SmoothMax(lobe, -Ellipsoid(e, {0.003f, 0.008f, 0.003f}, {0.011f, 0.006f, 0.019f}), 0.005f);
  d = SmoothMin(d, lobe, 0.007f);
  const float hair = HairThickness(h);
  if (hair <= 0) return d;
  const float tuft = 0.35f * FractalNoise({h.x() * 55, h.y() * 55, h.z() * 22}, 2, f.noise_seed);
  const float bun = Ellipsoid(q, {-0.055f, 0, 1.56f - 0.03f * f.hair_length},
                              {0.055f, 0.068f, 0.06f + 0.02f * f.hair_length});
  const float mass = f.hair_length > 0.5f ? SmoothMin(cranium, bun, 0.03f) : cranium;
  // Rounded off where the hair thins out, so that long hair does not end in a step.
  const float end = 2.0f * (0.004f - hair);
  return SmoothMin(d, SmoothMax(mass - hair * (1.0f + tuft), end, 0.004f), 0.004f);
}

/// Cloth relief, metres outward: slow waves, and sharp folds where cloth gathers (elbows, knees,
/// waist, cuffs and hems).
float BodyShape::Folds(const Vector3f& p) const {
  const uint32_t seed = proportions_.noise_seed + 100;
  Vector3f q = p;
  if (relief_ == Relief::kSymmetric) {
    q = {std::abs(p.x()), std::sqrt(p.y() * p.y() + 1e-4f), p.z()};
  }
  const auto near = [&](float z, float width) {
    const float t = (p.z() - z) / width;
    return std::exp(-t * t);
  };
  const float arms = SmoothStep(0.18f, 0.24f, std::abs(p.y()));
  const float gather = 0.35f + 0.9f * near(1.02f, 0.07f) * (1 - arms) + 0.9f * near(0.48f, 0.10f) +
                       0.8f * near(0.16f, 0.07f) + 0.9f * near(1.17f, 0.08f) * arms +
                       0.6f * near(0.78f, 0.05f) + 0.5f * near(1.35f, 0.06f) * arms;
  const float waves = FractalNoise({q.x() * 9, q.y() * 9, q.z() * 6}, 2, seed);
  const Vector3f warp = q + 0.02f * Vector3f(0, 0, ValueNoise(q * 12, seed + 7));
  const float slanted = warp.z() + 0.45f * warp.y() + 0.3f * warp.x();
  const float ridge = ValueNoise({q.x() * 11, q.y() * 10, slanted * 24}, seed + 11);
  const float sharp = 1.0f - std::sqrt(ridge * ridge + 0.01f);
  const float folds = sharp * sharp - 0.4f;
  const float edge = SmoothStep(-0.005f, 0.02f, unit_layout_.GarmentInside_m(p));
  return proportions_.fold_depth * edge * (0.0030f * waves + 0.0042f * gather * folds);
}

Mesh MakeBodyMesh(const BodyShape& shape, float voxel_m, ThreadPool& threads) {
  const float scale = shape.layout().height_m / kUnitHeight_m;
  SurfaceOptions options;
  options.low = scale * Vector3f(-0.22f, -0.72f, -0.03f);
  options.high = scale * Vector3f(0.32f, 0.72f, 1.82f);
  options.voxel_m = voxel_m;
  return ExtractSurface([&](const Vector3f& p) { return shape.Distance(p); }, options, threads);
}

}  // namespace rotunda::sim
