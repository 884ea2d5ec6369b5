#pragma once

#include "sfm/core/run_context.h"
#include "sfm/features.h"
#include "sfm/intrinsics.h"
#include "sfm/two_view.h"

namespace rotunda::sfm {

/// Lenses of which only a guess is known, brought to the focal length the matches ask for.
struct SelfCalibration {
  Intrinsics intrinsics;
  TwoViews two_views;         // poses and angles anew for these lenses
  double focal_factor = 1.0;  // estimated over guessed focal length, one for all lenses
};

/// A common factor on all guessed focal lengths, searched for over a grid of 0.4 to 2.5: at the
/// true one, epipolar geometry with five degrees of freedom fits the matches of the pairs as well
/// as it ever does. Left at 1 when no factor fits clearly better than the guess, as in pairs that
/// do not determine it.
SelfCalibration EstimateFocalLengths(const Features& features, const Intrinsics& guessed,
                                     const TwoViews& two_views, RunContext& context);

}  // namespace rotunda::sfm
