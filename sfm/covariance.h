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
  double sigma0 = 0;  // root of (weighted squared residuals / redundancy): keypoint noise in units
                      // of KeypointSigma_px
};

/// From the Schur complement of the final normal equations over all poses (and lenses when
/// refined), with the gauge fixed to the Sim(3) fit of the camera centres: the covariance of what
/// is left after that fit (inner constraints; Triggs et al. 2000, section 9). Scaled by sigma0^2
/// and by what the errors of neighbouring keypoints have in common.
/// `intrinsics_refined`: whether the last adjustment moved the lenses (RefinesIntrinsics for a
/// model of BuildReconstructions).
Result<PoseCovariances> BuildPoseCovariances(const Reconstruction& reconstruction,
                                             const Features& features, bool intrinsics_refined,
                                             RunContext& context);

/// Roots of the traces; position in 1/1000 model units (millimetres once the model is metric).
PoseSigma SigmaOf(const PoseCovariance& covariance);

}  // namespace rotunda::sfm
