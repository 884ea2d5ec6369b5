#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "sfm/core/pose_set.h"
#include "sfm/core/result.h"
#include "sfm/reconstruction.h"

namespace rotunda::sfm {

/// Covariance of one pose: rotation (left tangent of cam_from_model, radians, camera axes), then
/// camera centre (model frame and unit).
using PoseCovariance = Eigen::Matrix<double, 6, 6>;

struct PoseCovariances {
  std::vector<std::optional<PoseCovariance>> images;  // by ImageId; nullopt: not registered
  std::vector<std::optional<double>> focal_sigma_px;  // by lens; nullopt: not refined or not used
  double sigma0 = 0;  // root of (weighted squared residuals / redundancy): residuals in units of
                      // KeypointSigma_px
};

/// From the normal equations S of the final adjustment over all poses (and lenses when refined),
/// points eliminated, with the gauge fixed to the Sim(3) fit of the camera centres: the covariance
/// of what is left after that fit (inner constraints; Triggs et al. 2000, section 9). What the
/// errors of one point have in common in all its images (a blob on a curved surface, a highlight, a
/// wrong match) counts as such: S^-1 (sum over points of g g^T) S^-1 with the gradient g of each
/// point's squared residuals (White, Econometrica 1982; clusters: Liang & Zeger, Biometrika 1986),
/// these cut off at three sigma0, as the adjustment's loss makes little of more. On rendered bodies
/// the variance of what all cameras have in common was so three to four times that of independent
/// errors. Times what the errors of neighbouring keypoints of a picture have in common.
/// `intrinsics_refined`: whether the last adjustment moved the lenses (RefinesIntrinsics for a
/// model of BuildReconstructions).
Result<PoseCovariances> BuildPoseCovariances(const Reconstruction& reconstruction,
                                             const Features& features, bool intrinsics_refined,
                                             RunContext& context);

/// Roots of the traces; position in 1/1000 model units (millimetres once the model is metric).
PoseSigma SigmaOf(const PoseCovariance& covariance);

}  // namespace rotunda::sfm
