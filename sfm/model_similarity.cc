#include "sfm/model_similarity.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "sfm/core/run_context.h"
#include "sfm/core/statistics.h"

namespace rotunda::sfm {
namespace {

/// Points seen by both models that a link's own scale needs.
constexpr size_t kMinScalePoints = 5;
constexpr size_t kMaxLinkPairs = 1000;
constexpr int kIterations = 30;
/// Errors below it weigh alike in L1 averaging: two-view geometry is no better.
constexpr double kFloor_rad = 1e-3;
/// Reciprocal condition below which two links do not determine scale and translation.
constexpr double kMinReciprocalCondition = 1e-6;

/// One link as equations: translation + scale (rotation source_center) lies at target_center, or
/// from there in `direction`.
struct Constraint {
  double weight = 0;
  bool common_camera = false;
  Eigen::Quaterniond target_from_source;
  Eigen::Vector3d source_center, target_center;
  Eigen::Vector3d direction;    // of a cross pair, unit, target frame
  double depth = 0;             // of a common camera: median depth of its points, target's unit
  std::optional<double> scale;  // from points that both models see
  double lambda = 0;            // where there is a scale: distance of the cameras, target's unit
};

/// Scale and translation; the rotation is settled before.
struct Placement {
  double scale = 1.0;
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
};

/// Weights of a link's rows: its baseline's and its own scale's.
struct RowWeights {
  double baseline = 0;
  double scale = 0;
};

/// Medians of scale and lambda over the points that both models see, each by least squares on
/// scale R_ij (R_i p_a + t_i) + lambda t_ij = R_j p_b + t_j (eq. 3), both positive.
void ScaleFromPoints(const ModelLink& link, const Reconstruction& source,
                     const Reconstruction& target, Constraint& constraint) {
  const Rigid3& source_cam = *source.cam_from_model[link.source.index()];
  const Rigid3& target_cam = *target.cam_from_model[link.target.index()];
  const Rigid3& relative = link.target_cam_from_source_cam;
  std::vector<double> scales, lambdas;
  for (const LinkedPoint& point : link.points) {
    if (!point.source_point || !point.target_point) continue;
    const Eigen::Vector3d a =
        relative.rotation * (source_cam * source.points[*point.source_point].position);
    const Eigen::Vector3d b = target_cam * target.points[*point.target_point].position;
    Eigen::Vector2d solution(a.dot(b) / a.squaredNorm(), 0.0);
    if (!link.CommonCamera()) {
      Eigen::Matrix<double, 3, 2> matrix;
      matrix << a, relative.translation;
      solution = (matrix.transpose() * matrix).inverse() * (matrix.transpose() * b);
      if (!(solution[1] > 0)) continue;
    }
    if (!(solution[0] > 0)) continue;
    scales.push_back(solution[0]);
    lambdas.push_back(solution[1]);
  }
  if (scales.size() < kMinScalePoints) return;
  constraint.scale = Median(std::move(scales));
  constraint.lambda = Median(std::move(lambdas));
}

Constraint MakeConstraint(const ModelLink& link, const Reconstruction& source,
                          const Reconstruction& target) {
  const Rigid3& source_cam = *source.cam_from_model[link.source.index()];
  const Rigid3& target_cam = *target.cam_from_model[link.target.index()];
  Constraint constraint;
  constraint.weight = link.weight;
  constraint.common_camera = link.CommonCamera();
  constraint.target_from_source = (target_cam.rotation.conjugate() *
                                   link.target_cam_from_source_cam.rotation * source_cam.rotation)
                                      .normalized();
  constraint.source_center = source_cam.OriginInSource();
  constraint.target_center = target_cam.OriginInSource();
  constraint.direction =
      target_cam.rotation.conjugate() * link.target_cam_from_source_cam.translation;
  if (link.CommonCamera()) {
    std::vector<double> depths;
    for (const LinkedPoint& point : link.points) {
      if (!point.target_point) continue;
      depths.push_back(std::abs((target_cam * target.points[*point.target_point].position).z()));
    }
    constraint.depth = Median(std::move(depths));
  }
  ScaleFromPoints(link, source, target, constraint);
  return constraint;
}

std::vector<Constraint> MakeConstraints(const std::vector<ModelLink>& links,
                                        const Reconstruction& source,
                                        const Reconstruction& target) {
  std::vector<Constraint> constraints;
  for (const ModelLink& link : links) constraints.push_back(MakeConstraint(link, source, target));
  return constraints;
}

/// Votes for one rotation: the weight of all within `radius_rad` of the best of them.
struct Mode {
  double weight = 0;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
};

Mode HeaviestMode(const std::vector<Constraint>& constraints, const std::vector<bool>& allowed,
                  double radius_rad) {
  Mode best;
  for (size_t i = 0; i < constraints.size(); ++i) {
    if (!allowed[i]) continue;
    double weight = 0;
    for (size_t k = 0; k < constraints.size(); ++k) {
      if (allowed[k] && RotationAngle_rad(constraints[i].target_from_source,
                                          constraints[k].target_from_source) <= radius_rad) {
        weight += constraints[k].weight;
      }
    }
    if (weight > best.weight) best = {weight, constraints[i].target_from_source};
  }
  return best;
}

/// log of the rotation as axis times angle, in [0, pi].
Eigen::Vector3d LogRotation(const Eigen::Quaterniond& rotation) {
  const Eigen::AngleAxisd angle_axis(rotation.w() < 0 ? Eigen::Quaterniond(-rotation.coeffs())
                                                      : rotation);
  return angle_axis.angle() * angle_axis.axis();
}

/// L1 mean of the votes within `radius_rad` (Weiszfeld on SO(3): Hartley et al., CVPR 2011).
Eigen::Quaterniond RobustMean(const std::vector<Constraint>& constraints, double radius_rad,
                              Eigen::Quaterniond rotation) {
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    Eigen::Vector3d step = Eigen::Vector3d::Zero();
    double sum = 0;
    for (const Constraint& c : constraints) {
      const Eigen::Vector3d log = LogRotation(c.target_from_source * rotation.conjugate());
      if (log.norm() > radius_rad) continue;
      const double weight = c.weight / std::max(log.norm(), kFloor_rad);
      step += weight * log;
      sum += weight;
    }
    if (sum == 0) break;
    step /= sum;
    const double angle = step.norm();
    if (angle == 0) break;
    rotation = (Eigen::Quaterniond(Eigen::AngleAxisd(angle, step / angle)) * rotation).normalized();
  }
  return rotation;
}

/// Scale and translation under one rotation.
class PlacementSolver {
 public:
  PlacementSolver(const std::vector<Constraint>& constraints, const Eigen::Quaterniond& rotation,
                  const SimilarityOptions& options)
      : constraints_(constraints), options_(options) {
    turned_.resize(constraints.size());
    like_.resize(constraints.size());
    for (size_t k = 0; k < constraints.size(); ++k) {
      turned_[k] = rotation * constraints[k].source_center;
      like_[k] = RotationAngle_rad(constraints[k].target_from_source, rotation) <=
                 options.max_rotation_rad;
    }
  }

