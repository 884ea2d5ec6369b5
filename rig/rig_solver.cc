#include "rig/rig_solver.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

namespace rotunda::rig {
namespace {

using Mask = Eigen::Array<bool, Eigen::Dynamic, 1>;

constexpr double kMinDepth_m = 1e-3;
constexpr size_t kFirstRational = 9;  // of FULL_OPENCV's parameters: k4
/// Standard deviations that no lens exceeds by much: the pictures of a camera with good coverage
/// outweigh them a million times.
constexpr double kFocalPrior = 1.0;            // of the focal length, as a share of the larger side
constexpr double kPrincipalPointPrior = 0.05;  // as a share of the larger side, about the middle
constexpr double kRadialPrior = 1.0;           // about 0
constexpr double kTangentialPrior = 0.02;      // about 0

double InverseVariance(double sigma) {
  return std::isfinite(sigma) && sigma > 0 ? 1.0 / (sigma * sigma) : 0.0;
}

bool IsTangential(CameraModel model, size_t param) {
  return (model == CameraModel::kOpencv || model == CameraModel::kFullOpencv) &&
         (param == 6 || param == 7);
}

/// Mean and inverse variance of a parameter's weak prior.
struct ParamPrior {
  double mean = 0;
  double weight = 0;
};
ParamPrior PriorOf(const CameraIntrinsics& intrinsics, size_t param) {
  const double side = std::max(intrinsics.width_px, intrinsics.height_px);
  if (IsFocal(intrinsics.model, param)) return {side, InverseVariance(kFocalPrior * side)};
  if (IsPrincipalPoint(intrinsics.model, param)) {
    const bool first = param == 0 || !IsPrincipalPoint(intrinsics.model, param - 1);
    return {0.5 * (first ? intrinsics.width_px : intrinsics.height_px),
            InverseVariance(kPrincipalPointPrior * side)};
  }
  const bool tangential = IsTangential(intrinsics.model, param);
  return {0, InverseVariance(tangential ? kTangentialPrior : kRadialPrior)};
}

/// Cauchy: loss of a squared error and its derivative.
double Loss(double squared, double scale) {
  if (scale <= 0) return squared;
  return scale * scale * std::log1p(squared / (scale * scale));
}
double LossWeight(double squared, double scale) {
  return scale <= 0 ? 1.0 : 1.0 / (1.0 + squared / (scale * scale));
}

double PriorCost(const RigProblem& problem, const RigModel& model) {
  double cost = 0;
  for (size_t f = 0; f < model.faces.size(); ++f) {
    const FacePrior& prior = problem.priors[f];
    const Rigid3& pose = model.faces[f].board_from_face;
    const Eigen::Vector3d middle = FaceMiddle(problem.board.faces[f]);
    const Eigen::Vector3d turn =
        TurnOf(pose.rotation * prior.face.board_from_face.rotation.conjugate());
    const Eigen::Vector3d shift = pose * middle - prior.face.board_from_face * middle;
    cost += InverseVariance(prior.rotation_sigma_rad) * turn.squaredNorm() +
            InverseVariance(prior.position_sigma_m) * shift.squaredNorm() +
            InverseVariance(prior.bow_sigma_m) *
                (model.faces[f].bow_m - prior.face.bow_m).squaredNorm();
  }
  for (const CameraIntrinsics& intrinsics : model.intrinsics) {
    for (size_t p = 0; p < intrinsics.params.size(); ++p) {
      const ParamPrior prior = PriorOf(intrinsics, p);
      cost += prior.weight * std::pow(intrinsics.params[p] - prior.mean, 2);
    }
  }
  return 0.5 * cost;
}

double Cost(const RigProblem& problem, const std::vector<FaceView>& views, const RigModel& model,
            double loss_scale, RunContext& context) {
  std::vector<double> costs(views.size(), 0.0);
  context.threads.ParallelFor(views.size(), [&](size_t v) {
    const FaceView& view = views[v];
    if (!model.Has(view)) return;
    const auto residuals = Residuals_px(model, problem.shape, view);
    for (size_t i = 0; i < residuals.size(); ++i) {
      const double sigma = view.corners[i].sigma_px;
      costs[v] += 0.5 * Loss(residuals[i].squaredNorm() / (sigma * sigma), loss_scale);
    }
  });
  double sum = PriorCost(problem, model);
  for (const double cost : costs) sum += cost;
  return sum;
}

/// One view's share of the normal equations; unknowns in the order shot, face, camera.
struct ViewNormal {
  Eigen::MatrixXd matrix;
  Eigen::VectorXd gradient;
};

/// Poses of one view and what their product needs again for every corner.
struct ViewFrame {
  Eigen::Matrix3d rig_from_board, board_from_face, cam_from_rig;
  Eigen::Vector3d board_in_rig, face_in_board, rig_in_cam, middle;
};

ViewFrame FrameOf(const RigProblem& problem, const RigModel& model, const FaceView& view) {
  const Rigid3& shot = *model.rig_from_board[view.shot];
  const Rigid3& face = model.faces[view.face].board_from_face;
  const Rigid3& camera = *model.cam_from_rig[view.camera];
  return {shot.RotationMatrix(),
          face.RotationMatrix(),
          camera.RotationMatrix(),
          shot.translation,
          face.translation,
          camera.translation,
          FaceMiddle(problem.board.faces[view.face])};
}

/// A corner on the face as it is bowed, and in the frames that derivatives are taken in.
struct CornerPlace {
  Eigen::Vector3d in_face, in_rig, in_cam;
  Eigen::Vector2d bow;  // of its CornerShape
};

CornerPlace PlaceOf(const CornerShape& corner, const Eigen::Vector2d& bow_m,
                    const ViewFrame& frame) {
  CornerPlace at;
  at.bow = corner.bow;
  at.in_face = corner.in_face - Eigen::Vector3d(0, 0, corner.bow.dot(bow_m));
  const Eigen::Vector3d in_board = frame.board_from_face * at.in_face + frame.face_in_board;
  at.in_rig = frame.rig_from_board * in_board + frame.board_in_rig;
  at.in_cam = frame.cam_from_rig * at.in_rig + frame.rig_in_cam;
  return at;
}

/// Derivatives of a corner's pixel by shot, face and pose of the camera, in this order; `by_cam`
/// are those by its place in the camera's frame.
template <typename TwoRows>
void FillRows(const CornerPlace& at, const ViewFrame& frame,
              const Eigen::Matrix<double, 2, 3>& by_cam, TwoRows row) {
  const Eigen::Matrix<double, 2, 3> by_rig = by_cam * frame.cam_from_rig;
  const Eigen::Matrix<double, 2, 3> by_board = by_rig * frame.rig_from_board;
  const Eigen::Vector3d arm = frame.board_from_face * (at.in_face - frame.middle);
  row.template middleCols<3>(0) = -by_rig * CrossMatrix(at.in_rig - frame.board_in_rig);
  row.template middleCols<3>(3) = by_rig;
  row.template middleCols<3>(6) = -by_board * CrossMatrix(arm);
  row.template middleCols<3>(9) = by_board;
  row.template middleCols<2>(12) = -(by_board * frame.board_from_face.col(2)) * at.bow.transpose();
  row.template middleCols<3>(14) = -by_cam * CrossMatrix(at.in_cam);
  row.template middleCols<3>(17) = -by_rig;
}

ViewNormal NormalOfView(const RigProblem& problem, const RigModel& model, const FaceView& view,
                        double loss_scale) {
  const CameraIntrinsics& intrinsics = model.intrinsics[view.camera];
  const ViewFrame frame = FrameOf(problem, model, view);
  const auto params = static_cast<Eigen::Index>(intrinsics.params.size());
  const Eigen::Index size = 2 * kPoseSize + kFaceSize + params;
  const auto count = static_cast<Eigen::Index>(view.corners.size());
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows(2 * count, size);
  Eigen::VectorXd residuals(2 * count);
  ProjectionJacobian projection;
  for (Eigen::Index i = 0; i < count; ++i) {
    const SeenCorner& seen = view.corners[static_cast<size_t>(i)];
    const CornerShape& corner = problem.shape[view.face][static_cast<size_t>(seen.corner)];
    const CornerPlace at = PlaceOf(corner, model.faces[view.face].bow_m, frame);
    auto row = rows.middleRows<2>(2 * i);
    auto residual = residuals.segment<2>(2 * i);
    row.setZero();
    residual.setZero();
    if (at.in_cam.z() < kMinDepth_m) continue;
    ProjectWithJacobian(intrinsics.model, intrinsics.params.data(), at.in_cam, true, projection);
    const double inverse_sigma = 1.0 / seen.sigma_px;
    residual = inverse_sigma * (projection.pixel - seen.pixel);
    const double weight = std::sqrt(LossWeight(residual.squaredNorm(), loss_scale)) * inverse_sigma;
    residual *= weight * seen.sigma_px;
    FillRows(at, frame, weight * projection.by_point, row);
    row.rightCols(params) = weight * projection.by_params.leftCols(params);
  }
  ViewNormal normal;
  normal.matrix.noalias() = rows.transpose() * rows;
  normal.gradient.noalias() = rows.transpose() * residuals;
  return normal;
}

Eigen::Index ShotPlace(size_t shot) { return kPoseSize * static_cast<Eigen::Index>(shot); }
Eigen::Index FacePlace(const RigModel& model, size_t face) {
  return ShotPlace(model.rig_from_board.size()) + kFaceSize * static_cast<Eigen::Index>(face);
}

void AddView(const RigModel& model, const FaceView& view, const ViewNormal& one,
             NormalEquations& sum) {
  const Eigen::Index shot = ShotPlace(view.shot), face = FacePlace(model, view.face);
  const Eigen::Index both = kPoseSize + kFaceSize;
  const Eigen::Index camera_size = one.matrix.rows() - both;
  sum.camera[view.camera] += one.matrix.bottomRightCorner(camera_size, camera_size);
  auto& coupling = sum.coupling[view.camera];
  coupling.middleCols<kPoseSize>(shot) += one.matrix.block(both, 0, camera_size, kPoseSize);
  coupling.middleCols<kFaceSize>(face) += one.matrix.block(both, kPoseSize, camera_size, kFaceSize);
  sum.camera_gradient[view.camera] += one.gradient.tail(camera_size);
  sum.shared.block<kPoseSize, kPoseSize>(shot, shot) +=
      one.matrix.topLeftCorner<kPoseSize, kPoseSize>();
  sum.shared.block<kFaceSize, kFaceSize>(face, face) +=
      one.matrix.block<kFaceSize, kFaceSize>(kPoseSize, kPoseSize);
  sum.shared.block<kPoseSize, kFaceSize>(shot, face) +=
      one.matrix.block<kPoseSize, kFaceSize>(0, kPoseSize);
  sum.shared.block<kFaceSize, kPoseSize>(face, shot) +=
      one.matrix.block<kFaceSize, kPoseSize>(kPoseSize, 0);
  sum.shared_gradient.segment<kPoseSize>(shot) += one.gradient.head<kPoseSize>();
  sum.shared_gradient.segment<kFaceSize>(face) += one.gradient.segment<kFaceSize>(kPoseSize);
}

void AddPriors(const RigProblem& problem, const RigModel& model, NormalEquations& sum) {
  for (size_t f = 0; f < model.faces.size(); ++f) {
    const FacePrior& prior = problem.priors[f];
    const Rigid3& pose = model.faces[f].board_from_face;
    const Rigid3& drawn = prior.face.board_from_face;
    const Eigen::Vector3d middle = FaceMiddle(problem.board.faces[f]);
    Eigen::Matrix<double, kFaceSize, 1> weights, errors;
    weights << Eigen::Vector3d::Constant(InverseVariance(prior.rotation_sigma_rad)),
        Eigen::Vector3d::Constant(InverseVariance(prior.position_sigma_m)),
        Eigen::Vector2d::Constant(InverseVariance(prior.bow_sigma_m));
    errors << TurnOf(pose.rotation * drawn.rotation.conjugate()), pose * middle - drawn * middle,
        model.faces[f].bow_m - prior.face.bow_m;
    const Eigen::Index place = FacePlace(model, f);
    sum.shared.diagonal().segment<kFaceSize>(place) += weights;
    sum.shared_gradient.segment<kFaceSize>(place) += weights.cwiseProduct(errors);
  }
  for (size_t c = 0; c < model.intrinsics.size(); ++c) {
    const CameraIntrinsics& intrinsics = model.intrinsics[c];
    for (size_t p = 0; p < intrinsics.params.size(); ++p) {
      const ParamPrior prior = PriorOf(intrinsics, p);
      const auto place = kPoseSize + static_cast<Eigen::Index>(p);
      sum.camera[c](place, place) += prior.weight;
      sum.camera_gradient[c](place) += prior.weight * (intrinsics.params[p] - prior.mean);
    }
  }
}

void SetMasks(const RigProblem& problem, const std::vector<FaceView>& views, const RigModel& model,
              const FreeUnknowns& free, NormalEquations& normal) {
  normal.shared_free = Mask::Constant(normal.shared.rows(), false);
  const auto has_pose = [](const std::optional<Rigid3>& pose) { return pose.has_value(); };
  const auto first = static_cast<size_t>(
      std::find_if(model.rig_from_board.begin(), model.rig_from_board.end(), has_pose) -
      model.rig_from_board.begin());
  const bool loose =
      std::any_of(problem.priors.begin(), problem.priors.end(), [](const FacePrior& prior) {
        return !std::isfinite(prior.position_sigma_m) || !std::isfinite(prior.rotation_sigma_rad);
      });
  size_t held_face = loose ? model.faces.size() : SIZE_MAX;  // the board's frame, when loose
  for (const FaceView& view : views) {
    if (!model.Has(view)) continue;
    const CameraIntrinsics& intrinsics = model.intrinsics[view.camera];
    Mask& camera = normal.camera_free[view.camera];
    camera.head<kPoseSize>() = free.cameras;
    for (size_t p = 0; p < intrinsics.params.size(); ++p) {
      camera(kPoseSize + static_cast<Eigen::Index>(p)) = IsFreeParam(free, intrinsics.model, p);
    }
    if (free.shots && !(free.cameras && view.shot == first)) {
      normal.shared_free.segment<kPoseSize>(ShotPlace(view.shot)) = true;
    }
    if (!free.faces) continue;
    const FacePrior& prior = problem.priors[view.face];
    auto face = normal.shared_free.segment<kFaceSize>(FacePlace(model, view.face));
    face.head<3>() = prior.rotation_sigma_rad > 0;
    face.segment<3>(3) = prior.position_sigma_m > 0;
    face.tail<2>() = prior.bow_sigma_m > 0;
    if (held_face != SIZE_MAX) held_face = std::min(held_face, view.face);
  }
  if (held_face < model.faces.size()) {
    normal.shared_free.segment<kPoseSize>(FacePlace(model, held_face)) = false;
  }
}

/// Takes what is held out of the equations.
void Hold(NormalEquations& normal) {
  for (Eigen::Index i = 0; i < normal.shared_free.size(); ++i) {
    if (normal.shared_free(i)) continue;
    normal.shared.row(i).setZero();
    normal.shared.col(i).setZero();
    normal.shared(i, i) = 1;
    normal.shared_gradient(i) = 0;
    for (Eigen::MatrixXd& coupling : normal.coupling) coupling.col(i).setZero();
  }
  for (size_t c = 0; c < normal.camera.size(); ++c) {
    for (Eigen::Index i = 0; i < normal.camera_free[c].size(); ++i) {
      if (normal.camera_free[c](i)) continue;
      normal.camera[c].row(i).setZero();
      normal.camera[c].col(i).setZero();
      normal.camera[c](i, i) = 1;
      normal.camera_gradient[c](i) = 0;
      normal.coupling[c].row(i).setZero();
    }
  }
}

/// A step of all unknowns.
struct Step {
  std::vector<Eigen::VectorXd> camera;
  Eigen::VectorXd shared;
};

/// (H + damping diag(H)) step = -gradient; false when H is not positive definite.
bool SolveDamped(const NormalEquations& normal, double damping, Step& step, RunContext& context) {
  const size_t cameras = normal.camera.size();
  std::vector<Eigen::MatrixXd> eliminated(cameras);  // U^-1 W
  std::vector<Eigen::VectorXd> eliminated_gradient(cameras);
  std::vector<char> solvable(cameras, 1);
  context.threads.ParallelFor(cameras, [&](size_t c) {
    Eigen::MatrixXd matrix = normal.camera[c];
    matrix.diagonal() *= 1.0 + damping;
    const Eigen::VectorXd scale = matrix.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::LLT<Eigen::MatrixXd> factor(scale.asDiagonal() * matrix * scale.asDiagonal());
    solvable[c] = factor.info() == Eigen::Success && scale.allFinite();
    if (!solvable[c]) return;
    eliminated[c] = scale.asDiagonal() * factor.solve(scale.asDiagonal() * normal.coupling[c]);
    eliminated_gradient[c] =
        scale.asDiagonal() * factor.solve(scale.cwiseProduct(normal.camera_gradient[c]));
  });
  if (std::find(solvable.begin(), solvable.end(), 0) != solvable.end()) return false;
  Eigen::MatrixXd reduced = normal.shared;
  reduced.diagonal() *= 1.0 + damping;
  Eigen::VectorXd gradient = normal.shared_gradient;
  for (size_t c = 0; c < cameras; ++c) {
    reduced.noalias() -= normal.coupling[c].transpose() * eliminated[c];
    gradient.noalias() -= normal.coupling[c].transpose() * eliminated_gradient[c];
  }
  const Eigen::VectorXd scale = reduced.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::LLT<Eigen::MatrixXd> factor(scale.asDiagonal() * reduced * scale.asDiagonal());
  if (factor.info() != Eigen::Success || !scale.allFinite()) return false;
  step.shared = -(scale.asDiagonal() * factor.solve(scale.cwiseProduct(gradient)));
  step.camera.resize(cameras);
  for (size_t c = 0; c < cameras; ++c) {
    step.camera[c] = -eliminated_gradient[c] - eliminated[c] * step.shared;
  }
  return step.shared.allFinite();
}

RigModel Moved(const RigProblem& problem, const RigModel& model, const Step& step) {
  RigModel moved = model;
  for (size_t c = 0; c < model.intrinsics.size(); ++c) {
    if (!model.cam_from_rig[c]) continue;
    const Eigen::VectorXd& d = step.camera[c];
    const Eigen::Vector3d centre = model.cam_from_rig[c]->OriginInSource() + d.segment<3>(3);
    Rigid3& pose = *moved.cam_from_rig[c];
    pose.rotation = (RotationOf(d.head<3>()) * pose.rotation).normalized();
    pose.translation = -(pose.rotation * centre);
    for (size_t p = 0; p < moved.intrinsics[c].params.size(); ++p) {
      moved.intrinsics[c].params[p] += d(kPoseSize + static_cast<Eigen::Index>(p));
    }
  }
  for (size_t s = 0; s < model.rig_from_board.size(); ++s) {
    if (!model.rig_from_board[s]) continue;
    const auto d = step.shared.segment<kPoseSize>(ShotPlace(s));
    Rigid3& pose = *moved.rig_from_board[s];
    pose.rotation = (RotationOf(d.head<3>()) * pose.rotation).normalized();
    pose.translation += d.tail<3>();
  }
  for (size_t f = 0; f < model.faces.size(); ++f) {
    const auto d = step.shared.segment<kFaceSize>(FacePlace(model, f));
    const Eigen::Vector3d in_face = FaceMiddle(problem.board.faces[f]);
    Rigid3& pose = moved.faces[f].board_from_face;
    const Eigen::Vector3d middle = pose * in_face + d.segment<3>(3);
    pose.rotation = (RotationOf(d.head<3>()) * pose.rotation).normalized();
    pose.translation = middle - pose.rotation * in_face;
    moved.faces[f].bow_m += d.tail<2>();
  }
  return moved;
}

bool FocalsPositive(const RigModel& model) {
  return std::all_of(model.intrinsics.begin(), model.intrinsics.end(),
                     [](const CameraIntrinsics& i) { return i.fx_px() > 0 && i.fy_px() > 0; });
}

/// What is added to the diagonal (times itself): less after a step that lowers the cost, more and
/// more after others.
class Damping {
 public:
  double value() const { return value_; }
  bool exhausted() const { return value_ >= kMost; }
  void Lower() {
    value_ = std::max(value_ / 10, kLeast);
    growth_ = 2;
  }
  void Raise() {
    value_ *= growth_;
    growth_ *= 2;
  }

