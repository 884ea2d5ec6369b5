#include "sfm/bundle_ceres.h"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
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

/// A pose as the solver moves it: rotation vector w on the left of `base`, and the camera centre.
/// x_in_cam = exp(w) base (x_in_model - center).
struct PoseBlock {
  std::array<double, 6> values = {};  // w, center
  Eigen::Matrix3d base;
  Eigen::Matrix3d rotation;       // exp(w) base
  Eigen::Matrix3d left_jacobian;  // d exp(w) = [left_jacobian dw]x exp(w)

  Eigen::Map<const Eigen::Vector3d> center() const {
    return Eigen::Map<const Eigen::Vector3d>(values.data() + 3);
  }
};

/// The parameters stand in the block itself: Ceres orders the blocks of a group by their addresses,
/// and those of separate allocations differ from run to run, and with them the last bits.
struct LensBlock {
  CameraModel model = CameraModel::kOpencv;
  std::array<double, kMaxCameraParams> params = {};

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
    for (PoseBlock& pose : poses_) UpdateRotation(pose);
  }

 private:
  std::vector<PoseBlock>& poses_;
};

/// (projection - keypoint) / sigma, over pose, point and, when it is refined, the lens.
class ReprojectionCost final : public ceres::CostFunction {
 public:
  ReprojectionCost(const PoseBlock& pose, const LensBlock& lens, bool refine_lens,
                   const BundleObservation& observation)
      : pose_(pose), lens_(lens), observation_(observation) {
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
    residual = observation_.inverse_sigma * (projection.pixel - observation_.pixel);
    if (!jacobians) return true;

    constexpr int RowMajor = Eigen::RowMajor;
    const Eigen::Matrix<double, 2, 3> by_x = observation_.inverse_sigma * projection.by_point;
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
          observation_.inverse_sigma * projection.by_params.leftCols(count);
    }
    return true;
  }

 private:
  const PoseBlock& pose_;
  const LensBlock& lens_;
  const BundleObservation& observation_;
};

class ScaleGaugeCost final : public ceres::SizedCostFunction<1, 6> {
 public:
  explicit ScaleGaugeCost(const ScaleGauge& gauge) : gauge_(gauge) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    residuals[0] = gauge_.Residual(Eigen::Map<const Eigen::Vector3d>(parameters[0] + 3));
    if (jacobians && jacobians[0]) {
      Eigen::Map<Eigen::Matrix<double, 1, 6>> by_pose(jacobians[0]);
      by_pose.leftCols<3>().setZero();
      by_pose.rightCols<3>() = gauge_.Gradient().transpose();
    }
    return true;
  }

 private:
  const ScaleGauge& gauge_;
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

/// The blocks that Ceres moves, and its problem over them.
class CeresAdjustment {
 public:
  CeresAdjustment(BundleProblem& problem, const BundleAdjustmentOptions& options)
      : bundle_(problem),
        options_(options),
        loss_(MakeLoss(options)),
        poses_(problem.poses.size()),
        lens_used_(problem.lenses.size(), false),
        cache_(poses_) {
    ceres::Problem::Options problem_options;
    problem_options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_options.disable_all_safety_checks = true;
    problem_options.evaluation_callback = &cache_;
    problem_ = std::make_unique<ceres::Problem>(problem_options);
    for (const CameraIntrinsics& lens : problem.lenses) lenses_.emplace_back(lens);
    for (size_t i = 0; i < poses_.size(); ++i) LoadPose(i);
    for (size_t p = 0; p < problem.points.size(); ++p) AddPoint(p);
    HoldPoses();
    if (options.refine_intrinsics) HoldLenses();
  }

  Result<BundleAdjustmentReport> Solve(std::stop_token stop) {
    ceres::Solver::Options solver;
    solver.max_num_iterations = options_.max_iterations;
    solver.function_tolerance = options_.function_tolerance;
    solver.num_threads = 1;
    solver.logging_type = ceres::SILENT;
    const bool dense = FreeImages(bundle_) <= kMaxDenseImages;
    solver.linear_solver_type = dense ? ceres::DENSE_SCHUR : ceres::SPARSE_SCHUR;
    solver.linear_solver_ordering = MakeOrdering();
    const std::unique_ptr<ceres::IterationCallback> stopper =
        StopBetweenIterations(std::move(stop));
    solver.callbacks.push_back(stopper.get());
    ceres::Solver::Summary summary;
    ceres::Solve(solver, problem_.get(), &summary);
    if (!summary.IsSolutionUsable()) {
      const bool stopped = summary.termination_type == ceres::USER_FAILURE;
      return Error{stopped ? ErrorCode::kCancelled : ErrorCode::kFailed, summary.message,
                   "bundle adjustment"};
    }
    Store();
    return BundleAdjustmentReport{summary.termination_type == ceres::CONVERGENCE,
                                  static_cast<int>(summary.iterations.size()) - 1,
                                  summary.initial_cost, summary.final_cost};
  }