  /// The link asks for this rotation.
  bool Like(size_t k) const { return like_[k]; }

  /// Angle between the link's baseline and the one it should have; of a common camera the distance
  /// of its two centres over the depth of what it sees.
  double Error_rad(size_t k, const Placement& placement) const {
    const Constraint& c = constraints_[k];
    const Eigen::Vector3d offset = Offset(k, placement);
    if (c.common_camera) return offset.norm() / c.depth;
    return std::atan2(offset.cross(c.direction).norm(), offset.dot(c.direction));
  }

  std::optional<Placement> Solve(uint64_t seed) const {
    std::optional<Placement> best;
    double best_score = 0;
    for (const Placement& candidate : Candidates(seed)) {
      const double score = Score(candidate);
      if (score <= best_score) continue;
      best_score = score;
      best = candidate;
    }
    for (int iteration = 0; best && iteration < kIterations; ++iteration) {
      const auto next = Reweighted(*best);
      if (!next) break;
      best = next;
    }
    return best;
  }

  /// Standard deviation of log(scale) under the errors of the links that agree.
  double ScaleSigma(const Placement& placement) const {
    Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
    double squares = 0, rows = 0;
    for (size_t k = 0; k < constraints_.size(); ++k) {
      const double error_rad = Error_rad(k, placement);
      if (!like_[k] || error_rad > options_.max_direction_rad) continue;
      normal += Normal(k, UnitWeights(k, placement));
      squares += error_rad * error_rad + std::pow(ScaleError(k, placement), 2);
      rows += constraints_[k].common_camera ? 3 : 2;
      rows += constraints_[k].scale.has_value();
    }
    constexpr double kUnknowns = 4;
    const double variance =
        std::max(squares / std::max(rows - kUnknowns, 1.0), kFloor_rad * kFloor_rad);
    const Eigen::LDLT<Eigen::Matrix3d> by_translation(normal.topLeftCorner<3, 3>());
    const Eigen::Vector3d mixed = normal.topRightCorner<3, 1>();
    const double information = normal(3, 3) - mixed.dot(by_translation.solve(mixed));
    if (!(information > 0)) return std::numeric_limits<double>::infinity();
    return std::sqrt(variance / information) / placement.scale;
  }

