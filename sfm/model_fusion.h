#pragma once

#include <vector>

#include "sfm/model_links.h"

namespace rotunda::sfm {

/// Two models in one frame, all links between them, and which of these the common frame fulfils.
struct FusionInput {
  const Features& features;
  const Reconstruction& source;
  const Reconstruction& target;
  const std::vector<ModelLink>& links;
  const std::vector<bool>& agrees;
};

/// One model of both.
/// - A camera of both keeps the pose with the smaller standard error, rms / sqrt(observations);
///   where the two poses contradict each other the other model loses its observations in it.
/// - A lens is taken from the model that sees more through it.
/// - Points of one track (a shared keypoint, or keypoints matched across an agreeing pair) whose
///   projections lie within `max_duplicate_px` in the median picture become one.
/// - A keypoint that still has two points stays with the one that more observations agree with, to
///   within `max_duplicate_px`; points that lose all but one observation go.
Reconstruction FuseModels(const FusionInput& input, double max_duplicate_px);

}  // namespace rotunda::sfm
