#include "rig/sim/body_paint.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "rig/sim/noise.h"

namespace rotunda::sim {
namespace {

using Eigen::Vector3f;

Vector3f Mix(const Vector3f& a, const Vector3f& b, float t) { return a + t * (b - a); }

// Linear reflectances.
const std::array<Vector3f, 4> kSkins = {
    Vector3f(0.56f, 0.34f, 0.25f), Vector3f(0.48f, 0.28f, 0.19f), Vector3f(0.34f, 0.19f, 0.12f),
    Vector3f(0.20f, 0.11f, 0.07f)};
const std::array<Vector3f, 5> kHairs = {
    Vector3f(0.035f, 0.025f, 0.020f), Vector3f(0.09f, 0.05f, 0.03f), Vector3f(0.18f, 0.10f, 0.05f),
    Vector3f(0.36f, 0.25f, 0.12f), Vector3f(0.30f, 0.29f, 0.28f)};
const std::array<Vector3f, 4> kShoes = {
    Vector3f(0.07f, 0.05f, 0.045f), Vector3f(0.20f, 0.10f, 0.05f), Vector3f(0.45f, 0.45f, 0.47f),
    Vector3f(0.06f, 0.09f, 0.20f)};
const std::array<Vector3f, 4> kIrises = {
    Vector3f(0.05f, 0.025f, 0.012f), Vector3f(0.08f, 0.14f, 0.22f), Vector3f(0.08f, 0.12f, 0.05f),
    Vector3f(0.12f, 0.07f, 0.03f)};

class BodyPaint : public Paint {
 public:
  BodyPaint(const BodyShape& shape, Garment garment, Cover cover, uint64_t seed)
      : shape_(shape),
        garment_(std::move(garment)),
        covered_(cover == Cover::kHeadAndShoes),
        noise_(static_cast<uint32_t>(Hash64(seed))) {
    Random random(seed);
    skin_ = kSkins[random.Index(4)] * static_cast<float>(random.Uniform(0.9, 1.1));
    hair_ = kHairs[random.Index(5)] * static_cast<float>(random.Uniform(0.85, 1.2));
    shoe_ = kShoes[random.Index(4)];
    iris_ = kIrises[random.Index(4)];
    freckles_ = static_cast<float>(random.Uniform(0.05, 0.5));
  }

  Vector3f Albedo(const SurfacePoint& point) const override {
    switch (KindAt(point.position)) {
      case Kind::kGarment:
        return GarmentAlbedo(point);
      case Kind::kHair:
        return Hair(shape_.head().FromRig(point.position));
      case Kind::kShoe:
        if (covered_) return kPlainShoeAlbedo;
        return Shoe(point.position / shape_.head().scale);
      case Kind::kHead:
        if (covered_) return kHoodAlbedo;
        return Face(shape_.head().FromRig(point.position));
      case Kind::kSkin:
        break;
    }
    return Skin(point.position / shape_.head().scale);
  }

  float Gloss(const SurfacePoint& point) const override {
    switch (KindAt(point.position)) {
      case Kind::kGarment:
        return 0.0f;
      case Kind::kShoe:
        return covered_ ? 0.0f : 0.03f;
      case Kind::kHead:
        return covered_ ? 0.0f : 0.02f;
      default:
        return 0.02f;
    }
  }

 private:
  enum class Kind { kGarment, kHair, kShoe, kHead, kSkin };

  Kind KindAt(const Vector3f& p) const {
    const float scale = shape_.head().scale;
    const BodyLayout& layout = shape_.layout();
    const bool far_out = std::abs(p.y()) > 0.3f * scale;
    if (p.z() > layout.neck_z_m - 0.03f * scale && !far_out) {
      const Vector3f h = shape_.head().FromRig(p);
      if (h.z() > 1.44f && shape_.HairThickness(h) > 0.001f) return Kind::kHair;
      if (layout.GarmentInside_m(p) < 0.0f) return Kind::kHead;
      return Kind::kGarment;
    }
    if (p.z() < layout.ankle_z_m + 0.01f * scale && !far_out) {
      return layout.GarmentInside_m(p) > -0.004f ? Kind::kGarment : Kind::kShoe;
    }
    return layout.GarmentInside_m(p) < -0.003f * scale ? Kind::kSkin : Kind::kGarment;
  }

