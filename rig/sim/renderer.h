#pragma once

#include <Eigen/Core>
#include <vector>

#include "rig/sim/ray_scene.h"
#include "rig/sim/world.h"
#include "sfm/core/calibration.h"

namespace rotunda::sim {

/// Linear light, RGB, rows from the top.
struct LightImage {
  int width = 0;
  int height = 0;
  std::vector<Eigen::Vector3f> pixels;

  Eigen::Vector3f& at(int x, int y) { return pixels[static_cast<size_t>(y) * width + x]; }
  const Eigen::Vector3f& at(int x, int y) const {
    return pixels[static_cast<size_t>(y) * width + x];
  }
};

/// What a camera's lens forms: each pixel the mean over its square (4 samples on smooth surface, 16
/// where surfaces meet). The world must have been lit (BakeLight); `scene` holds all of it.
/// `backdrop` is what rays see that meet nothing.
LightImage RenderLight(const World& world, const RayScene& scene, const CalibratedCamera& camera,
                       const Eigen::Vector3f& backdrop);

}  // namespace rotunda::sim
