#pragma once

#include <optional>
#include <vector>

#include "sfm/core/calibration.h"
#include "sfm/core/frame_set.h"
#include "sfm/core/pose_set.h"
#include "sfm/core/result.h"
#include "sfm/covariance.h"
#include "sfm/reconstruction.h"

namespace rotunda::sfm {

/// A reconstruction brought into the rig frame, metric.
struct RigAlignment {
  Sim3 rig_from_model;
  std::vector<std::optional<VsCalibration>> vs_calibration;  // by ImageId; nullopt: not registered
  /// A camera farther than this from its place was not pushed there: it was mounted elsewhere, or
  /// the model is folded.
  double far_mm = 0;
};

/// A camera has moved when it is off by more than this many of its sigmas.
inline constexpr double kMovedSigmas = 6.0;

/// Sim(3) of the camera centres onto the calibration's, robust so that moved cameras stand out. A
/// camera has moved when its centre or its rotation is off by more than kMovedSigmas robust
/// standard deviations of all cameras (and of its own predicted error with the calibration's).
/// Moved cameras that stand in one another's calibrated places, two or more in a ring, are swapped
/// instead. Whether the model is folded is not judged here. kFailed with fewer than three
/// registered cameras or all of them on one line.
Result<RigAlignment> AlignToCalibration(const Reconstruction& reconstruction, const FrameSet& set,
                                        const Calibration& calibration,
                                        const PoseCovariances& covariances, uint64_t seed);

/// The covariances in the target frame: centres turn and scale with it, rotations (in camera axes)
/// stay.
PoseCovariances Transformed(const PoseCovariances& covariances, const Sim3& target_from_model);

}  // namespace rotunda::sfm
