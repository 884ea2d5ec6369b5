#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <span>

#include "rig/sim/world.h"
#include "sfm/core/result.h"

namespace rotunda::sim {

struct RayHit {
  uint32_t object = UINT32_MAX;  // UINT32_MAX: nothing was hit
  uint32_t triangle = 0;
  float distance = 0;  // in lengths of the direction
  float u = 0, v = 0;  // weights of the triangle's second and third corner
};

/// Rays in groups of eight: what Embree traces at once.
inline constexpr size_t kRayPacket = 8;

/// Triangles of a world behind Embree. The world must outlive the scene.
class RayScene {
 public:
  /// `shadow_casters_only`: without the objects that cast no shadow. kFailed when Embree does not
  /// start or has no memory.
  static Result<RayScene> Build(const World& world, bool shadow_casters_only);
  ~RayScene();
  RayScene(RayScene&&) noexcept;
  RayScene& operator=(RayScene&&) noexcept;

  /// First hits of kRayPacket rays from one origin beyond `near` direction lengths.
  void Trace(const Eigen::Vector3f& origin, float near, std::span<const Eigen::Vector3f> directions,
             std::span<RayHit> hits) const;
  /// Whether anything lies along each of kRayPacket directions.
  void Occluded(const Eigen::Vector3f& origin, std::span<const Eigen::Vector3f> directions,
                std::span<bool> occluded) const;

 private:
  struct Impl;
  explicit RayScene(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace rotunda::sim