 private:
  Eigen::Vector3d Offset(size_t k, const Placement& placement) const {
    return placement.scale * turned_[k] + placement.translation - constraints_[k].target_center;
  }

  double ScaleError(size_t k, const Placement& placement) const {
    const auto& scale = constraints_[k].scale;
    return scale ? std::abs(std::log(*scale / placement.scale)) : 0.0;
  }

  /// What makes an angle of a distance.
  double Reach(size_t k, const Placement& placement) const {
    const Constraint& c = constraints_[k];
    return c.common_camera ? c.depth : Offset(k, placement).norm();
  }

  Eigen::Matrix3d Projector(size_t k) const {
    const Constraint& c = constraints_[k];
    if (c.common_camera) return Eigen::Matrix3d::Identity();
    return Eigen::Matrix3d::Identity() - c.direction * c.direction.transpose();
  }

  /// Normal matrix of one link over (translation, scale).
  Eigen::Matrix4d Normal(size_t k, const RowWeights& weights) const {
    Eigen::Matrix<double, 3, 4> rows;
    const Eigen::Matrix3d projector = Projector(k);
    rows << projector, projector * turned_[k];
    Eigen::Matrix4d normal = weights.baseline * rows.transpose() * rows;
    if (constraints_[k].scale) normal(3, 3) += weights.scale;
    return normal;
  }
  Eigen::Vector4d RightSide(size_t k, const RowWeights& weights) const {
    const Eigen::Vector3d projected =
        weights.baseline * (Projector(k) * constraints_[k].target_center);
    Eigen::Vector4d right;
    right << projected, turned_[k].dot(projected);
    if (constraints_[k].scale) right[3] += weights.scale * *constraints_[k].scale;
    return right;
  }
  /// Rows in units of angle and of log(scale).
  RowWeights UnitWeights(size_t k, const Placement& placement) const {
    const double reach = Reach(k, placement);
    return {1.0 / (reach * reach), 1.0 / (placement.scale * placement.scale)};
  }

  static std::optional<Placement> Solution(const Eigen::Matrix4d& normal,
                                           const Eigen::Vector4d& right) {
    const Eigen::Vector4d unit = normal.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    const Eigen::Matrix4d scaled = unit.asDiagonal() * normal * unit.asDiagonal();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> eigen(scaled);
    if (!(eigen.eigenvalues()[0] > kMinReciprocalCondition * eigen.eigenvalues()[3])) {
      return std::nullopt;
    }
    const Eigen::Vector4d x = unit.cwiseProduct(scaled.ldlt().solve(unit.cwiseProduct(right)));
    if (!(x[3] > 0)) return std::nullopt;
    return Placement{x[3], x.head<3>()};
  }

  std::optional<Placement> FromTwo(size_t i, size_t k) const {
    constexpr RowWeights kBaselines = {1.0, 0.0};
    return Solution(Normal(i, kBaselines) + Normal(k, kBaselines),
                    RightSide(i, kBaselines) + RightSide(k, kBaselines));
  }

  std::optional<Placement> FromOne(size_t k) const {
    const Constraint& c = constraints_[k];
    if (!c.scale) return std::nullopt;
    return Placement{*c.scale, c.target_center + c.lambda * c.direction - *c.scale * turned_[k]};
  }

