#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "daemon/store_records.h"
#include "sfm/core/calibration.h"
#include "sfm/core/pose_set.h"

namespace rotunda::daemon {

/// Whether a sure verdict of the result is evidence of where the rig's cameras stand. Not with a
/// prior: the calibration has helped to place them. Not with another preset than rig: a fold that
/// no match contradicts is then not seen. A result that names no preset is of a method without one.
bool SpeaksOfTheRig(const PoseSet& poses);

/// Whether the result may speak of drift: it speaks of the rig, is metric, not folded, and was
/// compared with a calibration, its pictures alone are sure, and most cameras are in place: fewer
/// than half are far off or beyond their uncertainties.
bool MaySpeakOfDrift(const PoseSet& poses);

/// Every registered camera's drift; sorted by camera. A camera is beyond its limit when the
/// reconstruction calls its change significant (VsCalibration::moved) and it is more than a limit,
/// when it is far off, or when it has changed places with another. `capture`, `captured_at` and
/// `reconstruction` are left to the caller. Empty when the result may not speak of drift.
std::vector<DriftRecord> DriftOf(const PoseSet& poses, const Calibration& calibration,
                                 const DriftLimits& limits);

/// Calibrated cameras of the set that the result has no pose of, with the reason; sorted by camera.
/// What is left to the caller and when it is empty: as with DriftOf().
std::vector<UnregisteredRecord> UnregisteredOf(const PoseSet& poses,
                                               const Calibration& calibration);

}  // namespace rotunda::daemon
