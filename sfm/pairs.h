#pragma once

#include <vector>

#include "sfm/core/calibration.h"
#include "sfm/core/frame_set.h"
#include "sfm/core/ids.h"
#include "sfm/core/result.h"

namespace rotunda::sfm {

/// All pairs of `images` pictures, sorted.
std::vector<ImagePair> ExhaustivePairs(size_t images);

/// Pairs whose calibrated frusta overlap on a subject: of sample points in a person-sized cylinder
/// on the rig's axis at least one fifth of what the one camera sees is seen by the other as well,
/// from directions less than 60 degrees apart (beyond that SIFT does not match). Faster than all
/// pairs, but blind to swapped cables and moved cameras. kBadInput: the calibration lacks a camera
/// of the set.
Result<std::vector<ImagePair>> NeighbourPairs(const FrameSet& set, const Calibration& calibration);

}  // namespace rotunda::sfm