 private:
  static constexpr double kFirst = 1e-5, kLeast = 1e-12, kMost = 1e8;
  double value_ = kFirst, growth_ = 2;
};

}  // namespace

bool IsFreeParam(const FreeUnknowns& free, CameraModel model, size_t param) {
  if (!free.intrinsics || (!free.rational && param >= kFirstRational)) return false;
  return !free.focal_only || IsFocal(model, param) || (param == 4 && model != CameraModel::kRadial);
}

NormalEquations BuildNormal(const RigProblem& problem, const std::vector<FaceView>& views,
                            const RigModel& model, const RigSolveOptions& options,
                            RunContext& context) {
  std::vector<ViewNormal> parts(views.size());
  context.threads.ParallelFor(views.size(), [&](size_t v) {
    if (model.Has(views[v])) parts[v] = NormalOfView(problem, model, views[v], options.loss_scale);
  });
  NormalEquations sum;
  const Eigen::Index shared = FacePlace(model, model.faces.size());
  sum.shared = Eigen::MatrixXd::Zero(shared, shared);
  sum.shared_gradient = Eigen::VectorXd::Zero(shared);
  for (const CameraIntrinsics& intrinsics : model.intrinsics) {
    const Eigen::Index size = kPoseSize + static_cast<Eigen::Index>(intrinsics.params.size());
    sum.camera.push_back(Eigen::MatrixXd::Zero(size, size));
    sum.coupling.push_back(Eigen::MatrixXd::Zero(size, shared));
    sum.camera_gradient.push_back(Eigen::VectorXd::Zero(size));
    sum.camera_free.push_back(Mask::Constant(size, false));
  }
  for (size_t v = 0; v < views.size(); ++v) {
    if (model.Has(views[v])) AddView(model, views[v], parts[v], sum);
  }
  AddPriors(problem, model, sum);
  SetMasks(problem, views, model, options.free, sum);
  Hold(sum);
  return sum;
}

Result<RigSolveReport> SolveRig(const RigProblem& problem, const std::vector<FaceView>& views,
                                const RigSolveOptions& options, RigModel& model,
                                RunContext& context) {
  RigSolveReport report;
  double cost = Cost(problem, views, model, options.loss_scale, context);
  report.initial_cost = report.final_cost = cost;
  Damping damping;
  NormalEquations normal = BuildNormal(problem, views, model, options, context);
  while (report.iterations < options.max_iterations && !damping.exhausted()) {
    if (context.Stopped()) return Error{ErrorCode::kCancelled, "stopped", "calibration"};
    ++report.iterations;
    Step step;
    if (!SolveDamped(normal, damping.value(), step, context)) {
      damping.Raise();
      continue;
    }
    const RigModel moved = Moved(problem, model, step);
    const double moved_cost = FocalsPositive(moved)
                                  ? Cost(problem, views, moved, options.loss_scale, context)
                                  : std::numeric_limits<double>::infinity();
    // Ends also when rounding lets no step lower the cost any more.
    const double change = (cost - moved_cost) / cost;
    if (moved_cost < cost) {
      model = moved;
      report.final_cost = cost = moved_cost;
    }
    if (std::abs(change) < options.function_tolerance) {
      report.converged = true;
      return report;
    }
    if (change > 0) {
      damping.Lower();
      normal = BuildNormal(problem, views, model, options, context);
    } else {
      damping.Raise();
    }
  }
  if (damping.exhausted() && report.final_cost == report.initial_cost) {
    return Error{ErrorCode::kFailed, "the equations of the calibration cannot be solved", ""};
  }
  return report;
}

}  // namespace rotunda::rig
