#pragma once

#include <vector>

#include "sfm/core/result.h"
#include "sfm/core/run_context.h"
#include "sfm/reconstruction.h"

namespace rotunda::sfm {

enum class Loss { kNone, kSoftL1, kCauchy };

struct BundleAdjustmentOptions {
  bool refine_intrinsics = false;  // focal length and distortion; never the principal point
  Loss loss = Loss::kNone;
  double loss_scale = 2.0;  // in units of the weighted residual, i.e. of KeypointSigma_px
  int max_iterations = 100;
  double function_tolerance = 1e-6;
  Status Validate() const;
};

struct BundleAdjustmentReport {
  bool converged = false;
  int iterations = 0;
  double initial_cost = 0;
  double final_cost = 0;
};

/// Minimises the reprojection error over the poses of `free_images`, the points they see and, if
/// asked for, their lenses. An observation's residual is divided by KeypointSigma_px, so the cost
/// is in units of that. Poses of other images stay; when fewer than two of them see
/// the points, the gauge is fixed on the first of them (pose) and the farthest free one from it
/// (distance along the line between them). Points with fewer than two registered observations are
/// left alone. Focal lengths stay within 0.3 and 5 times the larger side. Fixed lenses of up to 150
/// images: bundle_schur, else Ceres. The same bytes on any number of threads. kFailed: the solver
/// gave up; kCancelled: stopped, within an iteration. The reconstruction is as it was then.
Result<BundleAdjustmentReport> AdjustBundle(Reconstruction& reconstruction,
                                            const Features& features,
                                            const std::vector<ImageId>& free_images,
                                            const BundleAdjustmentOptions& options,
                                            RunContext& context);

/// What a keypoint's residuals are divided by: its noise, as SIFT localises a blob the worse the
/// larger it is, and what large ones err by all alike.
double KeypointSigma_px(const Keypoint& keypoint);

}  // namespace rotunda::sfm
