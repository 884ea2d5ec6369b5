#pragma once

#include <optional>
#include <vector>

#include "sfm/core/ids.h"
#include "sfm/core/rigid3.h"
#include "sfm/core/run_context.h"
#include "sfm/covisibility.h"
#include "sfm/features.h"
#include "sfm/reconstruction.h"
#include "sfm/two_view.h"
#include "sfm/view_graph.h"

namespace rotunda::sfm {

/// Where the matches that contradict a model would put an image.
struct AlternativePose {
  ImageId image;
  Rigid3 cam_from_model;
  double rotation_rad = 0;  // off the model's own pose
  /// Log-likelihoods (natural) by which what the image misses there exceeds what it misses where
  /// the model has it, and the reverse. Each by the count that is the harder to satisfy. Against it
  /// speaks what the image meets nowhere in its picture. For it speaks what is met where the
  /// alternative has it (a pose that merely looks at the same things from aside meets them
  /// elsewhere), and no more than all that is met there (one that should meet nothing misses
  /// nothing).
  double evidence_against = 0;
  double evidence_for = 0;
};

struct Alternatives {
  std::vector<AlternativePose> poses;  // sorted by image
  /// Log-likelihood (natural) by which what the images should meet there, and do not, although it
  /// is met where the model has them, speaks against the alternatives, all together: look-alike
  /// structure is one decision, not many.
  double evidence_against = 0;
};

struct AlternativeOptions {
  size_t min_inliers = 30;
  double min_rotation_rad = RadFromDeg(10.0);  // off the model's own pose
  double max_error_px = 12.0;  // of a match that supports the pose, and of what it meets in place
};

/// The poses that verified matches between images of the model support although the model's own
/// poses contradict them (P3P on the points those matches lead to), and what speaks against them.
/// Empty: nothing looks alike. Many with no evidence against: the model may be folded, or the one
/// that is right, and nothing tells. `agreeing`: the pairs that the model was made of.
Alternatives FindAlternatives(const Reconstruction& model, const Features& features,
                              const TwoViews& two_views, const TwoViews& agreeing,
                              const CovisibilityOptions& covisibility,
                              const AlternativeOptions& options, RunContext& context);

}  // namespace rotunda::sfm
