#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "rig/sim/mesh.h"

namespace rotunda::sim {

/// Where a ray met a surface.
struct SurfacePoint {
  Eigen::Vector3f position;  // rig frame
  Eigen::Vector3f normal;    // unit
  Eigen::Vector2f uv;        // of the mesh, (0, 0) when it has none
  uint8_t material = 0;
  float footprint_m = 0;  // size of a sample on the surface
  /// Size of a sample along u and v, where it is known better than by the footprint; else (0, 0).
  Eigen::Vector2f uv_footprint = Eigen::Vector2f::Zero();
};

/// Colour of a surface.
class Paint {
 public:
  virtual ~Paint() = default;
  /// Linear diffuse reflectance, 0..1, averaged over about the footprint.
  virtual Eigen::Vector3f Albedo(const SurfacePoint& point) const = 0;
  /// Whether a pixel needs several samples: detail finer than a few pixels.
  virtual bool Detailed() const { return true; }
  /// Strength of the mild highlight (0: matt).
  virtual float Gloss(const SurfacePoint&) const { return 0; }
};

struct WorldObject {
  Mesh mesh;
  std::unique_ptr<Paint> paint;
  bool casts_shadow = true;
  std::vector<float> light;  // irradiance / pi at each vertex, by BakeLight
};

struct World {
  std::vector<WorldObject> objects;
};

}  // namespace rotunda::sim