  std::vector<Placement> Candidates(uint64_t seed) const {
    std::vector<Placement> candidates;
    const auto add = [&](const std::optional<Placement>& candidate) {
      if (candidate) candidates.push_back(*candidate);
    };
    std::vector<size_t> like;
    for (size_t k = 0; k < constraints_.size(); ++k) {
      if (like_[k]) like.push_back(k);
    }
    for (const size_t k : like) add(FromOne(k));
    const size_t n = like.size();
    if (n * (n - std::min<size_t>(n, 1)) / 2 <= kMaxLinkPairs) {
      for (size_t i = 0; i < n; ++i) {
        for (size_t k = i + 1; k < n; ++k) add(FromTwo(like[i], like[k]));
      }
      return candidates;
    }
    std::mt19937_64 random(seed);
    for (size_t trial = 0; trial < kMaxLinkPairs; ++trial) {
      const size_t i = random() % n, k = random() % n;
      if (i != k) add(FromTwo(like[i], like[k]));
    }
    return candidates;
  }

  double Score(const Placement& placement) const {
    double score = 0;
    for (size_t k = 0; k < constraints_.size(); ++k) {
      if (!like_[k]) continue;
      const double ratio = Error_rad(k, placement) / options_.max_direction_rad;
      score += constraints_[k].weight * std::max(0.0, 1.0 - ratio * ratio);
    }
    return score;
  }

  /// Least squares over the links that agree, each weighted by one over its error.
  std::optional<Placement> Reweighted(const Placement& placement) const {
    Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
    Eigen::Vector4d right = Eigen::Vector4d::Zero();
    for (size_t k = 0; k < constraints_.size(); ++k) {
      const double error_rad = Error_rad(k, placement);
      if (!like_[k] || error_rad > options_.max_direction_rad) continue;
      RowWeights weights = UnitWeights(k, placement);
      weights.baseline *= constraints_[k].weight / std::max(error_rad, kFloor_rad);
      weights.scale *= constraints_[k].weight / std::max(ScaleError(k, placement), kFloor_rad);
      normal += Normal(k, weights);
      right += RightSide(k, weights);
    }
    return Solution(normal, right);
  }

  const std::vector<Constraint>& constraints_;
  const SimilarityOptions& options_;
  std::vector<Eigen::Vector3d> turned_;  // rotation * source_center, by constraint
  std::vector<bool> like_;
};

/// Weight of the heaviest group of links that ask for one other rotation. Votes just outside of the
/// radius are the tail of those inside, no group of their own.
double RotationRival(const std::vector<Constraint>& constraints, const Eigen::Quaterniond& rotation,
                     double radius_rad) {
  std::vector<bool> against(constraints.size());
  for (size_t k = 0; k < constraints.size(); ++k) {
    against[k] = RotationAngle_rad(constraints[k].target_from_source, rotation) > 2.0 * radius_rad;
  }
  return HeaviestMode(constraints, against, radius_rad).weight;
}

SimilarityEvidence CountLinks(const std::vector<ModelLink>& links) {
  SimilarityEvidence evidence;
  for (const ModelLink& link : links) {
    ++(link.CommonCamera() ? evidence.common_cameras : evidence.cross_pairs);
  }
  return evidence;
}

std::string Refusal(const SimilarityEvidence& e, const SimilarityOptions& options) {
  const std::string counts = std::to_string(e.agreeing_cameras) + " of " +
                             std::to_string(e.common_cameras) + " common cameras and " +
                             std::to_string(e.agreeing_pairs) + " of " +
                             std::to_string(e.cross_pairs) + " pairs agree";
  if (2 * e.agreeing_cameras + e.agreeing_pairs < options.min_support) {
    return "too little support: " + counts + ", expected " + std::to_string(options.min_support) +
           " (a camera counts twice)";
  }
  if (e.support_weight < options.min_rival_ratio * e.rival_weight) {
    return "contradictory support: " + counts + " with weight " + std::to_string(e.support_weight) +
           ", others agree on something else with weight " + std::to_string(e.rival_weight) +
           ", expected a ratio of " + std::to_string(options.min_rival_ratio);
  }
  if (!(e.scale_sigma <= options.max_scale_sigma)) {
    return "open scale: " + counts + ", but leave log(scale) uncertain by " +
           std::to_string(e.scale_sigma) + ", expected " + std::to_string(options.max_scale_sigma);
  }
  return "";
}

SimilarityVerdict Judge(const std::vector<ModelLink>& links,
                        const std::vector<Constraint>& constraints, const Sim3& similarity,
                        const SimilarityOptions& options) {
  SimilarityVerdict verdict;
  SimilarityEvidence& evidence = verdict.evidence;
  evidence = CountLinks(links);
  verdict.agrees.resize(links.size());
  const PlacementSolver solver(constraints, similarity.rotation, options);
  const Placement placement = {similarity.scale, similarity.translation};
  double elsewhere = 0;  // weight of links with the right rotation and another baseline
  for (size_t k = 0; k < links.size(); ++k) {
    if (!solver.Like(k)) continue;
    verdict.agrees[k] = solver.Error_rad(k, placement) <= options.max_direction_rad;
    if (!verdict.agrees[k]) {
      elsewhere += links[k].weight;
      continue;
    }
    ++(links[k].CommonCamera() ? evidence.agreeing_cameras : evidence.agreeing_pairs);
    evidence.support_weight += links[k].weight;
  }
  evidence.rival_weight = std::max(
      elsewhere, RotationRival(constraints, similarity.rotation, options.max_rotation_rad));
  evidence.scale_sigma = solver.ScaleSigma(placement);
  verdict.refusal = Refusal(evidence, options);
  if (verdict.refusal.empty()) verdict.target_from_source = similarity;
  return verdict;
}

}  // namespace

