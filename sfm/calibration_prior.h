#pragma once

#include <optional>
#include <vector>

#include "sfm/core/ids.h"
#include "sfm/core/result.h"
#include "sfm/core/rigid3.h"
#include "sfm/two_view.h"
#include "sfm/view_graph.h"

namespace rotunda::sfm {

/// cam_from_rig of the calibration by ImageId; nullopt: the camera is not calibrated. Empty: the
/// calibration is no prior.
using CalibratedPoses = std::vector<std::optional<Rigid3>>;

struct CalibrationPriorOptions {
  /// Relative rotations farther than this off the calibrated ones contradict it. An image on the
  /// look-alike side is off by more, a camera that was pushed by less.
  double max_rotation_rad = RadFromDeg(10.0);
  /// Of the weight of an image's edges: when less agrees with the calibration, its camera has been
  /// moved or swapped since, and the prior says nothing of it. (Where everything looks alike and
  /// all crossed matches are found it is 0.31 to 0.43, of a swapped camera about 0.)
  double min_agreeing_share = 0.05;
  Status Validate() const;
};

/// What the calibration says of a view graph.
struct CalibrationPrior {
  std::vector<bool> refuted;          // parallel to the edges: joins what looks alike
  std::vector<bool> placed;           // by ImageId: has edges that its calibrated pose has judged
  std::vector<ImageId> contradicted;  // calibrated, but the image's edges are against it
};

/// The edges whose relative rotation contradicts that of the calibrated poses (TC-SfM's ambiguous
/// pairs, decided by knowledge of the rig instead of the pictures). kBadInput when the calibration
/// contradicts half of its images or more: it is another rig's.
Result<CalibrationPrior> BuildCalibrationPrior(const ViewGraph& graph, const TwoViews& two_views,
                                               const CalibratedPoses& calibrated,
                                               const CalibrationPriorOptions& options);

}  // namespace rotunda::sfm
