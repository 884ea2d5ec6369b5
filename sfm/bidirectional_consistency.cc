#include "sfm/bidirectional_consistency.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>

#include "sfm/solver_stop.h"

namespace rotunda::sfm {
namespace {

/// Distances above it count linearly. Relative poses of two views are off by pixels, not by
/// fractions of one.
constexpr double kHuber_px = 4.0;
/// Points over all links, shared out evenly, but no link less than its least and more than its
/// most: seven unknowns are settled by them, and a link's points say nearly the same.
constexpr size_t kMaxPoints = 8000;
constexpr size_t kLeastPointsPerLink = 8;
constexpr size_t kMostPointsPerLink = 100;
constexpr int kMaxIterations = 50;

/// The unknowns: w, translation, log(scale); x_target = scale exp(w) R0 x_source + translation.
using SimilarityBlock = std::array<double, 7>;

Sim3 FromBlock(const SimilarityBlock& block, const Eigen::Quaterniond& start) {
  std::array<double, 4> wxyz;
  ceres::AngleAxisToQuaternion(block.data(), wxyz.data());
  const Eigen::Quaterniond step(wxyz[0], wxyz[1], wxyz[2], wxyz[3]);
  return {std::exp(block[6]), (step * start).normalized(), {block[3], block[4], block[5]}};
}

template <typename T>
Eigen::Matrix<T, 3, 1> Rotated(const T* angle_axis, const Eigen::Matrix<T, 3, 1>& x) {
  Eigen::Matrix<T, 3, 1> rotated;
  ceres::AngleAxisRotatePoint(angle_axis, x.data(), rotated.data());
  return rotated;
}

/// A point of one model on its way into a camera of the other.
struct Transfer {
  bool forward = true;       // from the source model into a camera of the target
  Eigen::Vector3d point;     // forward: R0 x_source; backward: x_target
  Eigen::Matrix3d rotation;  // of the camera; backward: times R0^T
  Eigen::Vector3d translation;
  const CameraIntrinsics* lens = nullptr;

  /// The point in the camera by the similarity; backward in the target's unit.
  template <typename T>
  Eigen::Matrix<T, 3, 1> InCamera(const T* similarity) const {
    using Vector = Eigen::Matrix<T, 3, 1>;
    const Eigen::Map<const Vector> shift(similarity + 3);
    const T scale = exp(similarity[6]);
    if (forward) {
      const Vector x = scale * Rotated<T>(similarity, point.cast<T>()) + shift;
      return rotation.cast<T>() * x + translation.cast<T>();
    }
    const std::array<T, 3> inverse = {-similarity[0], -similarity[1], -similarity[2]};
    const Vector x = Rotated<T>(inverse.data(), point.cast<T>() - shift);
    return rotation.cast<T>() * x + scale * translation.cast<T>();
  }
};

template <typename T>
bool ProjectTo(const CameraIntrinsics& lens, const Eigen::Matrix<T, 3, 1>& x_in_cam, T* pixel) {
  if (x_in_cam[2] <= T(0)) return false;
  std::array<T, kMaxCameraParams> params;
  std::transform(lens.params.begin(), lens.params.end(), params.begin(),
                 [](double param) { return T(param); });
  const T u = x_in_cam[0] / x_in_cam[2], v = x_in_cam[1] / x_in_cam[2];
  DistortToPixel<T>(lens.model, params.data(), u, v, pixel, pixel + 1);
  return true;
}

/// Projection through the similarity - a pixel.
struct PixelCost {
  Transfer transfer;
  Eigen::Vector2d pixel;

  template <typename T>
  bool operator()(const T* similarity, T* residual) const {
    if (!ProjectTo<T>(*transfer.lens, transfer.InCamera(similarity), residual)) return false;
    residual[0] -= pixel.x();
    residual[1] -= pixel.y();
    return true;
  }
};

/// Projection through the similarity - projection through the relative pose of a pair:
/// forward scale y + lambda t_ij, y = R_ij (R_i p + t_i); backward y - lambda t, y and t the
/// target camera's p and t_ij seen with the source camera's axes.
struct PairCost {
  Transfer transfer;
  Eigen::Vector3d turned;    // y
  Eigen::Vector3d baseline;  // t_ij; backward: -R_ij^T t_ij

