#include "rig/sim/studio.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "rig/sim/noise.h"

namespace rotunda::sim {
namespace {

using Eigen::Vector3f;

constexpr float kRoomRadius_m = 3.2f;
constexpr float kRoomHeight_m = 3.0f;
constexpr float kPoleBehind_m = 0.11f;  // the poles stand this far behind the lenses
constexpr float kPoleRadius_m = 0.02f;

/// Grey vinyl with speckles; tape rings, a cross and ticks for the subject's feet.
class FloorPaint : public Paint {
 public:
  FloorPaint(const RigGeometry& rig, uint32_t noise) : columns_(rig.columns), noise_(noise) {}
  bool Detailed() const override { return false; }
  Vector3f Albedo(const SurfacePoint& point) const override {
    const Vector3f& p = point.position;
    const float radius = p.head<2>().norm();
    const float speckle = FractalNoise({p.x() * 130, p.y() * 130, 0.5f}, 2, noise_);
    const float cloud = FractalNoise({p.x() * 3, p.y() * 3, 0.5f}, 3, noise_ + 5);
    const float scuff =
        SmoothStep(0.5f, 0.8f, ValueNoise({p.x() * 30, p.y() * 9, 0.5f}, noise_ + 8));
    Vector3f colour =
        Vector3f(0.115f, 0.115f, 0.12f) * (1.0f + 0.16f * speckle + 0.12f * cloud + 0.15f * scuff);
    const auto line = [&](float distance, float width) {
      const float soft = std::max(point.footprint_m, 5e-4f);
      return SmoothStep(0.5f * width + soft, 0.5f * width - soft, std::abs(distance));
    };
    float tape = std::max(line(radius - 0.40f, 0.025f), line(radius - 0.75f, 0.012f));
    if (radius < 0.55f) tape = std::max({tape, line(p.x(), 0.008f), line(p.y(), 0.008f)});
    const float sector = static_cast<float>(columns_) * std::atan2(p.y(), p.x()) / 6.2831853f;
    const float off_tick = (sector - std::round(sector)) * 6.2831853f * radius / columns_;
    if (radius > 0.62f && radius < 0.75f) tape = std::max(tape, line(off_tick, 0.010f));
    return colour + tape * (Vector3f(0.36f, 0.33f, 0.10f) - colour);
  }

 private:
  int columns_;
  uint32_t noise_;
};

/// A dark curtain in folds.
class CurtainPaint : public Paint {
 public:
  explicit CurtainPaint(uint32_t noise) : noise_(noise) {}
  bool Detailed() const override { return false; }
  Vector3f Albedo(const SurfacePoint& point) const override {
    const Vector3f& p = point.position;
    const float along = std::atan2(p.y(), p.x()) * kRoomRadius_m;
    const float folds = FractalNoise({p.x() * 6, p.y() * 6, p.z() * 0.4f}, 2, noise_);
    const float cloth = FractalNoise({p.x() * 40, p.y() * 40, p.z() * 30}, 2, noise_ + 3);
    const float seam = along / 1.4f - std::floor(along / 1.4f);
    const float dark = seam < 0.006f ? 0.5f : 1.0f;
    return Vector3f(0.050f, 0.053f, 0.060f) * dark * (1.0f + 0.35f * folds + 0.06f * cloth);
  }

 private:
  uint32_t noise_;
};

/// Anodised profiles and black camera housings with a label.
class HardwarePaint : public Paint {
 public:
  explicit HardwarePaint(uint32_t noise) : noise_(noise) {}
  bool Detailed() const override { return false; }
  Vector3f Albedo(const SurfacePoint& point) const override {
    const Vector3f& p = point.position;
    const float grain = ValueNoise(p * 90, noise_);
    if (point.material == 0) return Vector3f(0.22f, 0.22f, 0.23f) * (1.0f + 0.08f * grain);
    const Spot label = NearestSpot(p * 18, noise_ + 2);
    const bool bright = label.random < 0.35f && label.distance < 0.22f;
    return Vector3f::Constant(bright ? 0.30f : 0.035f) * (1.0f + 0.2f * grain);
  }