Status SimilarityOptions::Validate() const {
  const auto bad = [](const char* field, double value, const char* expected) {
    return Error{ErrorCode::kInvalidArgument,
                 std::to_string(value) + " is out of range, expected " + expected, field};
  };
  if (!(max_rotation_rad > 0 && max_rotation_rad < 0.5 * kPi)) {
    return bad("max_rotation_rad", max_rotation_rad, "0 to pi/2");
  }
  if (!(max_direction_rad > 0 && max_direction_rad < 0.5 * kPi)) {
    return bad("max_direction_rad", max_direction_rad, "0 to pi/2");
  }
  if (min_support < 2) return bad("min_support", static_cast<double>(min_support), ">= 2");
  if (!(min_rival_ratio >= 1)) return bad("min_rival_ratio", min_rival_ratio, ">= 1");
  if (!(max_scale_sigma > 0)) return bad("max_scale_sigma", max_scale_sigma, "> 0");
  return {};
}

SimilarityVerdict EstimateSimilarity(const std::vector<ModelLink>& links,
                                     const Reconstruction& source, const Reconstruction& target,
                                     const SimilarityOptions& options, uint64_t seed) {
  SimilarityVerdict refused;
  refused.agrees.resize(links.size());
  refused.evidence = CountLinks(links);
  refused.evidence.scale_sigma = std::numeric_limits<double>::infinity();
  if (links.empty()) {
    refused.refusal = "no common camera and no pair across";
    return refused;
  }
  const std::vector<Constraint> constraints = MakeConstraints(links, source, target);
  const Mode mode =
      HeaviestMode(constraints, std::vector<bool>(links.size(), true), options.max_rotation_rad);
  const Eigen::Quaterniond rotation =
      RobustMean(constraints, options.max_rotation_rad, mode.rotation);
  const auto placement = PlacementSolver(constraints, rotation, options).Solve(seed);
  if (!placement) {
    refused.refusal = "open scale: " + std::to_string(refused.evidence.common_cameras) +
                      " common cameras and " + std::to_string(refused.evidence.cross_pairs) +
                      " pairs leave the scale undetermined";
    return refused;
  }
  return Judge(links, constraints, {placement->scale, rotation, placement->translation}, options);
}

SimilarityVerdict JudgeSimilarity(const std::vector<ModelLink>& links, const Reconstruction& source,
                                  const Reconstruction& target, const Sim3& target_from_source,
                                  const SimilarityOptions& options) {
  return Judge(links, MakeConstraints(links, source, target), target_from_source, options);
}

}  // namespace rotunda::sfm