  Vector3f GarmentAlbedo(const SurfacePoint& point) const {
    const float inside = shape_.layout().GarmentInside_m(point.position);
    // A sewn edge.
    const float stitch = 1.0f - 0.35f * SmoothStep(0.0015f, 0.0f, std::abs(inside - 0.016f));
    return stitch * garment_.Albedo(point);
  }

  Vector3f Skin(const Vector3f& p) const {
    const float blotch = FractalNoise(p * 45, 2, noise_);
    const float pores = FractalNoise(p * 260, 2, noise_ + 9);
    Vector3f skin = skin_ * (1.0f + 0.10f * blotch + 0.07f * pores);
    skin.x() *= 1.0f + 0.05f * ValueNoise(p * 30, noise_ + 3);
    const Spot freckle = NearestSpot(p * 110, noise_ + 5);
    if (freckle.random < freckles_) {
      const float size = 0.10f + 0.25f * freckle.random / freckles_;
      skin *= 1.0f - 0.30f * SmoothStep(size, 0.4f * size, freckle.distance);
    }
    const Spot mole = NearestSpot(p * 30, noise_ + 6);
    if (mole.random < 0.12f) skin *= 1.0f - 0.6f * SmoothStep(0.07f, 0.03f, mole.distance);
    return skin;
  }

  Vector3f Face(const Vector3f& h) const {
    Vector3f colour = Skin(h);
    const float y = std::abs(h.y());
    if (h.x() < 0.02f) return colour;
    const float blush = std::exp(
        -(std::pow((y - 0.045f) / 0.02f, 2.0f) + std::pow((h.z() - 1.595f) / 0.02f, 2.0f)));
    colour = Mix(colour, colour.cwiseProduct(Vector3f(1.05f, 0.90f, 0.88f)), blush);
    // Lips.
    const float upper = (h.z() - 1.567f) / (0.0085f * (1.0f - std::pow(y / 0.028f, 2.0f)) + 1e-4f);
    const float lip = y < 0.026f ? SmoothStep(1.15f, 0.85f, std::abs(upper)) : 0.0f;
    const Vector3f lips = skin_.cwiseProduct(Vector3f(0.85f, 0.50f, 0.50f)) *
                          (1.0f + 0.12f * ValueNoise({h.y() * 900, h.z() * 150, 0}, noise_ + 11));
    colour = Mix(colour, lips, lip);
    colour *= 1.0f - 0.65f * lip * SmoothStep(0.0016f, 0.0004f, std::abs(h.z() - 1.567f));
    return Eyes(h, Brows(h, colour));
  }

  Vector3f Brows(const Vector3f& h, const Vector3f& under) const {
    const float y = std::abs(h.y());
    const float arch =
        1.660f + 0.005f * SmoothStep(0.012f, 0.036f, y) - 0.012f * SmoothStep(0.040f, 0.058f, y);
    const float inside = SmoothStep(0.012f, 0.016f, y) * SmoothStep(0.057f, 0.050f, y) *
                         SmoothStep(0.0058f, 0.0030f, std::abs(h.z() - arch));
    const float hairs = 0.75f + 0.3f * ValueNoise({h.y() * 800, h.z() * 350, 0}, noise_ + 13);
    return Mix(under, 0.8f * hair_, std::clamp(inside * hairs, 0.0f, 1.0f));
  }

