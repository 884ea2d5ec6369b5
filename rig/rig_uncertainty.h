#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "rig/rig_solver.h"

namespace rotunda::rig {

/// How well the pictures determine a camera.
struct CameraUncertainty {
  /// Of its unknowns (kPoseSize and the intrinsics' parameters, as in NormalEquations). Held
  /// intrinsics have the covariance they were given (AdjustedUnknowns::held_intrinsics), with
  /// its effect on the pose; without one, and for all else that is held, rows and columns are 0.
  Eigen::MatrixXd covariance;
  PoseSigma sigma;
  /// One standard deviation of where a point of the rig frame appears, root of the sum over both
  /// axes: mean and largest over the picture, at the distance of the board.
  double projection_mean_px = 0;
  double projection_max_px = 0;
};

struct FaceUncertainty {
  double rotation_deg = 0;  // roots of the traces, as PoseSigma
  double position_mm = 0;   // of the face's middle
  double bow_mm = 0;
};

struct RigUncertainty {
  std::vector<std::optional<CameraUncertainty>> cameras;  // nullopt: no pose
  std::vector<std::optional<FaceUncertainty>> faces;      // nullopt: never seen
};

/// What was found, and what was held. `held_intrinsics`: covariance by camera of intrinsics that
/// were held but are not exact; empty: exact.
struct AdjustedUnknowns {
  FreeUnknowns free;
  const std::vector<Eigen::MatrixXd>& held_intrinsics;
};

/// Covariances from the normal equations at the solution of SolveRig without loss, the views'
/// sigma_px being the true noise. Gauge: cameras are given relative to the rigid fit of all camera
/// centres, the faces relative to the rigid fit of all faces' outer corners (inner constraints;
/// Triggs et al. 2000, section 9): what is left after one rigid motion is what a comparison with
/// truth or with another calibration sees. Held intrinsics that are not exact go into their
/// camera's poses (what they do to the shots, which many cameras see, is left out). kFailed when
/// something is not determined.
Result<RigUncertainty> BuildUncertainty(const RigProblem& problem,
                                        const std::vector<FaceView>& views, const RigModel& model,
                                        const AdjustedUnknowns& unknowns, RunContext& context);

/// Cameras whose unknowns their own corners leave open, all else being known.
std::vector<size_t> UndeterminedCameras(const RigProblem& problem,
                                        const std::vector<FaceView>& views, const RigModel& model,
                                        const FreeUnknowns& free, RunContext& context);

/// The views with every sigma_px times its camera's `noise`.
std::vector<FaceView> WithNoise(std::vector<FaceView> views, const std::vector<double>& noise);

/// Sum of squared errors in units of sigma_px, over the redundancy: the noise variance in units of
/// the detector's, at a least-squares solution.
double NoiseVariance(const RigProblem& problem, const std::vector<FaceView>& views,
                     const RigModel& model, const FreeUnknowns& free);

}  // namespace rotunda::rig
