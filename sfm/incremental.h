#pragma once

#include <vector>

#include "sfm/bundle_adjustment.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"
#include "sfm/features.h"
#include "sfm/intrinsics.h"
#include "sfm/reconstruction.h"
#include "sfm/tracks.h"
#include "sfm/two_view.h"
#include "sfm/view_graph.h"

namespace rotunda::sfm {

/// What incremental reconstruction starts from; borrowed, never changed.
struct IncrementalInput {
  const Features& features;
  const Intrinsics& intrinsics;
  const TwoViews& two_views;
  const ViewGraph& view_graph;
  const Tracks& tracks;
};

struct IncrementalOptions {
  bool refine_intrinsics = false;
  double min_initial_angle_rad =
      RadFromDeg(16.0);              // relaxed by halves down to a quarter when no pair has it
  size_t min_initial_inliers = 100;  // likewise down to 30
  double max_reprojection_px = 4.0;
  double min_triangulation_angle_rad = RadFromDeg(1.5);
  double max_pnp_error_px = 12.0;
  size_t min_pnp_inliers = 30;  // relaxed to 15 when nothing else can be registered
  double min_pnp_inlier_ratio = 0.25;
  double global_ba_growth = 1.1;  // global BA when images or points grew by this factor
  size_t local_ba_images = 6;
  size_t min_model_images = 3;  // at least 3: fewer have no similarity fit, hence no covariance
  size_t max_models = 20;
  /// All tracks are triangulated in the end, but nothing is adjusted any more: poses good enough to
  /// judge the matches by.
  bool draft = false;
  Status Validate() const;
};

/// Whether the lenses of a model of so many images are refined: when that is asked for and the
/// images are enough to determine them. The last adjustment of a finished model went by this, so
/// it is what BuildPoseCovariances has to be told of it.
bool RefinesIntrinsics(size_t registered_images, const IncrementalOptions& options);

struct UnregisteredImage {
  ImageId image;
  std::string reason;
};

struct IncrementalResult {
  std::vector<Reconstruction>
      models;  // most images first, ties by most points; no image is in two models
  std::vector<UnregisteredImage> unregistered;  // in no model, with the reason
};

/// Incremental structure from motion (Schoenberger & Frahm, CVPR 2016): initial pair, next image by
/// P3P + LO-RANSAC + refinement, triangulation, local and global bundle adjustment, filtering,
/// retriangulation. An image that too few observations hold in the end is taken out again. What is
/// left over starts a model of its own. kFailed when no pair initialises: the message says what the
/// best pair lacked.
Result<IncrementalResult> BuildReconstructions(const IncrementalInput& input,
                                               const IncrementalOptions& options,
                                               RunContext& context);

/// Puts models that could not be joined behind those of the result, without the images that it has
/// already; what is smaller then is left out. Their images are no longer listed as unregistered.
void AppendModels(std::vector<Reconstruction> others, size_t min_images, IncrementalResult& result);

/// One model taken further: its poses (and lenses) are kept as a start, everything is triangulated
/// from the input's tracks, images that fit are added and all is adjusted to the end. Images that
/// stay out or are taken out are listed with the reason. kFailed when too few images are left.
Result<IncrementalResult> ExtendReconstruction(const IncrementalInput& input,
                                               const Reconstruction& start,
                                               const IncrementalOptions& options,
                                               RunContext& context);

}  // namespace rotunda::sfm
