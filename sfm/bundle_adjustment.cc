#include "sfm/bundle_adjustment.h"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <utility>

#include "sfm/solver_stop.h"

namespace rotunda::sfm {
namespace {

/// Bounds of a refined focal length, in larger sides of the picture.
constexpr double kMinFocalRatio = 0.3;
constexpr double kMaxFocalRatio = 5.0;
/// Reduced camera systems of more images than this are factorised as sparse matrices.
constexpr size_t kMaxDenseImages = 150;
/// Stiffness of the scale gauge; at the minimum its residual is zero, whatever it is.
constexpr double kGaugeWeight = 1e4;

/// A pose as the solver moves it: rotation vector w on the left of `base`, and the camera centre.
/// x_in_cam = exp(w) base (x_in_model - center).
struct PoseBlock {
  std::array<double, 6> values = {};  // w, center
  Eigen::Matrix3d base;
  Eigen::Matrix3d rotation;       // exp(w) base
  Eigen::Matrix3d left_jacobian;  // d exp(w) = [left_jacobian dw]x exp(w)
  bool used = false;

  Eigen::Map<const Eigen::Vector3d> center() const {
    return Eigen::Map<const Eigen::Vector3d>(values.data() + 3);
  }
};

/// The parameters stand in the block itself: Ceres orders the blocks of a group by their addresses,
/// and those of separate allocations differ from run to run, and with them the last bits.
struct LensBlock {
  CameraModel model = CameraModel::kOpencv;
  std::array<double, kMaxCameraParams> params = {};
  bool used = false;

  explicit LensBlock(const CameraIntrinsics& lens) : model(lens.model) {
    std::copy(lens.params.begin(), lens.params.end(), params.begin());
  }
  int size() const { return static_cast<int>(CameraParamCount(model)); }
};

/// Rodrigues' formula and the left Jacobian of SO(3) (Sola et al. 2018, eq. 145).
void UpdateRotation(PoseBlock& block) {
  const Eigen::Vector3d w(block.values[0], block.values[1], block.values[2]);
  const Eigen::Matrix3d cross = CrossMatrix(w);
  const double squared = w.squaredNorm();
  const double angle = std::sqrt(squared);
  constexpr double kSmallAngle = 1e-4;  // the series' next term is below 1e-17
  const bool small = angle < kSmallAngle;
  const double a = small ? 1.0 - squared / 6.0 : std::sin(angle) / angle;
  const double b = small ? 0.5 - squared / 24.0 : (1.0 - std::cos(angle)) / squared;
  const double c = small ? 1.0 / 6.0 - squared / 120.0 : (1.0 - a) / squared;
  block.rotation = (Eigen::Matrix3d::Identity() + a * cross + b * cross * cross) * block.base;
  block.left_jacobian = Eigen::Matrix3d::Identity() + b * cross + c * cross * cross;
}

/// Computes every pose's rotation once an evaluation instead of once an observation.
class RotationCache final : public ceres::EvaluationCallback {
 public:
  explicit RotationCache(std::vector<PoseBlock>& poses) : poses_(poses) {}
  void PrepareForEvaluation(bool, bool new_evaluation_point) override {
    if (!new_evaluation_point) return;
    for (PoseBlock& pose : poses_) {
      if (pose.used) UpdateRotation(pose);
    }
  }

