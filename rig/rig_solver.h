#pragma once

#include <Eigen/Core>
#include <vector>

#include "rig/rig_model.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"

namespace rotunda::rig {

/// What the pictures are compared with.
struct RigProblem {
  const Board& board;
  const BoardShape& shape;
  const std::vector<FacePrior>& priors;  // by face
};

/// Which unknowns move. Faces that their prior holds (sigma 0) and what nothing is seen of never
/// do.
struct FreeUnknowns {
  bool cameras = true;      // their poses
  bool intrinsics = true;   // all parameters, or
  bool focal_only = false;  // with `intrinsics`: focal length and first radial coefficient alone
  bool rational = true;     // with `intrinsics`: also k4 to k6 of FULL_OPENCV
  bool shots = true;        // with `cameras` all but the first, which is the rig frame meanwhile
  bool faces = true;        // poses and bows
};

/// Whether a parameter of the intrinsics moves.
bool IsFreeParam(const FreeUnknowns& free, CameraModel model, size_t param);

struct RigSolveOptions {
  FreeUnknowns free;
  /// Scale of the Cauchy loss, in units of SeenCorner::sigma_px; 0: least squares.
  double loss_scale = 0;
  int max_iterations = 50;
  /// Ends when a step lowers the cost by a smaller share than this.
  double function_tolerance = 1e-9;
};

struct RigSolveReport {
  bool converged = false;
  int iterations = 0;
  double initial_cost = 0;  // half the sum of squares (of the loss), priors included
  double final_cost = 0;
};

/// Unknowns of one camera: turn (left tangent of cam_from_rig, camera axes, rad), centre (rig
/// frame, m), then the intrinsics' parameters. Of one shot: turn (left tangent of rig_from_board),
/// origin of the board. Of one face: turn (left tangent of board_from_face), its middle in the
/// board's frame, bow. All shots come before all faces.
inline constexpr Eigen::Index kPoseSize = 6;
inline constexpr Eigen::Index kFaceSize = 8;

/// Normal equations J^T J dx = -J^T r, cameras apart from what they share:
///   [camera[i]   coupling[i]] [d camera i]    [camera_gradient[i]]
///   [     sym.        shared] [  d shared] = -[   shared_gradient]
/// Held unknowns have 1 on the diagonal and 0 elsewhere.
struct NormalEquations {
  std::vector<Eigen::MatrixXd> camera;
  std::vector<Eigen::MatrixXd> coupling;
  std::vector<Eigen::VectorXd> camera_gradient;
  Eigen::MatrixXd shared;
  Eigen::VectorXd shared_gradient;
  std::vector<Eigen::Array<bool, Eigen::Dynamic, 1>> camera_free;
  Eigen::Array<bool, Eigen::Dynamic, 1> shared_free;
};
NormalEquations BuildNormal(const RigProblem& problem, const std::vector<FaceView>& views,
                            const RigModel& model, const RigSolveOptions& options,
                            RunContext& context);

/// Levenberg-Marquardt on the reprojection errors of `views` (those whose camera and shot have a
/// pose) over their sigma_px, the faces' priors and weak priors on the intrinsics that only a
/// camera with too few corners feels. Cameras are eliminated one by one (Schur complement onto
/// shots and faces). `model` keeps the best state; kFailed when the equations cannot be solved,
/// kCancelled when stopped.
Result<RigSolveReport> SolveRig(const RigProblem& problem, const std::vector<FaceView>& views,
                                const RigSolveOptions& options, RigModel& model,
                                RunContext& context);

}  // namespace rotunda::rig
