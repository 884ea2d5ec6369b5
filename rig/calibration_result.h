#pragma once

#include <string>

#include "rig/cross_validation.h"
#include "rig/rig_calibration.h"
#include "sfm/core/calibration.h"

namespace rotunda::rig {

/// What calibration.json holds: calibrated cameras with sigma, covariance and fit, the target, the
/// residuals. `id` and `created_at` are the caller's.
Calibration ToCalibration(const Board& board, const BoardSightings& sightings,
                          const RigCalibration& result, const CrossValidation* validation);

}  // namespace rotunda::rig