  template <typename T>
  bool operator()(const T* similarity, const T* log_lambda, T* residual) const {
    const T scale = transfer.forward ? exp(similarity[6]) : T(1);
    const Eigen::Matrix<T, 3, 1> x =
        scale * turned.cast<T>() + exp(log_lambda[0]) * baseline.cast<T>();
    std::array<T, 2> by_pair;
    if (!ProjectTo<T>(*transfer.lens, transfer.InCamera(similarity), residual)) return false;
    if (!ProjectTo<T>(*transfer.lens, x, by_pair.data())) return false;
    residual[0] -= by_pair[0];
    residual[1] -= by_pair[1];
    return true;
  }
};

class ConsistencyProblem {
 public:
  ConsistencyProblem(const ConsistencyInput& input, const Sim3& start, double reprojection_weight)
      : input_(input), start_(start), reprojection_weight_(reprojection_weight) {
    const Eigen::Vector3d& t = start.translation;
    points_per_link_ = std::clamp(kMaxPoints / std::max<size_t>(input.links.size(), 1),
                                  kLeastPointsPerLink, kMostPointsPerLink);
    similarity_ = {0, 0, 0, t.x(), t.y(), t.z(), std::log(start.scale)};
    log_lambdas_.resize(input.links.size(), 0.0);
    for (size_t k = 0; k < input.links.size(); ++k) AddLink(input.links[k], log_lambdas_[k]);
  }

  Consistency Cost() {
    Consistency result = {FromBlock(similarity_, start_.rotation), 0, 0};
    if (weight_sum_ == 0) {
      result.mean_cost_px2 = std::numeric_limits<double>::infinity();
      return result;
    }
    double half = 0;
    problem_.Evaluate({}, &half, nullptr, nullptr, nullptr);
    result.cost_px2 = 2.0 * half;
    result.mean_cost_px2 = result.cost_px2 / weight_sum_;
    return result;
  }

  /// Leaves the start where the solver finds nothing better, or is stopped.
  void Solve(std::stop_token stop) {
    if (weight_sum_ == 0) return;
    ceres::Solver::Options options;
    options.num_threads = 1;
    options.logging_type = ceres::SILENT;
    options.max_num_iterations = kMaxIterations;
    options.function_tolerance = 1e-7;
    options.linear_solver_type = ceres::DENSE_SCHUR;
    options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    bool any_lambda = false;
    for (double& log_lambda : log_lambdas_) {
      if (!problem_.HasParameterBlock(&log_lambda)) continue;
      options.linear_solver_ordering->AddElementToGroup(&log_lambda, 0);
      any_lambda = true;
    }
    options.linear_solver_ordering->AddElementToGroup(similarity_.data(), any_lambda ? 1 : 0);
    if (!any_lambda) options.linear_solver_type = ceres::DENSE_QR;
    const std::unique_ptr<ceres::IterationCallback> stopper =
        StopBetweenIterations(std::move(stop));
    options.callbacks.push_back(stopper.get());
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem_, &summary);
  }

 private:
  Transfer Forward(const ModelLink& link, size_t source_point) const {
    const Rigid3& camera = *input_.target.cam_from_model[link.target.index()];
    return {true, start_.rotation * input_.source.points[source_point].position,
            camera.RotationMatrix(), camera.translation, &input_.target.intrinsics.of(link.target)};
  }
  Transfer Backward(const ModelLink& link, size_t target_point) const {
    const Rigid3& camera = *input_.source.cam_from_model[link.source.index()];
    return {false, input_.target.points[target_point].position,
            (camera.rotation * start_.rotation.conjugate()).toRotationMatrix(), camera.translation,
            &input_.source.intrinsics.of(link.source)};
  }

