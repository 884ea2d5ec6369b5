#pragma once

#include <cstdint>

#include "sfm/core/calibration.h"

namespace rotunda::sim {

/// What a good calibration of a simulated rig would have found: the intrinsics as they are, every
/// pose off by independent noise of 0.005 deg and 0.15 mm (root of the trace over the axes), with
/// that as its sigma. So a reconstruction is given known intrinsics, a rig frame and a scale, but
/// never the true poses.
Calibration DrawCalibration(const Calibration& truth, uint64_t seed);

}  // namespace rotunda::sim
