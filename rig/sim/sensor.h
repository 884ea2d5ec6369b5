#pragma once

#include <cstdint>

#include "rig/sim/renderer.h"
#include "rig/sim/rig_options.h"
#include "rig/sim/texture.h"

namespace rotunda::sim {

/// What lens and sensor make of the light: a spot of blur_px gathered over each pixel's whole
/// square, vignetting, this camera's gain and white balance, shot and read noise, the sRGB curve, 8
/// bits. `seed` is the camera's; `shot` tells the noise of its pictures apart.
Picture Expose(const LightImage& light, const RigSensor& sensor, uint64_t seed, uint64_t shot);

}  // namespace rotunda::sim