 private:
  void LoadPose(size_t image) {
    poses_[image].base = bundle_.poses[image].rotation.toRotationMatrix();
    Eigen::Map<Eigen::Vector3d>(poses_[image].values.data() + 3) = bundle_.poses[image].center;
    UpdateRotation(poses_[image]);
  }

  void AddPoint(size_t p) {
    double* const point = bundle_.points[p].data();
    for (size_t o = bundle_.first_observation[p]; o < bundle_.first_observation[p + 1]; ++o) {
      const BundleObservation& observation = bundle_.observations[o];
      PoseBlock& pose = poses_[observation.image];
      const size_t l = bundle_.poses[observation.image].lens;
      LensBlock& lens = lenses_[l];
      costs_.emplace_back(pose, lens, options_.refine_intrinsics, observation);
      if (options_.refine_intrinsics) {
        lens_used_[l] = true;
        problem_->AddResidualBlock(&costs_.back(), loss_.get(), pose.values.data(), point,
                                   lens.params.data());
      } else {
        problem_->AddResidualBlock(&costs_.back(), loss_.get(), pose.values.data(), point);
      }
    }
  }

  std::shared_ptr<ceres::ParameterBlockOrdering> MakeOrdering() {
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (Eigen::Vector3d& point : bundle_.points) ordering->AddElementToGroup(point.data(), 0);
    for (size_t i = 0; i < poses_.size(); ++i) {
      if (bundle_.poses[i].used) ordering->AddElementToGroup(poses_[i].values.data(), 1);
    }
    for (size_t l = 0; l < lenses_.size(); ++l) {
      if (lens_used_[l]) ordering->AddElementToGroup(lenses_[l].params.data(), 2);
    }
    return ordering;
  }

  void HoldPoses() {
    for (size_t i = 0; i < poses_.size(); ++i) {
      const BundlePose& pose = bundle_.poses[i];
      if (pose.used && !pose.free) problem_->SetParameterBlockConstant(poses_[i].values.data());
    }
    if (!bundle_.scale_gauge) return;
    gauge_ = std::make_unique<ScaleGaugeCost>(*bundle_.scale_gauge);
    problem_->AddResidualBlock(gauge_.get(), nullptr,
                               poses_[bundle_.scale_gauge->image].values.data());
  }

  void HoldLenses() {
    for (size_t l = 0; l < lenses_.size(); ++l) {
      LensBlock& lens = lenses_[l];
      if (!lens_used_[l]) continue;
      const CameraIntrinsics& intrinsics = bundle_.lenses[l];
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

  void Store() {
    for (size_t i = 0; i < poses_.size(); ++i) {
      if (!bundle_.poses[i].used || !bundle_.poses[i].free) continue;
      UpdateRotation(poses_[i]);
      bundle_.poses[i].rotation = Eigen::Quaterniond(poses_[i].rotation).normalized();
      bundle_.poses[i].center = poses_[i].center();
    }
    for (size_t l = 0; l < lenses_.size(); ++l) {
      if (!lens_used_[l]) continue;
      std::vector<double>& params = bundle_.lenses[l].params;
      std::copy_n(lenses_[l].params.begin(), params.size(), params.begin());
    }
  }

  BundleProblem& bundle_;
  const BundleAdjustmentOptions& options_;
  std::unique_ptr<ceres::LossFunction> loss_;
  std::vector<PoseBlock> poses_;  // by ImageId
  std::vector<LensBlock> lenses_;
  std::vector<bool> lens_used_;
  std::deque<ReprojectionCost> costs_;
  std::unique_ptr<ScaleGaugeCost> gauge_;
  std::vector<std::unique_ptr<ceres::Manifold>> manifolds_;
  RotationCache cache_;
  std::unique_ptr<ceres::Problem> problem_;  // last: refers to all of the above
};

}  // namespace

Result<BundleAdjustmentReport> SolveWithCeres(BundleProblem& problem,
                                              const BundleAdjustmentOptions& options,
                                              std::stop_token stop) {
  return CeresAdjustment(problem, options).Solve(std::move(stop));
}

}  // namespace rotunda::sfm