 private:
  std::vector<PoseBlock>& poses_;
};

/// (projection - keypoint) / sigma, over pose, point and, when it is refined, the lens.
class ReprojectionCost final : public ceres::CostFunction {
 public:
  ReprojectionCost(const PoseBlock& pose, const LensBlock& lens, bool refine_lens,
                   const Keypoint& keypoint)
      : pose_(pose),
        lens_(lens),
        keypoint_(keypoint.x_px, keypoint.y_px),
        inverse_sigma_(1.0 / KeypointSigma_px(keypoint)) {
    set_num_residuals(2);
    *mutable_parameter_block_sizes() = {6, 3};
    if (refine_lens) {
      mutable_parameter_block_sizes()->push_back(lens.size());
    }
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const Eigen::Map<const Eigen::Vector3d> point(parameters[1]);
    const Eigen::Vector3d x = pose_.rotation * (point - pose_.center());
    const bool refine_lens = parameter_block_sizes().size() > 2;
    const double* lens = refine_lens ? parameters[2] : lens_.params.data();
    const bool with_params = refine_lens && jacobians && jacobians[2];
    ProjectionJacobian projection;
    ProjectWithJacobian(lens_.model, lens, x, with_params, projection);
    Eigen::Map<Eigen::Vector2d> residual(residuals);
    residual = inverse_sigma_ * (projection.pixel - keypoint_);
    if (!jacobians) return true;

    constexpr int RowMajor = Eigen::RowMajor;
    const Eigen::Matrix<double, 2, 3> by_x = inverse_sigma_ * projection.by_point;
    const Eigen::Matrix<double, 2, 3> by_point = by_x * pose_.rotation;
    if (jacobians[0]) {
      Eigen::Map<Eigen::Matrix<double, 2, 6, RowMajor>> by_pose(jacobians[0]);
      by_pose.leftCols<3>() = -by_x * CrossMatrix(x) * pose_.left_jacobian;
      by_pose.rightCols<3>() = -by_point;
    }
    if (jacobians[1]) {
      Eigen::Map<Eigen::Matrix<double, 2, 3, RowMajor>> out(jacobians[1]);
      out = by_point;
    }
    if (with_params) {
      const Eigen::Index count = lens_.size();
      Eigen::Map<Eigen::Matrix<double, 2, Eigen::Dynamic, RowMajor>>(jacobians[2], 2, count) =
          inverse_sigma_ * projection.by_params.leftCols(count);
    }
    return true;
  }

 private:
  const PoseBlock& pose_;
  const LensBlock& lens_;
  Eigen::Vector2d keypoint_;
  double inverse_sigma_;
};

/// Keeps a camera centre at its distance from a fixed one, along the line between them:
/// weight (d^T (center - from) - 1), d = start / |start|^2.
class ScaleGaugeCost final : public ceres::SizedCostFunction<1, 6> {
 public:
  ScaleGaugeCost(const Eigen::Vector3d& from, const Eigen::Vector3d& to)
      : from_(from), direction_((to - from) / (to - from).squaredNorm()) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const Eigen::Map<const Eigen::Vector3d> center(parameters[0] + 3);
    residuals[0] = kGaugeWeight * (direction_.dot(center - from_) - 1.0);
    if (jacobians && jacobians[0]) {
      Eigen::Map<Eigen::Matrix<double, 1, 6>> by_pose(jacobians[0]);
      by_pose.leftCols<3>().setZero();
      by_pose.rightCols<3>() = kGaugeWeight * direction_.transpose();
    }
    return true;
  }

 private:
  Eigen::Vector3d from_, direction_;
};

std::unique_ptr<ceres::LossFunction> MakeLoss(const BundleAdjustmentOptions& options) {
  switch (options.loss) {
    case Loss::kNone:
      return nullptr;
    case Loss::kSoftL1:
      return std::make_unique<ceres::SoftLOneLoss>(options.loss_scale);
    case Loss::kCauchy:
      return std::make_unique<ceres::CauchyLoss>(options.loss_scale);
  }
  return nullptr;
}

/// One bundle adjustment: the blocks the solver moves, and the problem over them.
class Adjustment {
 public:
  Adjustment(Reconstruction& reconstruction, const Features& features,
             const BundleAdjustmentOptions& options)
      : reconstruction_(reconstruction),
        features_(features),
        options_(options),
        loss_(MakeLoss(options)),
        poses_(reconstruction.cam_from_model.size()),
        cache_(poses_) {
    ceres::Problem::Options problem_options;
    problem_options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_options.disable_all_safety_checks = true;
    problem_options.evaluation_callback = &cache_;
    problem_ = std::make_unique<ceres::Problem>(problem_options);
    for (size_t i = 0; i < poses_.size(); ++i) LoadPose(i);
    for (const CameraIntrinsics& lens : reconstruction.intrinsics.lenses) {
      lenses_.emplace_back(lens);
    }
  }

  /// False: no free image sees a point.
  bool Build(const std::vector<ImageId>& free_images) {
    is_free_.assign(poses_.size(), false);
    for (const ImageId image : free_images) is_free_[image.index()] = true;
    for (Point3& point : reconstruction_.points) AddPoint(point);
    if (points_.empty()) return false;
    HoldPoses();
    if (options_.refine_intrinsics) HoldLenses();
    return true;
  }

