#include "rig/rig_uncertainty.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "sfm/core/statistics.h"

namespace rotunda::rig {
namespace {

/// A camera whose (equilibrated) equations are worse conditioned than this is what makes those of
/// all cameras together unsolvable in double precision.
constexpr double kLeastCondition = 1e-11;

/// Inverse of a positive definite matrix, equilibrated: unknowns differ by orders of magnitude.
std::optional<Eigen::MatrixXd> Inverse(const Eigen::MatrixXd& matrix) {
  const Eigen::VectorXd scale = matrix.diagonal().cwiseSqrt().cwiseInverse();
  if (!scale.allFinite()) return std::nullopt;
  const Eigen::LLT<Eigen::MatrixXd> factor(scale.asDiagonal() * matrix * scale.asDiagonal());
  if (factor.info() != Eigen::Success) return std::nullopt;
  return Eigen::MatrixXd(scale.asDiagonal() *
                         factor.solve(Eigen::MatrixXd::Identity(matrix.rows(), matrix.cols())) *
                         scale.asDiagonal());
}

/// Zero where held, instead of the 1 that stands there while solving.
void ClearHeld(const Eigen::Array<bool, Eigen::Dynamic, 1>& free, Eigen::MatrixXd& matrix) {
  for (Eigen::Index i = 0; i < free.size(); ++i) {
    if (free(i)) continue;
    matrix.row(i).setZero();
    matrix.col(i).setZero();
  }
}

/// Covariance of cameras and shared unknowns in the gauge of the solver:
/// camera i: own[i] + reach[i] shared reach[i]^T; cameras i, j: reach[i] shared reach[j]^T.
struct SolverCovariance {
  std::vector<Eigen::MatrixXd> own;
  std::vector<Eigen::MatrixXd> reach;  // -U^-1 W
  Eigen::MatrixXd shared;
};

/// Adds to each camera what its held intrinsics' covariance does to its pose: with P and I the
/// pose's and the intrinsics' columns of the normal matrix, d pose = -(P^T P)^-1 P^T I d
/// intrinsics.
void AddHeldIntrinsics(const NormalEquations& all_free,
                       const std::vector<Eigen::MatrixXd>& held_intrinsics,
                       SolverCovariance& covariance) {
  for (size_t c = 0; c < held_intrinsics.size(); ++c) {
    const Eigen::MatrixXd& held = held_intrinsics[c];
    const Eigen::MatrixXd& matrix = all_free.camera[c];
    if (held.rows() == 0 || matrix.rows() != kPoseSize + held.rows()) continue;
    const auto inverse = Inverse(matrix.topLeftCorner<kPoseSize, kPoseSize>());
    if (!inverse) continue;
    Eigen::MatrixXd effect = Eigen::MatrixXd::Zero(matrix.rows(), held.rows());
    effect.topRows<kPoseSize>() = -*inverse * matrix.topRightCorner(kPoseSize, held.rows());
    effect.bottomRows(held.rows()).setIdentity();
    covariance.own[c] += effect * held * effect.transpose();
  }
}

std::optional<SolverCovariance> Invert(const NormalEquations& normal, RunContext& context) {
  const size_t cameras = normal.camera.size();
  SolverCovariance covariance;
  covariance.own.resize(cameras);
  covariance.reach.resize(cameras);
  std::vector<char> solvable(cameras, 1);
  context.threads.ParallelFor(cameras, [&](size_t c) {
    auto inverse = Inverse(normal.camera[c]);
    solvable[c] = inverse.has_value();
    if (!inverse) return;
    ClearHeld(normal.camera_free[c], *inverse);
    covariance.reach[c] = -*inverse * normal.coupling[c];
    covariance.own[c] = std::move(*inverse);
  });
  if (std::find(solvable.begin(), solvable.end(), 0) != solvable.end()) return std::nullopt;
  Eigen::MatrixXd reduced = normal.shared;
  for (size_t c = 0; c < cameras; ++c) {
    reduced.noalias() += normal.coupling[c].transpose() * covariance.reach[c];
  }
  auto inverse = Inverse(reduced);
  if (!inverse) return std::nullopt;
  ClearHeld(normal.shared_free, *inverse);
  covariance.shared = std::move(*inverse);
  return covariance;
}

/// Rigid motions of the rig frame (turn about the cameras' centroid, shift): what they do to a
/// camera's unknowns, and what a camera's unknowns contribute to the fit.
struct CameraGauge {
  Eigen::MatrixXd free;  // unknowns x 6
  Eigen::MatrixXd fit;   // 6 x unknowns
};

/// Orientations count as if each camera carried a second point this far away: too little to matter
/// unless the centres alone leave a turn open (one or two cameras, or all on one line).
constexpr double kOrientationArm_m = 1e-3;

std::vector<CameraGauge> MakeGauge(const RigModel& model) {
  Eigen::Vector3d centroid = Eigen::Vector3d::Zero();
  double count = 0;
  for (const auto& pose : model.cam_from_rig) {
    if (!pose) continue;
    centroid += pose->OriginInSource();
    count += 1;
  }
  centroid /= count;
  std::vector<CameraGauge> gauge(model.cam_from_rig.size());
  for (size_t c = 0; c < gauge.size(); ++c) {
    if (!model.cam_from_rig[c]) continue;
    const Rigid3& pose = *model.cam_from_rig[c];
    const Eigen::Index size =
        kPoseSize + static_cast<Eigen::Index>(model.intrinsics[c].params.size());
    gauge[c].free = Eigen::MatrixXd::Zero(size, 6);
    gauge[c].free.topLeftCorner<3, 3>() = -pose.RotationMatrix();
    gauge[c].free.block<3, 3>(3, 0) = -CrossMatrix(pose.OriginInSource() - centroid);
    gauge[c].free.block<3, 3>(3, 3).setIdentity();
    gauge[c].fit = gauge[c].free.transpose();
    gauge[c].fit.leftCols<3>() *= kOrientationArm_m * kOrientationArm_m;
  }
  return gauge;
}

/// The solver's covariance of each camera, taken to the gauge of the fit: with N the free motions
/// and G the fit, H = I - N (G N)^-1 G, blocks of H C H^T.
std::vector<std::optional<Eigen::MatrixXd>> CamerasInFit(const SolverCovariance& covariance,
                                                         const RigModel& model) {
  const std::vector<CameraGauge> gauge = MakeGauge(model);
  const Eigen::Index shared = covariance.shared.rows();
  Eigen::MatrixXd fit_of_free = Eigen::MatrixXd::Zero(6, 6);
  Eigen::MatrixXd fit_of_own = Eigen::MatrixXd::Zero(6, 6);
  Eigen::MatrixXd fit_reach = Eigen::MatrixXd::Zero(6, shared);
  for (size_t c = 0; c < gauge.size(); ++c) {
    if (!model.cam_from_rig[c]) continue;
    fit_of_free += gauge[c].fit * gauge[c].free;
    fit_of_own += gauge[c].fit * covariance.own[c] * gauge[c].fit.transpose();
    fit_reach += gauge[c].fit * covariance.reach[c];
  }
  const Eigen::MatrixXd fit_covariance =
      fit_of_own + fit_reach * covariance.shared * fit_reach.transpose();
  const Eigen::MatrixXd inverse = fit_of_free.inverse();
  std::vector<std::optional<Eigen::MatrixXd>> cameras(gauge.size());
  for (size_t c = 0; c < gauge.size(); ++c) {
    if (!model.cam_from_rig[c]) continue;
    const Eigen::MatrixXd moves = gauge[c].free * inverse;  // unknowns x 6
    const Eigen::MatrixXd with_fit =
        covariance.own[c] * gauge[c].fit.transpose() +
        covariance.reach[c] * covariance.shared * fit_reach.transpose();  // unknowns x 6
    Eigen::MatrixXd own = covariance.own[c] +
                          covariance.reach[c] * covariance.shared * covariance.reach[c].transpose();
    own += moves * fit_covariance * moves.transpose() - moves * with_fit.transpose() -
           with_fit * moves.transpose();
    cameras[c] = std::move(own);
  }
  return cameras;
}

double Root(double variance) { return std::sqrt(std::max(0.0, variance)); }

/// Median depth of a camera's corners.
double BoardDistance_m(const RigProblem& problem, const std::vector<FaceView>& views,
                       const RigModel& model, size_t camera) {
  std::vector<double> depths;
  for (const FaceView& view : views) {
    if (view.camera != camera || !model.Has(view)) continue;
    const Eigen::Vector3d middle =
        *model.cam_from_rig[camera] *
        (*model.rig_from_board[view.shot] *
         (model.faces[view.face].board_from_face * FaceMiddle(problem.board.faces[view.face])));
    depths.push_back(middle.z());
  }
  return depths.empty() ? 1 : Median(std::move(depths));
}

CameraUncertainty Summarize(const CameraIntrinsics& intrinsics, const Rigid3& cam_from_rig,
                            double distance_m, Eigen::MatrixXd covariance) {
  constexpr int kAcross = 9;  // places over each side of the picture
  CameraUncertainty result;
  const Eigen::VectorXd variances = covariance.diagonal();
  result.sigma.rotation_deg = DegFromRad(Root(variances.head<3>().sum()));
  result.sigma.position_mm = 1e3 * Root(variances.segment<3>(3).sum());
  const Eigen::Index params = covariance.rows() - kPoseSize;
  // Of the mean focal length: half the sum of both where there are two.
  const bool two = params >= 2 && IsFocal(intrinsics.model, 1);
  const double focal_variance =
      two ? 0.25 * covariance.block<2, 2>(kPoseSize, kPoseSize).sum() : variances(kPoseSize);
  if (focal_variance > 0) result.sigma.focal_px = Root(focal_variance);
  int places = 0;
  for (int i = 0; i < kAcross * kAcross; ++i) {
    const Eigen::Vector2d pixel((i % kAcross + 0.5) / kAcross * intrinsics.width_px,
                                (i / kAcross + 0.5) / kAcross * intrinsics.height_px);
    const auto ray = intrinsics.NormalizedFromPixel(pixel);
    if (!ray) continue;
    const Eigen::Vector3d x = distance_m * ray->homogeneous();
    ProjectionJacobian projection;
    ProjectWithJacobian(intrinsics.model, intrinsics.params.data(), x, true, projection);
    Eigen::MatrixXd row(2, covariance.cols());
    row << -projection.by_point * CrossMatrix(x),
        -projection.by_point * cam_from_rig.RotationMatrix(), projection.by_params.leftCols(params);
    const double sigma = Root((row * covariance * row.transpose()).trace());
    result.projection_mean_px += sigma;
    result.projection_max_px = std::max(result.projection_max_px, sigma);
    ++places;
  }
  result.projection_mean_px /= std::max(1, places);
  result.covariance = std::move(covariance);
  return result;
}

/// Rigid motions of the board's frame, seen at a point.
Eigen::Matrix<double, 3, 6> MotionAt(const Eigen::Vector3d& point) {
  Eigen::Matrix<double, 3, 6> motion;
  motion << -CrossMatrix(point), Eigen::Matrix3d::Identity();
  return motion;
}

/// Covariance of all faces after the rigid fit of their outer corners.
Eigen::MatrixXd FacesInFit(const RigProblem& problem, const RigModel& model,
                           const std::vector<bool>& seen, const Eigen::MatrixXd& covariance) {
  const Eigen::Index size = covariance.rows();
  Eigen::MatrixXd free = Eigen::MatrixXd::Zero(size, 6), fit = Eigen::MatrixXd::Zero(6, size);
  for (size_t f = 0; f < model.faces.size(); ++f) {
    if (!seen[f]) continue;
    const Rigid3& pose = model.faces[f].board_from_face;
    const BoardFace& face = problem.board.faces[f];
    const Eigen::Index place = kFaceSize * static_cast<Eigen::Index>(f);
    const Eigen::Vector3d middle = pose * FaceMiddle(face);
    free.block<3, 3>(place, 0).setIdentity();
    free.block<3, 6>(place + 3, 0) = MotionAt(middle);
    for (const double x_m : {0.0, face.Width_m()}) {
      for (const double y_m : {0.0, face.Height_m()}) {
        const Eigen::Vector3d corner = pose * Eigen::Vector3d(x_m, y_m, 0);
        Eigen::Matrix<double, 3, kFaceSize> by_face = Eigen::Matrix<double, 3, kFaceSize>::Zero();
        by_face.leftCols<3>() = -CrossMatrix(corner - middle);
        by_face.middleCols<3>(3).setIdentity();
        fit.middleCols<kFaceSize>(place) += MotionAt(corner).transpose() * by_face;
      }
    }
  }
  const Eigen::MatrixXd to_fit =
      Eigen::MatrixXd::Identity(size, size) - free * (fit * free).inverse() * fit;
  return to_fit * covariance * to_fit.transpose();
}

/// `shared` is SolverCovariance's.
std::vector<std::optional<FaceUncertainty>> SummarizeFaces(const RigProblem& problem,
                                                           const std::vector<FaceView>& views,
                                                           const RigModel& model,
                                                           const Eigen::MatrixXd& shared) {
  std::vector<bool> seen(model.faces.size(), false);
  for (const FaceView& view : views) seen[view.face] = seen[view.face] || model.Has(view);
  const Eigen::Index size = kFaceSize * static_cast<Eigen::Index>(model.faces.size());
  const Eigen::MatrixXd in_fit =
      FacesInFit(problem, model, seen, shared.bottomRightCorner(size, size));
  std::vector<std::optional<FaceUncertainty>> faces(model.faces.size());
  for (size_t f = 0; f < faces.size(); ++f) {
    if (!seen[f]) continue;
    const auto variances =
        in_fit.diagonal().segment<kFaceSize>(kFaceSize * static_cast<Eigen::Index>(f));
    faces[f] = FaceUncertainty{DegFromRad(Root(variances.head<3>().sum())),
                               1e3 * Root(variances.segment<3>(3).sum()),
                               1e3 * Root(variances.tail<2>().sum())};
  }
  return faces;
}

}  // namespace

std::vector<size_t> UndeterminedCameras(const RigProblem& problem,
                                        const std::vector<FaceView>& views, const RigModel& model,
                                        const FreeUnknowns& free, RunContext& context) {
  RigSolveOptions options;
  options.free = free;
  const NormalEquations normal = BuildNormal(problem, views, model, options, context);
  std::vector<size_t> cameras;
  for (size_t c = 0; c < normal.camera.size(); ++c) {
    const Eigen::MatrixXd& matrix = normal.camera[c];
    const Eigen::VectorXd scale = matrix.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::LLT<Eigen::MatrixXd> factor(scale.asDiagonal() * matrix * scale.asDiagonal());
    if (factor.info() != Eigen::Success || factor.rcond() < kLeastCondition) cameras.push_back(c);
  }
  return cameras;
}

Result<RigUncertainty> BuildUncertainty(const RigProblem& problem,
                                        const std::vector<FaceView>& views, const RigModel& model,
                                        const AdjustedUnknowns& unknowns, RunContext& context) {
  RigSolveOptions options;
  options.free = unknowns.free;
  const NormalEquations normal = BuildNormal(problem, views, model, options, context);
  auto covariance = Invert(normal, context);
  if (!covariance) {
    return Error{ErrorCode::kFailed, "the pictures do not determine all cameras", "uncertainty"};
  }
  if (!unknowns.held_intrinsics.empty()) {
    options.free.intrinsics = true;
    AddHeldIntrinsics(BuildNormal(problem, views, model, options, context),
                      unknowns.held_intrinsics, *covariance);
  }
  RigUncertainty result;
  const auto cameras = CamerasInFit(*covariance, model);
  result.cameras.resize(cameras.size());
  context.threads.ParallelFor(cameras.size(), [&](size_t c) {
    if (!cameras[c]) return;
    result.cameras[c] = Summarize(model.intrinsics[c], *model.cam_from_rig[c],
                                  BoardDistance_m(problem, views, model, c), *cameras[c]);
  });
  result.faces = SummarizeFaces(problem, views, model, covariance->shared);
  return result;
}

std::vector<FaceView> WithNoise(std::vector<FaceView> views, const std::vector<double>& noise) {
  for (FaceView& view : views) {
    for (SeenCorner& corner : view.corners) corner.sigma_px *= noise[view.camera];
  }
  return views;
}

double NoiseVariance(const RigProblem& problem, const std::vector<FaceView>& views,
                     const RigModel& model, const FreeUnknowns& free) {
  double squares = 0, rows = 0;
  std::vector<bool> cameras(model.cam_from_rig.size()), shots(model.rig_from_board.size()),
      faces(model.faces.size());
  for (const FaceView& view : views) {
    if (!model.Has(view)) continue;
    cameras[view.camera] = shots[view.shot] = faces[view.face] = true;
    const auto residuals = Residuals_px(model, problem.shape, view);
    for (size_t i = 0; i < residuals.size(); ++i) {
      squares += residuals[i].squaredNorm() / std::pow(view.corners[i].sigma_px, 2);
      rows += 2;
    }
  }
  double unknowns = 0;
  for (size_t c = 0; c < cameras.size(); ++c) {
    if (!cameras[c]) continue;
    if (free.cameras) unknowns += kPoseSize;
    const CameraIntrinsics& intrinsics = model.intrinsics[c];
    for (size_t p = 0; p < intrinsics.params.size(); ++p) {
      unknowns += IsFreeParam(free, intrinsics.model, p);
    }
  }
  if (free.shots) unknowns += kPoseSize * std::count(shots.begin(), shots.end(), true);
  if (free.faces) unknowns += kFaceSize * std::count(faces.begin(), faces.end(), true);
  // The rig frame and the board's are free.
  unknowns -= 2 * kPoseSize;
  return squares / std::max(1.0, rows - unknowns);
}

}  // namespace rotunda::rig
