#include "sfm/absolute_pose.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>

#include "sfm/lo_ransac.h"
#include "sfm/p3p.h"

namespace rotunda::sfm {
namespace {

using Vector7d = Eigen::Matrix<double, 7, 1>;
using Matrix7d = Eigen::Matrix<double, 7, 7>;

/// Loss scale of a refinement over the inliers of threshold t, as a share of t: inliers of a
/// threshold this wide are mostly far below it.
constexpr double kLossShare = 0.25;

double SquaredError_px2(const Eigen::Matrix<double, 3, 4>& cam_from_model, double focal_px,
                        const Eigen::Vector3d& point, const Eigen::Vector2d& ray) {
  const Eigen::Vector3d x = cam_from_model.leftCols<3>() * point + cam_from_model.col(3);
  if (!(x.z() > 0)) return std::numeric_limits<double>::infinity();
  const double inverse_z = 1.0 / x.z();
  const double du = x.x() * inverse_z - ray.x(), dv = x.y() * inverse_z - ray.y();
  return focal_px * focal_px * (du * du + dv * dv);
}

std::vector<size_t> InliersOf(const AbsolutePoseInput& input, const AbsolutePose& pose,
                              double max_error_px) {
  const Eigen::Matrix<double, 3, 4> matrix = pose.cam_from_model.Matrix();
  const double focal_px = input.focal_px * pose.focal_factor;
  std::vector<size_t> inliers;
  for (size_t i = 0; i < input.points.size(); ++i) {
    const Eigen::Vector2d ray = input.normalized[i] / pose.focal_factor;
    if (SquaredError_px2(matrix, focal_px, input.points[i], ray) < max_error_px * max_error_px) {
      inliers.push_back(i);
    }
  }
  return inliers;
}

/// LoRansac's view of the problem, for one focal factor.
class P3pEstimator {
 public:
  using Model = Rigid3;
  static constexpr size_t kSampleSize = 3;

  P3pEstimator(const AbsolutePoseInput& input, double focal_factor, double max_error_px)
      : input_(input), focal_factor_(focal_factor), max_error_px_(max_error_px) {
    for (const Eigen::Vector2d& ray : input.normalized) rays_.push_back(ray / focal_factor);
  }

  size_t size() const { return rays_.size(); }

  void Solve(std::span<const size_t, kSampleSize> sample, std::vector<Rigid3>& poses) const {
    std::array<Eigen::Vector3d, 3> rays, points;
    for (size_t i = 0; i < kSampleSize; ++i) {
      rays[i] = rays_[sample[i]].homogeneous().normalized();
      points[i] = input_.points[sample[i]];
    }
    SolveP3p(rays, points, poses);
  }

  RansacScore Score(const Rigid3& pose, double bail) const {
    const Eigen::Matrix<double, 3, 4> matrix = pose.Matrix();
    const double focal_px = input_.focal_px * focal_factor_;
    const double limit = max_error_px_ * max_error_px_;
    RansacScore score = {0.0, 0};
    for (size_t i = 0; i < rays_.size(); ++i) {
      const double error = SquaredError_px2(matrix, focal_px, input_.points[i], rays_[i]);
      score.inliers += error < limit;
      score.cost += std::min(error, limit);
      if (score.cost > bail) break;
    }
    return score;
  }

  Rigid3 Refine(const Rigid3& pose) const {
    AbsolutePose start = {pose, focal_factor_, {}};
    start.inliers = InliersOf(input_, start, max_error_px_);
    if (start.inliers.size() <= kSampleSize) return pose;
    return RefineAbsolutePose(input_, start, kLossShare * max_error_px_, false).cam_from_model;
  }