  Result<BundleAdjustmentReport> Solve(std::stop_token stop) {
    ceres::Solver::Options solver;
    solver.max_num_iterations = options_.max_iterations;
    solver.function_tolerance = options_.function_tolerance;
    solver.num_threads = 1;
    solver.logging_type = ceres::SILENT;
    size_t free = 0;
    for (size_t i = 0; i < poses_.size(); ++i) free += poses_[i].used && is_free_[i];
    solver.linear_solver_type = free > kMaxDenseImages ? ceres::SPARSE_SCHUR : ceres::DENSE_SCHUR;
    solver.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (Point3* point : points_) {
      solver.linear_solver_ordering->AddElementToGroup(point->position.data(), 0);
    }
    for (PoseBlock& pose : poses_) {
      if (pose.used) solver.linear_solver_ordering->AddElementToGroup(pose.values.data(), 1);
    }
    for (LensBlock& lens : lenses_) {
      if (lens.used) solver.linear_solver_ordering->AddElementToGroup(lens.params.data(), 2);
    }
    const std::unique_ptr<ceres::IterationCallback> stopper =
        StopBetweenIterations(std::move(stop));
    solver.callbacks.push_back(stopper.get());
    ceres::Solver::Summary summary;
    ceres::Solve(solver, problem_.get(), &summary);
    if (!summary.IsSolutionUsable()) {
      for (size_t p = 0; p < points_.size(); ++p) points_[p]->position = starts_[p];
      const bool stopped = summary.termination_type == ceres::USER_FAILURE;
      return Error{stopped ? ErrorCode::kCancelled : ErrorCode::kFailed, summary.message,
                   "bundle adjustment"};
    }
    return BundleAdjustmentReport{summary.termination_type == ceres::CONVERGENCE,
                                  static_cast<int>(summary.iterations.size()), summary.initial_cost,
                                  summary.final_cost};
  }

  void Store() {
    for (size_t i = 0; i < poses_.size(); ++i) {
      if (!poses_[i].used || !is_free_[i]) continue;
      UpdateRotation(poses_[i]);
      const Eigen::Quaterniond rotation = Eigen::Quaterniond(poses_[i].rotation).normalized();
      reconstruction_.cam_from_model[i] = Rigid3{rotation, -(rotation * poses_[i].center())};
    }
    for (size_t i = 0; i < lenses_.size(); ++i) {
      if (!lenses_[i].used) continue;
      std::vector<double>& params = reconstruction_.intrinsics.lenses[i].params;
      std::copy_n(lenses_[i].params.begin(), params.size(), params.begin());
    }
  }

 private:
  void LoadPose(size_t image) {
    const std::optional<Rigid3>& cam_from_model = reconstruction_.cam_from_model[image];
    if (!cam_from_model) return;
    poses_[image].base = cam_from_model->RotationMatrix();
    Eigen::Map<Eigen::Vector3d>(poses_[image].values.data() + 3) = cam_from_model->OriginInSource();
    UpdateRotation(poses_[image]);
  }

  void AddPoint(Point3& point) {
    size_t registered = 0;
    bool seen_by_free = false;
    for (const Observation& observation : point.observations) {
      registered += reconstruction_.Registered(observation.image);
      seen_by_free = seen_by_free || is_free_[observation.image.index()];
    }
    if (registered < 2 || !seen_by_free) return;
    points_.push_back(&point);
    starts_.push_back(point.position);
    for (const Observation& observation : point.observations) {
      if (reconstruction_.Registered(observation.image)) AddObservation(point, observation);
    }
  }

  void AddObservation(Point3& point, const Observation& observation) {
    PoseBlock& pose = poses_[observation.image.index()];
    LensBlock& lens = lenses_[reconstruction_.intrinsics.lens_of_image[observation.image.index()]];
    const Keypoint& keypoint =
        features_.image(observation.image).keypoints[observation.keypoint.index()];
    costs_.emplace_back(pose, lens, options_.refine_intrinsics, keypoint);
    pose.used = true;
    if (options_.refine_intrinsics) {
      lens.used = true;
      problem_->AddResidualBlock(&costs_.back(), loss_.get(), pose.values.data(),
                                 point.position.data(), lens.params.data());
    } else {
      problem_->AddResidualBlock(&costs_.back(), loss_.get(), pose.values.data(),
                                 point.position.data());
    }
  }

  void HoldPoses() {
    std::vector<size_t> held;
    for (size_t i = 0; i < poses_.size(); ++i) {
      if (!poses_[i].used || is_free_[i]) continue;
      held.push_back(i);
    }
    if (held.empty()) {
      const auto first = std::find_if(poses_.begin(), poses_.end(),
                                      [](const PoseBlock& pose) { return pose.used; });
      held.push_back(static_cast<size_t>(first - poses_.begin()));
      is_free_[held.front()] = false;
    }
    for (const size_t i : held) problem_->SetParameterBlockConstant(poses_[i].values.data());
    if (held.size() == 1) HoldScale(poses_[held.front()]);
  }

