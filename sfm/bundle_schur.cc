#include "sfm/bundle_schur.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

namespace rotunda::sfm {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Matrix36d = Eigen::Matrix<double, 3, 6>;

/// Partial sums. Fixed, so that the sum does not depend on the number of threads.
constexpr size_t kChunks = 8;
/// Trust region as in Ceres 2.1, whose defaults suit bundle adjustment: the first radius, the least
/// share of the predicted decrease that must come true, and when a step or the region is too small
/// to go on.
constexpr double kFirstRadius = 1e4;
constexpr double kMaxRadius = 1e16;
constexpr double kMinRadius = 1e-32;
constexpr double kMinGain = 1e-3;
constexpr double kStepTolerance = 1e-8;
/// Keeps the damping of what nothing holds above zero.
constexpr double kMinDiagonal = 1e-12;
constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();
constexpr size_t kHeld = std::numeric_limits<size_t>::max();

/// rho(s) of a squared residual s, and its derivative.
struct LossValue {
  double rho, weight;
};

LossValue LossOf(Loss loss, double scale, double squared) {
  const double b = scale * scale;
  switch (loss) {
    case Loss::kNone:
      break;
    case Loss::kSoftL1: {
      const double root = std::sqrt(1.0 + squared / b);
      return {2.0 * b * (root - 1.0), 1.0 / root};
    }
    case Loss::kCauchy:
      return {b * std::log1p(squared / b), 1.0 / (1.0 + squared / b)};
  }
  return {squared, 1.0};
}

/// The part of the normal equations that one pose or point has of its own.
template <int N>
struct Normal {
  Eigen::Matrix<double, N, N> matrix = Eigen::Matrix<double, N, N>::Zero();
  Eigen::Matrix<double, N, 1> gradient = Eigen::Matrix<double, N, 1>::Zero();

  void Add(const Eigen::Matrix<double, 2, N>& jacobian, const Eigen::Vector2d& residual) {
    matrix.noalias() += jacobian.transpose() * jacobian;
    gradient.noalias() += jacobian.transpose() * residual;
  }
  Normal& operator+=(const Normal& other) {
    matrix += other.matrix;
    gradient += other.gradient;
    return *this;
  }
  Eigen::Matrix<double, N, 1> Damping(double radius) const {
    return matrix.diagonal().cwiseMax(kMinDiagonal) / radius;
  }
  /// This block's share of the decrease that the model of the cost foretells.
  double Predicted(const Eigen::Matrix<double, N, 1>& step, double radius) const {
    return 0.5 * step.dot(Damping(radius).cwiseProduct(step) - gradient);
  }
};

/// The lower triangle of the reduced camera matrix in blocks of 6x6, row by row, and its right
/// side.
struct ReducedSystem {
  std::vector<Matrix6d> blocks;
  std::vector<Vector6d> right;
  bool ok = true;

  static size_t Place(size_t row, size_t column) { return row * (row + 1) / 2 + column; }

  void Clear(size_t cameras) {
    blocks.assign(Place(cameras, 0), Matrix6d::Zero());
    right.assign(cameras, Vector6d::Zero());
    ok = true;
  }
  void Add(const ReducedSystem& other) {
    for (size_t i = 0; i < blocks.size(); ++i) blocks[i] += other.blocks[i];
    for (size_t i = 0; i < right.size(); ++i) right[i] += other.right[i];
    ok = ok && other.ok;
  }
};

class PointElimination {
 public:
  PointElimination(BundleProblem& problem, const BundleAdjustmentOptions& options,
                   RunContext& context)
      : problem_(problem), options_(options), context_(context) {
    camera_of_.assign(problem.poses.size(), kHeld);
    for (size_t i = 0; i < problem.poses.size(); ++i) {
      if (!problem.poses[i].free || !problem.poses[i].used) continue;
      camera_of_[i] = images_.size();
      images_.push_back(i);
    }
    coupling_.resize(problem.observations.size());
    point_normals_.resize(problem.points.size());
    for (size_t chunk = 0; chunk <= kChunks; ++chunk) chunk_[chunk] = ChunkBegin(chunk);
  }

