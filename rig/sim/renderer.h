#pragma once

#include <Eigen/Core>
#include <vector>

#include "rig/sim/ray_scene.h"
#include "rig/sim/world.h"
#include "sfm/core/calibration.h"

namespace rotunda::sim {

/// Of a pixel, along each side. Lens and sensor spread them over pixels (sensor.h): were they means
/// over whole pixels, the lens's blur would know edges only to the pixel, and corners found by it
/// would be drawn towards the pixels' grid.
inline constexpr int kLightSamples = 2;

/// Linear light before the lens blurs it, RGB, rows from the top, kLightSamples^2 samples a pixel.
struct LightImage {
  int width = 0;  // of the picture; samples are kLightSamples times as many
  int height = 0;
  std::vector<Eigen::Vector3f> samples;

  Eigen::Vector3f& at(int x, int y) { return samples[Place(x, y)]; }
  const Eigen::Vector3f& at(int x, int y) const { return samples[Place(x, y)]; }

 private:
  size_t Place(int x, int y) const {
    return static_cast<size_t>(y) * kLightSamples * width + static_cast<size_t>(x);
  }
};

/// What a camera sees: a sample of the paint in each part of a pixel on smooth surface, 4 rays
/// where surfaces meet. The world must have been lit (BakeLight); `scene` holds all of it.
/// `backdrop` is what rays see that meet nothing.
LightImage RenderLight(const World& world, const RayScene& scene, const CalibratedCamera& camera,
                       const Eigen::Vector3f& backdrop);

}  // namespace rotunda::sim