  void AddLink(const ModelLink& link, double& log_lambda) {
    const Rigid3& source_cam = *input_.source.cam_from_model[link.source.index()];
    const Rigid3& target_cam = *input_.target.cam_from_model[link.target.index()];
    const Eigen::Vector3d offset =
        target_cam * (start_ * source_cam.OriginInSource());  // lambda t_ij where all agrees
    const Rigid3& relative = link.target_cam_from_source_cam;
    const double lambda = offset.dot(relative.translation);
    if (!link.CommonCamera() && !(lambda > 0)) return;
    if (!link.CommonCamera()) log_lambda = std::log(lambda);
    const Eigen::Vector3d back = -(relative.rotation.conjugate() * relative.translation);
    const size_t step = (link.points.size() + points_per_link_ - 1) / points_per_link_;
    for (size_t p = 0; p < link.points.size(); p += step) {
      const LinkedPoint& point = link.points[p];
      if (point.source_point) {
        const Eigen::Vector3d& x = input_.source.points[*point.source_point].position;
        AddTerms(link,
                 {Forward(link, *point.source_point), relative.rotation * (source_cam * x),
                  relative.translation},
                 Pixel(link.target, point.target_keypoint), log_lambda);
      }
      if (point.target_point) {
        const Eigen::Vector3d& x = input_.target.points[*point.target_point].position;
        AddTerms(link,
                 {Backward(link, *point.target_point),
                  relative.rotation.conjugate() * (target_cam * x), back},
                 Pixel(link.source, point.source_keypoint), log_lambda);
      }
    }
  }

  Eigen::Vector2d Pixel(ImageId image, KeypointId keypoint) const {
    const Keypoint& k = input_.features.image(image).keypoints[keypoint.index()];
    return {k.x_px, k.y_px};
  }

  /// The terms of a point that is in front of the camera both ways, to begin with.
  void AddTerms(const ModelLink& link, const PairCost& pair, const Eigen::Vector2d& keypoint,
                double& log_lambda) {
    const CameraIntrinsics& lens = *pair.transfer.lens;
    Eigen::Vector2d by_pair, by_similarity;
    const Eigen::Vector3d x = pair.transfer.InCamera(similarity_.data());
    if (!ProjectTo<double>(lens, x, by_similarity.data())) return;
    if (link.CommonCamera()) {
      if (!ProjectTo<double>(lens, pair.turned, by_pair.data())) return;
      AddPixelCost({pair.transfer, by_pair}, link.weight);
    } else {
      const double scale = pair.transfer.forward ? start_.scale : 1.0;
      const Eigen::Vector3d q = scale * pair.turned + std::exp(log_lambda) * pair.baseline;
      if (!ProjectTo<double>(lens, q, by_pair.data())) return;
      problem_.AddResidualBlock(
          new ceres::AutoDiffCostFunction<PairCost, 2, 7, 1>(new PairCost(pair)),
          WeightedLoss(link.weight), similarity_.data(), &log_lambda);
    }
    if (reprojection_weight_ > 0) {
      AddPixelCost({pair.transfer, keypoint}, reprojection_weight_ * link.weight);
    }
  }

  void AddPixelCost(const PixelCost& cost, double weight) {
    problem_.AddResidualBlock(new ceres::AutoDiffCostFunction<PixelCost, 2, 7>(new PixelCost(cost)),
                              WeightedLoss(weight), similarity_.data());
  }

  /// The problem owns it.
  ceres::LossFunction* WeightedLoss(double weight) {
    weight_sum_ += weight;
    return new ceres::ScaledLoss(new ceres::HuberLoss(kHuber_px), weight, ceres::TAKE_OWNERSHIP);
  }

  const ConsistencyInput& input_;
  Sim3 start_;
  double reprojection_weight_;
  size_t points_per_link_ = 0;
  SimilarityBlock similarity_;
  std::vector<double> log_lambdas_;  // by link
  double weight_sum_ = 0;
  ceres::Problem problem_;
};

}  // namespace

Consistency MinimiseInconsistency(const ConsistencyInput& input, const Sim3& target_from_source,
                                  const ConsistencyOptions& options, std::stop_token stop) {
  ConsistencyProblem problem(input, target_from_source, options.reprojection_weight);
  if (options.optimise) problem.Solve(std::move(stop));
  return problem.Cost();
}

}  // namespace rotunda::sfm