  Result<BundleAdjustmentReport> Solve() {
    BundleAdjustmentReport report;
    double cost = Linearize();
    report.initial_cost = cost;
    if (!std::isfinite(cost)) {
      return Error{ErrorCode::kFailed, "a residual is not finite", "bundle adjustment"};
    }
    double radius = kFirstRadius, shrink = 2.0;
    while (!report.converged && report.iterations < options_.max_iterations) {
      if (context_.Stopped()) return Error{ErrorCode::kCancelled, "cancelled", "bundle adjustment"};
      ++report.iterations;
      const Step step = TakeStep(radius);
      if (!step.solved && radius < kMinRadius) {
        return Error{ErrorCode::kFailed, "the normal equations cannot be solved, however damped",
                     "bundle adjustment"};
      }
      const double decrease = step.solved ? cost - Cost() : kNoNumber;
      report.converged = std::abs(decrease) <= options_.function_tolerance * cost ||
                         step.IsNegligible() || radius < kMinRadius;
      const double gain = decrease / step.predicted;
      if (gain > kMinGain) {
        const double growth = std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * gain - 1.0, 3));
        radius = std::min(kMaxRadius, radius / growth);
        shrink = 2.0;
        cost = report.converged ? cost - decrease : Linearize();
      } else {
        problem_.poses.swap(poses_before_);
        problem_.points.swap(points_before_);
        radius /= shrink;
        shrink *= 2.0;
      }
    }
    report.final_cost = cost;
    return report;
  }

 private:
  /// Sums over cameras and points.
  struct Step {
    bool solved = false;
    double predicted = 0;  // decrease of the cost
    double squared_length = 0;
    double squared_size = 0;  // of what was moved

    bool IsNegligible() const {
      return solved && squared_length <= kStepTolerance * kStepTolerance * squared_size;
    }
    void Add(const Step& other) {
      predicted += other.predicted;
      squared_length += other.squared_length;
      squared_size += other.squared_size;
    }
  };

  /// Parts of about as many observations each.
  size_t ChunkBegin(size_t chunk) const {
    const auto& first = problem_.first_observation;
    const size_t target = chunk * problem_.observations.size() / kChunks;
    return static_cast<size_t>(std::lower_bound(first.begin(), first.end() - 1, target) -
                               first.begin());
  }

  /// body(chunk, point) for all points.
  template <typename Body>
  void ForPoints(const Body& body) {
    context_.threads.ParallelFor(kChunks, [&](size_t chunk) {
      for (size_t p = chunk_[chunk]; p < chunk_[chunk + 1]; ++p) body(chunk, p);
    });
  }

  void UpdateRotations() {
    rotations_.resize(problem_.poses.size());
    for (size_t i = 0; i < rotations_.size(); ++i) {
      if (problem_.poses[i].used) rotations_[i] = problem_.poses[i].rotation.toRotationMatrix();
    }
  }

  double GaugeCost() const {
    if (!problem_.scale_gauge) return 0.0;
    const ScaleGauge& gauge = *problem_.scale_gauge;
    const double residual = gauge.Residual(problem_.poses[gauge.image].center);
    return 0.5 * residual * residual;
  }

  /// Half the sum of the losses.
  double Cost() {
    UpdateRotations();
    std::array<double, kChunks> sums = {};
    ForPoints([&](size_t chunk, size_t p) {
      for (size_t o = problem_.first_observation[p]; o < problem_.first_observation[p + 1]; ++o) {
        const BundleObservation& seen = problem_.observations[o];
        const BundlePose& pose = problem_.poses[seen.image];
        const CameraIntrinsics& lens = problem_.lenses[pose.lens];
        const Eigen::Vector3d x = rotations_[seen.image] * (problem_.points[p] - pose.center);
        Eigen::Vector2d pixel;
        DistortToPixel(lens.model, lens.params.data(), x.x() / x.z(), x.y() / x.z(), &pixel.x(),
                       &pixel.y());
        const double squared = ((pixel - seen.pixel) * seen.inverse_sigma).squaredNorm();
        sums[chunk] += 0.5 * LossOf(options_.loss, options_.loss_scale, squared).rho;
      }
    });
    double cost = GaugeCost();
    for (const double sum : sums) cost += sum;
    return cost;
  }

  /// The normal equations where the problem stands; returns the cost there.
  double Linearize() {
    UpdateRotations();
    std::array<double, kChunks> sums = {};
    for (auto& normals : camera_parts_) normals.assign(images_.size(), {});
    ForPoints([&](size_t chunk, size_t p) { sums[chunk] += LinearizePoint(chunk, p); });
    camera_normals_ = camera_parts_[0];
    double cost = sums[0] + GaugeCost();
    for (size_t chunk = 1; chunk < kChunks; ++chunk) {
      cost += sums[chunk];
      for (size_t c = 0; c < images_.size(); ++c) camera_normals_[c] += camera_parts_[chunk][c];
    }
    if (problem_.scale_gauge) {
      const ScaleGauge& gauge = *problem_.scale_gauge;
      Normal<6>& normal = camera_normals_[camera_of_[gauge.image]];
      const Eigen::Vector3d by_center = gauge.Gradient();
      normal.matrix.bottomRightCorner<3, 3>() += by_center * by_center.transpose();
      normal.gradient.tail<3>() += by_center * gauge.Residual(problem_.poses[gauge.image].center);
    }
    return cost;
  }

  double LinearizePoint(size_t chunk, size_t p) {
    Normal<3> of_point;
    double cost = 0;
    for (size_t o = problem_.first_observation[p]; o < problem_.first_observation[p + 1]; ++o) {
      const BundleObservation& seen = problem_.observations[o];
      const BundlePose& pose = problem_.poses[seen.image];
      const CameraIntrinsics& lens = problem_.lenses[pose.lens];
      const Eigen::Matrix3d& rotation = rotations_[seen.image];
      const Eigen::Vector3d x = rotation * (problem_.points[p] - pose.center);
      ProjectionJacobian projection;
      ProjectWithJacobian(lens.model, lens.params.data(), x, false, projection);
      Eigen::Vector2d residual = seen.inverse_sigma * (projection.pixel - seen.pixel);
      const LossValue loss = LossOf(options_.loss, options_.loss_scale, residual.squaredNorm());
      cost += 0.5 * loss.rho;
      const double root = std::sqrt(loss.weight);
      residual *= root;
      const Eigen::Matrix<double, 2, 3> by_x = root * seen.inverse_sigma * projection.by_point;
      const Eigen::Matrix<double, 2, 3> by_point = by_x * rotation;
      of_point.Add(by_point, residual);
      if (camera_of_[seen.image] == kHeld) continue;
      Eigen::Matrix<double, 2, 6> by_pose;
      by_pose.leftCols<3>().noalias() = -by_x * CrossMatrix(x);
      by_pose.rightCols<3>() = -by_point;
      camera_parts_[chunk][camera_of_[seen.image]].Add(by_pose, residual);
      coupling_[o].noalias() = by_point.transpose() * by_pose;
    }
    point_normals_[p] = of_point;
    return cost;
  }

  /// Cholesky factor of a point's damped normal matrix.
  Eigen::LLT<Eigen::Matrix3d> Factor(size_t p, double radius) const {
    Eigen::Matrix3d damped = point_normals_[p].matrix;
    damped.diagonal() += point_normals_[p].Damping(radius);
    return Eigen::LLT<Eigen::Matrix3d>(damped);
  }

  /// Takes what the point explains off the camera system.
  void EliminatePoint(size_t chunk, size_t p, double radius) {
    ReducedSystem& system = systems_[chunk];
    const Eigen::LLT<Eigen::Matrix3d> factor = Factor(p, radius);
    if (factor.info() != Eigen::Success) system.ok = false;
    const Eigen::Matrix3d inverse_factor =
        factor.matrixL().solve(Eigen::Matrix3d(Eigen::Matrix3d::Identity()));
    const Eigen::Vector3d gradient = inverse_factor * point_normals_[p].gradient;
    const size_t begin = problem_.first_observation[p], end = problem_.first_observation[p + 1];
    std::vector<std::pair<size_t, Matrix36d>>& reduced = reduced_[chunk];
    reduced.clear();
    for (size_t o = begin; o < end; ++o) {
      const size_t camera = camera_of_[problem_.observations[o].image];
      if (camera == kHeld) continue;
      reduced.emplace_back(camera, inverse_factor * coupling_[o]);
      const Matrix36d& row = reduced.back().second;
      system.right[camera].noalias() += row.transpose() * gradient;
      for (const auto& [other, column] : reduced) {
        system.blocks[ReducedSystem::Place(camera, other)].noalias() -= row.transpose() * column;
      }
    }
  }

  /// The cameras' step; nothing when the system cannot be solved.
  std::optional<Eigen::VectorXd> SolveCameras(double radius) {
    for (ReducedSystem& system : systems_) system.Clear(images_.size());
    ForPoints([&](size_t chunk, size_t p) { EliminatePoint(chunk, p, radius); });
    ReducedSystem& sum = systems_[0];
    for (size_t chunk = 1; chunk < kChunks; ++chunk) sum.Add(systems_[chunk]);
    const auto size = static_cast<Eigen::Index>(6 * images_.size());
    Eigen::MatrixXd matrix(size, size);
    Eigen::VectorXd right(size);
    for (size_t row = 0; row < images_.size(); ++row) {
      const Normal<6>& normal = camera_normals_[row];
      const auto r = static_cast<Eigen::Index>(6 * row);
      for (size_t column = 0; column <= row; ++column) {
        matrix.block<6, 6>(r, static_cast<Eigen::Index>(6 * column)) =
            sum.blocks[ReducedSystem::Place(row, column)];
      }
      matrix.block<6, 6>(r, r) += normal.matrix;
      matrix.block<6, 6>(r, r).diagonal() += normal.Damping(radius);
      right.segment<6>(r) = sum.right[row] - normal.gradient;
    }
    const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> factor(matrix);
    if (!sum.ok || factor.info() != Eigen::Success) return std::nullopt;
    Eigen::VectorXd step = factor.solve(right);
    if (!step.allFinite()) return std::nullopt;
    return step;
  }

  /// Moves the problem by one damped step; where it stood is kept aside.
  Step TakeStep(double radius) {
    poses_before_ = problem_.poses;
    points_before_ = problem_.points;
    const std::optional<Eigen::VectorXd> step = SolveCameras(radius);
    Step sum;
    if (!step) return sum;
    sum.solved = true;
    std::array<Step, kChunks> parts;
    ForPoints([&](size_t chunk, size_t p) { MovePoint(p, *step, radius, parts[chunk]); });
    for (const Step& part : parts) sum.Add(part);
    for (size_t c = 0; c < images_.size(); ++c) {
      const Vector6d moved = step->segment<6>(static_cast<Eigen::Index>(6 * c));
      BundlePose& pose = problem_.poses[images_[c]];
      const Eigen::Vector3d turn = moved.head<3>();
      const Eigen::Quaterniond turned(
          Eigen::AngleAxisd(turn.norm(), turn.norm() > 0 ? turn.normalized() : turn));
      pose.rotation = (turned * pose.rotation).normalized();
      pose.center += moved.tail<3>();
      sum.Add({true, camera_normals_[c].Predicted(moved, radius), moved.squaredNorm(),
               pose.center.squaredNorm()});
    }
    return sum;
  }

  void MovePoint(size_t p, const Eigen::VectorXd& camera_step, double radius, Step& sum) {
    Eigen::Vector3d right = -point_normals_[p].gradient;
    for (size_t o = problem_.first_observation[p]; o < problem_.first_observation[p + 1]; ++o) {
      const size_t camera = camera_of_[problem_.observations[o].image];
      if (camera == kHeld) continue;
      right.noalias() -=
          coupling_[o] * camera_step.segment<6>(static_cast<Eigen::Index>(6 * camera));
    }
    const Eigen::Vector3d moved = Factor(p, radius).solve(right);
    problem_.points[p] += moved;
    sum.Add({true, point_normals_[p].Predicted(moved, radius), moved.squaredNorm(),
             problem_.points[p].squaredNorm()});
  }

  BundleProblem& problem_;
  const BundleAdjustmentOptions& options_;
  RunContext& context_;
  std::vector<size_t> camera_of_;               // by ImageId; kHeld: does not move
  std::vector<size_t> images_;                  // of the cameras that move
  std::array<size_t, kChunks + 1> chunk_ = {};  // first point of each
  std::vector<Eigen::Matrix3d> rotations_;      // by ImageId
  std::vector<Matrix36d> coupling_;             // by observation: J_point^T J_pose
  std::vector<Normal<3>> point_normals_;
  std::vector<Normal<6>> camera_normals_;
  std::array<std::vector<Normal<6>>, kChunks> camera_parts_;
  std::array<ReducedSystem, kChunks> systems_;
  std::array<std::vector<std::pair<size_t, Matrix36d>>, kChunks> reduced_;  // of the point at hand
  std::vector<BundlePose> poses_before_;
  std::vector<Eigen::Vector3d> points_before_;
};

}  // namespace

Result<BundleAdjustmentReport> SolveByPointElimination(BundleProblem& problem,
                                                       const BundleAdjustmentOptions& options,
                                                       RunContext& context) {
  return PointElimination(problem, options, context).Solve();
}

}  // namespace rotunda::sfm