  void HoldScale(const PoseBlock& fixed) {
    PoseBlock* farthest = nullptr;
    double distance = 0;
    for (PoseBlock& pose : poses_) {
      if (!pose.used || (pose.center() - fixed.center()).norm() <= distance) continue;
      distance = (pose.center() - fixed.center()).norm();
      farthest = &pose;
    }
    if (!farthest) return;
    gauge_ = std::make_unique<ScaleGaugeCost>(fixed.center(), farthest->center());
    problem_->AddResidualBlock(gauge_.get(), nullptr, farthest->values.data());
  }

  void HoldLenses() {
    for (size_t l = 0; l < lenses_.size(); ++l) {
      LensBlock& lens = lenses_[l];
      if (!lens.used) continue;
      const CameraIntrinsics& intrinsics = reconstruction_.intrinsics.lenses[l];
      const double larger_side = std::max(intrinsics.width_px, intrinsics.height_px);
      std::vector<int> held;
      for (int place = 0; place < lens.size(); ++place) {
        const auto p = static_cast<size_t>(place);
        if (IsPrincipalPoint(lens.model, p)) held.push_back(place);
        if (!IsFocal(lens.model, p)) continue;
        const double low = kMinFocalRatio * larger_side, high = kMaxFocalRatio * larger_side;
        lens.params[p] = std::clamp(lens.params[p], low, high);
        problem_->SetParameterLowerBound(lens.params.data(), place, low);
        problem_->SetParameterUpperBound(lens.params.data(), place, high);
      }
      manifolds_.push_back(std::make_unique<ceres::SubsetManifold>(lens.size(), held));
      problem_->SetManifold(lens.params.data(), manifolds_.back().get());
    }
  }

  Reconstruction& reconstruction_;
  const Features& features_;
  const BundleAdjustmentOptions& options_;
  std::unique_ptr<ceres::LossFunction> loss_;
  std::vector<PoseBlock> poses_;
  std::vector<LensBlock> lenses_;
  std::vector<bool> is_free_;
  std::vector<Point3*> points_;
  std::vector<Eigen::Vector3d> starts_;  // parallel to points_: the solver moves them in place
  std::deque<ReprojectionCost> costs_;
  std::unique_ptr<ScaleGaugeCost> gauge_;
  std::vector<std::unique_ptr<ceres::Manifold>> manifolds_;
  RotationCache cache_;
  std::unique_ptr<ceres::Problem> problem_;  // last: refers to all of the above
};

}  // namespace

Status BundleAdjustmentOptions::Validate() const {
  const auto bad = [](const char* field, double value, const char* expected) {
    return Error{ErrorCode::kInvalidArgument,
                 std::to_string(value) + " is out of range, expected " + expected, field};
  };
  if (!(loss_scale > 0)) return bad("loss_scale", loss_scale, "> 0");
  if (max_iterations < 1) return bad("max_iterations", max_iterations, ">= 1");
  if (!(function_tolerance >= 0)) return bad("function_tolerance", function_tolerance, ">= 0");
  return {};
}

Result<BundleAdjustmentReport> AdjustBundle(Reconstruction& reconstruction,
                                            const Features& features,
                                            const std::vector<ImageId>& free_images,
                                            const BundleAdjustmentOptions& options,
                                            RunContext& context) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "cancelled", "bundle adjustment"};
  Adjustment adjustment(reconstruction, features, options);
  if (!adjustment.Build(free_images)) {
    return Error{ErrorCode::kInvalidArgument, "no free image sees a point of two images",
                 "bundle adjustment"};
  }
  ROTUNDA_ASSIGN_OR_RETURN(const BundleAdjustmentReport report, adjustment.Solve(context.stop));
  adjustment.Store();
  return report;
}

double KeypointSigma_px(const Keypoint& keypoint) {
  // sqrt(floor^2 + (slope x scale)^2), fitted to the residuals of adjusted photographs and
  // renderings over the scale.
  constexpr double kFloor_px = 0.13;
  constexpr double kSlope = 0.052;
  return std::hypot(kFloor_px, kSlope * keypoint.scale_px);
}

}  // namespace rotunda::sfm