 private:
  const AbsolutePoseInput& input_;
  double focal_factor_;
  double max_error_px_;
  std::vector<Eigen::Vector2d> rays_;
};

/// Cost at a pose and, when `hessian` is given, the Gauss-Newton normal equations for
/// (left rotation, translation, log focal factor) under the Cauchy loss.
double NormalEquations(const AbsolutePoseInput& input, const AbsolutePose& pose, double scale_px,
                       Matrix7d* hessian, Vector7d* gradient) {
  const double squared_scale = scale_px * scale_px;
  double cost = 0;
  for (const size_t i : pose.inliers) {
    const Eigen::Vector3d rotated = pose.cam_from_model.rotation * input.points[i];
    const Eigen::Vector3d x = rotated + pose.cam_from_model.translation;
    if (!(x.z() > 0)) continue;
    const double focal_px = input.focal_px * pose.focal_factor;
    const Eigen::Vector2d projected = focal_px * x.hnormalized();
    const Eigen::Vector2d residual = projected - input.focal_px * input.normalized[i];
    const double ratio = residual.squaredNorm() / squared_scale;
    cost += squared_scale * std::log1p(ratio);
    if (!hessian) continue;
    Eigen::Matrix<double, 2, 7> jacobian;
    Eigen::Matrix<double, 2, 3> by_x;
    by_x << focal_px, 0, -projected.x(), 0, focal_px, -projected.y();
    by_x /= x.z();
    jacobian.leftCols<3>() = -by_x * CrossMatrix(rotated);
    jacobian.middleCols<3>(3) = by_x;
    jacobian.col(6) = projected;
    const double weight = 1.0 / (1.0 + ratio);
    hessian->noalias() += weight * jacobian.transpose() * jacobian;
    gradient->noalias() += weight * jacobian.transpose() * residual;
  }
  return cost;
}

AbsolutePose Stepped(const AbsolutePose& pose, const Vector7d& step) {
  AbsolutePose next = pose;
  const double angle = step.head<3>().norm();
  const Eigen::Vector3d axis = angle > 0 ? Eigen::Vector3d(step.head<3>() / angle)
                                         : Eigen::Vector3d(Eigen::Vector3d::UnitX());
  next.cam_from_model.rotation =
      (Eigen::AngleAxisd(angle, axis) * pose.cam_from_model.rotation).normalized();
  next.cam_from_model.translation += step.segment<3>(3);
  next.focal_factor *= std::exp(step(6));
  return next;
}

}  // namespace

AbsolutePose RefineAbsolutePose(const AbsolutePoseInput& input, const AbsolutePose& start,
                                double scale_px, bool refine_focal) {
  constexpr int kMaxIterations = 25;
  constexpr double kConverged = 1e-12;  // relative step
  AbsolutePose pose = start;
  double damping = 1e-6;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    Matrix7d hessian = Matrix7d::Zero();
    Vector7d gradient = Vector7d::Zero();
    const double cost = NormalEquations(input, pose, scale_px, &hessian, &gradient);
    if (!refine_focal) {
      hessian.row(6).setZero();
      hessian.col(6).setZero();
      hessian(6, 6) = 1.0;
      gradient(6) = 0.0;
    }
    Matrix7d damped = hessian;
    damped.diagonal() *= 1.0 + damping;
    const Vector7d step = -damped.ldlt().solve(gradient);
    if (!step.allFinite()) break;
    const AbsolutePose next = Stepped(pose, step);
    if (NormalEquations(input, next, scale_px, nullptr, nullptr) > cost) {
      damping *= 10.0;
      if (damping > 1e6) break;
      continue;
    }
    pose = next;
    damping = std::max(1e-9, 0.1 * damping);
    if (step.norm() < kConverged * (1.0 + pose.cam_from_model.translation.norm())) break;
  }
  return pose;
}

Result<AbsolutePose> EstimateAbsolutePose(const AbsolutePoseInput& input,
                                          const AbsolutePoseOptions& options) {
  std::optional<AbsolutePose> best;
  double best_cost = std::numeric_limits<double>::infinity();
  for (size_t f = 0; f < options.focal_factors.size(); ++f) {
    const double factor = options.focal_factors[f];
    const P3pEstimator estimator(input, factor, options.max_error_px);
    RansacOptions ransac;
    ransac.confidence = options.confidence;
    ransac.max_iterations = options.max_iterations;
    ransac.min_inlier_ratio = options.min_inlier_ratio;
    ransac.seed = options.seed;
    const auto found = LoRansac(estimator, ransac);
    if (!found || !(found->score.cost < best_cost)) continue;
    best_cost = found->score.cost;
    best = AbsolutePose{found->model, factor, {}};
  }
  if (!best) {
    return Error{ErrorCode::kFailed,
                 "no pose found from " + std::to_string(input.points.size()) + " points", ""};
  }
  best->inliers = InliersOf(input, *best, options.max_error_px);
  if (best->inliers.size() > P3pEstimator::kSampleSize) {
    *best = RefineAbsolutePose(input, *best, kLossShare * options.max_error_px,
                               options.focal_factors.size() > 1);
    best->inliers = InliersOf(input, *best, options.max_error_px);
  }
  return *std::move(best);
}

}  // namespace rotunda::sfm