 private:
  uint32_t noise_;
};

/// A disc in z = 0, finer towards the middle, where the subject's shadow falls.
Mesh MakeFloor() {
  constexpr int kRings = 48, kSides = 96;
  Mesh mesh;
  for (int ring = 0; ring <= kRings; ++ring) {
    const float t = static_cast<float>(ring) / kRings;
    const float radius = kRoomRadius_m * (0.25f * t + 0.75f * t * t * t) + (ring == 0 ? 1e-3f : 0);
    for (int side = 0; side < kSides; ++side) {
      const float angle = 6.2831853f * static_cast<float>(side) / kSides;
      mesh.vertices.emplace_back(radius * std::cos(angle), radius * std::sin(angle), 0.0f);
      mesh.normals.push_back(Vector3f::UnitZ());
    }
  }
  for (int ring = 0; ring < kRings; ++ring) {
    for (int side = 0; side < kSides; ++side) {
      const auto at = [&](int r, int s) { return static_cast<uint32_t>(r * kSides + s % kSides); };
      mesh.triangles.push_back({at(ring, side), at(ring + 1, side), at(ring + 1, side + 1)});
      mesh.triangles.push_back({at(ring, side), at(ring + 1, side + 1), at(ring, side + 1)});
    }
  }
  return mesh;
}

Mesh MakeHardware(const RigGeometry& rig) {
  Mesh mesh;
  const auto add = [&](Mesh part, uint8_t material) {
    part.materials.assign(part.triangles.size(), material);
    AppendMesh(part, &mesh);
  };
  const float radius = 1e-3f * static_cast<float>(rig.radius_mm);
  for (int column = 0; column < rig.columns; ++column) {
    const float angle = 6.2831853f * static_cast<float>(column) / static_cast<float>(rig.columns);
    const Vector3f outward(std::cos(angle), std::sin(angle), 0);
    const Vector3f foot = (radius + kPoleBehind_m) * outward;
    CylinderShape pole;
    pole.centre = foot.head<2>();
    pole.radius = kPoleRadius_m;
    pole.top = 1e-3f * static_cast<float>(rig.highest_mm) + 0.2f;
    pole.sides = 16;
    add(MakeCylinder(pole), 0);
    Eigen::Matrix3f axes;
    axes << outward, Vector3f::UnitZ().cross(outward), Vector3f::UnitZ();
    for (int row = 0; row < rig.rows; ++row) {
      const double up = rig.rows > 1 ? static_cast<double>(row) / (rig.rows - 1) : 0.5;
      const float z =
          1e-3f * static_cast<float>(rig.lowest_mm + (rig.highest_mm - rig.lowest_mm) * up);
      const Vector3f lens = radius * outward + z * Vector3f::UnitZ();
      add(MakeBox(lens + 0.055f * outward, axes, {0.03f, 0.0225f, 0.0225f}), 1);
      add(MakeBox(lens + 0.01f * outward, axes, {0.02f, 0.016f, 0.016f}), 1);
    }
  }
  return mesh;
}

void Add(Mesh mesh, std::unique_ptr<Paint> paint, World* world) {
  WorldObject object;
  object.mesh = std::move(mesh);
  object.paint = std::move(paint);
  object.casts_shadow = false;
  world->objects.push_back(std::move(object));
}

}  // namespace

void AddStudio(const RigGeometry& rig, uint64_t seed, World* world) {
  const uint32_t noise = static_cast<uint32_t>(Hash64(seed));
  Add(MakeFloor(), std::make_unique<FloorPaint>(rig, noise), world);
  CylinderShape curtain;
  curtain.radius = kRoomRadius_m;
  curtain.top = kRoomHeight_m;
  curtain.sides = 180;
  curtain.rings = 12;
  curtain.inward = true;
  Add(MakeCylinder(curtain), std::make_unique<CurtainPaint>(noise + 20), world);
  Add(MakeHardware(rig), std::make_unique<HardwarePaint>(noise + 40), world);
}

}  // namespace rotunda::sim
