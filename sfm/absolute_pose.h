#pragma once

#include <Eigen/Core>
#include <vector>

#include "sfm/core/result.h"
#include "sfm/core/rigid3.h"

namespace rotunda::sfm {

/// Points of the model and where a camera sees them: `normalized[i]` is x/z, y/z without
/// distortion (for the assumed focal length) of `points[i]`.
struct AbsolutePoseInput {
  std::vector<Eigen::Vector2d> normalized;
  std::vector<Eigen::Vector3d> points;  // model frame
  double focal_px = 0;                  // turns normalised distances into pixels
};

struct AbsolutePoseOptions {
  double max_error_px = 12.0;
  double confidence = 0.9999;
  int max_iterations = 10000;
  double min_inlier_ratio = 0.1;
  uint64_t seed = 0;
  /// Focal lengths to try, as factors of the assumed one; when there is more than one the factor
  /// is refined together with the pose.
  std::vector<double> focal_factors = {1.0};
};

struct AbsolutePose {
  Rigid3 cam_from_model;
  double focal_factor = 1.0;  // true over assumed focal length
  std::vector<size_t> inliers;
};

/// Pose of a camera from points: LO-RANSAC over P3P, local optimisation and final refinement by
/// Levenberg-Marquardt on the reprojection error of the inliers. kFailed: no pose.
Result<AbsolutePose> EstimateAbsolutePose(const AbsolutePoseInput& input,
                                          const AbsolutePoseOptions& options);

/// Minimises the sum over `inliers` of rho(reprojection error), rho = Cauchy at `scale_px`, from
/// `start`; with `refine_focal` over the focal factor too. Points behind the camera are left out.
AbsolutePose RefineAbsolutePose(const AbsolutePoseInput& input, const AbsolutePose& start,
                                double scale_px, bool refine_focal);

}  // namespace rotunda::sfm
