#pragma once

#include "sfm/core/calibration.h"
#include "sfm/core/frame_set.h"
#include "sfm/core/pose_set.h"
#include "sfm/covariance.h"
#include "sfm/features.h"
#include "sfm/incremental.h"
#include "sfm/intrinsics.h"
#include "sfm/reconstruction.h"
#include "sfm/rig_alignment.h"
#include "sfm/segments.h"
#include "sfm/tc_sfm.h"

namespace rotunda::sfm {

/// Poses and summary of the largest model; what is measured against the calibration and what is
/// told of look-alikes comes later.
PoseSet DescribePoses(const FrameSet& set, const IncrementalResult& models,
                      const Reconstruction& reconstruction, const Features& features);

/// Only for calibrated lenses: a principal point that is merely taken to be in the middle puts
/// errors into the poses that the covariance does not see.
void AddSigmas(const PoseCovariances& covariances, const Intrinsics& intrinsics, PoseSet& poses);

/// Sides of the cameras and how far they are from the calibration; the poses are in its frame. When
/// three cameras or more are both turned and far away and the pictures were not sure, the verdict
/// becomes "folded"; any camera that is one of the two makes "sure", or no verdict, "unsure". Comes
/// after AddVerdict.
void AddCalibrationFigures(const RigAlignment& alignment, const Calibration& calibration,
                           PoseSet& poses);

/// Verdict, margin and folded check.
void AddVerdict(const TcSfmResult& result, PoseSet& poses);

/// What was found of every registered camera where parts of the subject look alike.
void AddEvidence(const TcSfmResult& result, PoseSet& poses);

/// Sides of the cameras of a model without a calibration: `front` is in the middle of the front,
/// the others follow by their azimuth around the subject, counter-clockwise seen from above (from
/// where the cameras' pictures have their upper edge). False, and no side: `front` is not
/// registered, or the cameras do not stand upright around anything.
bool AddSides(const Reconstruction& model, ImageId front, PoseSet& poses);

/// Segments with the cameras that are related to them and their look-alikes; the side of a segment
/// is that of most of its cameras. Segments that no camera is related to are left out.
void AddSegments(const Segments& segments, PoseSet& poses);

}  // namespace rotunda::sfm