  Vector3f Eyes(const Vector3f& h, const Vector3f& under) const {
    if (h.x() < 0.06f) return under;
    const float side = h.y() > 0 ? 1.0f : -1.0f;
    const float u = std::abs(h.y()) - 0.0325f;
    const float v = h.z() - 1.6335f;
    // An almond: two arcs that meet at the corners.
    const float lens = 1.0f - std::pow(u / 0.0145f, 2.0f);
    const float upper = 0.0062f * lens, lower = -0.0046f * lens;
    if (lens <= 0) return under;
    const float open = std::min(upper - v, v - lower);
    const Vector3f lashes = 0.6f * hair_;
    if (open < -0.0016f) return under;
    if (open < 0.0f) return Mix(under, lashes, 0.9f * SmoothStep(-0.0016f, -0.0004f, open));
    const float gaze = side * u - 0.001f;
    const float radius = std::hypot(gaze, v - 0.0006f);
    Vector3f eye(0.62f, 0.58f, 0.55f);
    const float streaks =
        1.0f + 0.35f * ValueNoise({std::atan2(v, gaze) * 5.0f, radius * 300, 0}, noise_ + 15);
    eye = Mix(eye, iris_ * streaks, SmoothStep(0.0058f, 0.0050f, radius));
    eye = Mix(eye, Vector3f::Constant(0.01f), SmoothStep(0.0026f, 0.0018f, radius));
    const float glint = std::hypot(gaze + 0.0015f, v - 0.0022f);
    eye = Mix(eye, Vector3f::Constant(0.9f), SmoothStep(0.0011f, 0.0006f, glint));
    return eye * (0.6f + 0.4f * SmoothStep(0.0f, 0.0030f, open));
  }

  Vector3f Hair(const Vector3f& h) const {
    const Vector3f crown(-0.03f, 0.01f, 1.72f);
    const Vector3f from_crown = h - crown;
    const float around = std::atan2(from_crown.y(), from_crown.x());
    const float down = from_crown.norm();
    const float wave = 0.25f * ValueNoise(h * 40, noise_ + 21);
    const float strands = ValueNoise({(around + wave * 0.5f) * 42, down * 28, 0.5f}, noise_ + 22);
    const float fine = ValueNoise({(around + wave) * 95, down * 60, 0.5f}, noise_ + 23);
    const float locks = FractalNoise({around * 9 + wave, down * 25, h.z() * 20}, 2, noise_ + 24);
    const float factor = 1.0f + 0.30f * strands + 0.25f * fine + 0.25f * locks;
    return hair_ * std::max(factor, 0.15f);
  }

  Vector3f Shoe(const Vector3f& p) const {
    const uint32_t side = p.y() > 0 ? 0 : 50;
    const float grain = FractalNoise(p * 180, 2, noise_ + 31 + side);
    const float scuff = SmoothStep(0.45f, 0.9f, FractalNoise(p * 60, 3, noise_ + 33 + side));
    if (p.z() < 0.024f) {
      const float groove = SmoothStep(0.0012f, 0.0004f, std::abs(p.z() - 0.012f));
      return Vector3f(0.42f, 0.40f, 0.37f) * (1.0f + 0.15f * grain - 0.4f * scuff) *
             (1.0f - 0.6f * groove);
    }
    Vector3f colour = Mix(shoe_ * (1.0f + 0.15f * grain), Vector3f::Constant(0.3f), 0.25f * scuff);
    const float middle = shape_.proportions().stance_half_width;
    const float out = shape_.proportions().toe_out_rad;
    const float across = std::abs(p.y()) - middle - out * p.x();
    if (p.x() > 0.03f && p.x() < 0.105f && std::abs(across) < 0.022f && p.z() > 0.05f) {
      const float phase = p.x() * 75.0f + (across > 0 ? across : -across) * 12.0f;
      const float lace = SmoothStep(0.30f, 0.18f, std::abs(phase - std::floor(phase) - 0.5f));
      colour = Mix(colour, Vector3f(0.6f, 0.58f, 0.55f), lace);
    }
    const float seam = std::abs(p.z() - 0.045f - 0.15f * std::max(0.0f, 0.06f - p.x()));
    return colour * (1.0f - 0.4f * SmoothStep(0.0016f, 0.0006f, seam));
  }

  BodyShape shape_;
  Garment garment_;
  bool covered_;
  uint32_t noise_;
  Vector3f skin_, hair_, shoe_, iris_;
  float freckles_ = 0;
};

}  // namespace

std::unique_ptr<Paint> MakeBodyPaint(const BodyShape& shape, Garment garment, Cover cover,
                                     uint64_t seed) {
  return std::make_unique<BodyPaint>(shape, std::move(garment), cover, seed);
}

}  // namespace rotunda::sim
