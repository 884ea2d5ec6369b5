#pragma once

#include "sfm/core/run_context.h"
#include "sfm/features.h"
#include "sfm/reconstruction.h"
#include "sfm/two_view.h"

namespace rotunda::sfm {

struct AgreeingMatchesOptions {
  double max_error_px = 4.0;  // Sampson distance
  size_t min_matches = 15;    // fewer: the pair is left out
  double min_share = 0.5;     // of the pair's matches; fewer: likewise
};

/// The pairs with both images in the model, with the model's relative pose (|translation| = 1) and
/// those of their matches that agree with it; pairs of which most matches disagree are left out, be
/// it that they join what looks alike or that the model is wrong. Panoramic pairs and pairs with an
/// image outside the model are left out, too.
TwoViews AgreeingMatches(const Reconstruction& model, const Features& features,
                         const TwoViews& two_views, const AgreeingMatchesOptions& options,
                         RunContext& context);

}  // namespace rotunda::sfm
