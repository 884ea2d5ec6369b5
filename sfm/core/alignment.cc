#include "sfm/core/alignment.h"

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "sfm/core/run_context.h"
#include "sfm/core/statistics.h"

namespace rotunda {
namespace {

using Points = std::vector<Eigen::Vector3d>;
using Triple = std::array<size_t, 3>;

/// Spread across a line over spread along it, below which the rotation about the line is not
/// determined.
constexpr double kMinSpreadRatio = 1e-6;
constexpr size_t kMaxTriples = 500;
constexpr double kInlierSigmas = 4.0;
/// Residuals below this share of the points' spread are rounding.
constexpr double kRounding = 1e-12;
constexpr int kMaxRefits = 50;

Error Invalid(const std::string& message) { return {ErrorCode::kInvalidArgument, message, ""}; }

Eigen::Vector3d Mean(const Points& points) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& point : points) sum += point;
  return sum / static_cast<double>(points.size());
}

Eigen::Matrix3d Covariance(const Points& a, const Points& b) {
  const Eigen::Vector3d mean_a = Mean(a);
  const Eigen::Vector3d mean_b = Mean(b);
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (size_t i = 0; i < a.size(); ++i) sum += (a[i] - mean_a) * (b[i] - mean_b).transpose();
  return sum / static_cast<double>(a.size());
}

/// False when all points lie on one line (or in one point).
bool SpansPlane(const Eigen::Matrix3d& covariance) {
  const Eigen::Vector3d variances =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance, Eigen::EigenvaluesOnly)
          .eigenvalues();
  return variances(2) > 0 && variances(1) > kMinSpreadRatio * kMinSpreadRatio * variances(2);
}

Points Select(const Points& points, const std::vector<bool>& selected) {
  Points result;
  for (size_t i = 0; i < points.size(); ++i) {
    if (selected[i]) result.push_back(points[i]);
  }
  return result;
}

std::vector<double> Residuals(const Sim3& target_from_source, const Points& source,
                              const Points& target) {
  std::vector<double> residuals(source.size());
  for (size_t i = 0; i < source.size(); ++i) {
    residuals[i] = (target_from_source * source[i] - target[i]).norm();
  }
  return residuals;
}

/// All triples of n points when there are few, else a seeded sample.
std::vector<Triple> Triples(size_t n, uint64_t seed) {
  std::vector<Triple> triples;
  if (n * (n - 1) * (n - 2) / 6 <= kMaxTriples) {
    for (size_t i = 0; i < n; ++i) {
      for (size_t j = i + 1; j < n; ++j) {
        for (size_t k = j + 1; k < n; ++k) triples.push_back({i, j, k});
      }
    }
    return triples;
  }
  std::mt19937_64 random(DeriveSeed(seed, 0));
  while (triples.size() < kMaxTriples) {
    const Triple triple = {random() % n, random() % n, random() % n};
    if (triple[0] == triple[1] || triple[1] == triple[2] || triple[0] == triple[2]) continue;
    triples.push_back(triple);
  }
  return triples;
}

/// The triple's fit with the least median of residuals (Rousseeuw, JASA 1984).
Result<Sim3> LeastMedianFit(const Points& source, const Points& target, uint64_t seed) {
  Result<Sim3> best = Invalid("no three points determine a similarity");
  double least = std::numeric_limits<double>::infinity();
  for (const auto& [i, j, k] : Triples(source.size(), seed)) {
    const Result<Sim3> fit =
        FitSim3({source[i], source[j], source[k]}, {target[i], target[j], target[k]}, true);
    if (!fit) continue;
    const double median = Median(Residuals(*fit, source, target));
    if (median < least) {
      least = median;
      best = *fit;
    }
  }
  return best;
}

}  // namespace

Result<Sim3> FitSim3(const Points& source, const Points& target, bool with_scale) {
  if (source.size() != target.size() || source.size() < 3) {
    return Invalid("expected at least 3 pairs of points, found " + std::to_string(source.size()) +
                   " and " + std::to_string(target.size()));
  }
  const Eigen::Matrix3d source_covariance = Covariance(source, source);
  const Eigen::Matrix3d target_covariance = Covariance(target, target);
  const Eigen::Matrix3d covariance = Covariance(target, source);
  if (!source_covariance.allFinite() || !target_covariance.allFinite()) {
    return Invalid("a point's coordinates are not finite numbers");
  }
  if (!SpansPlane(source_covariance) || !SpansPlane(target_covariance)) {
    return Invalid("the points lie on one line");
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance,
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d sign(1, 1, 1);
  if (svd.matrixU().determinant() * svd.matrixV().determinant() < 0) sign.z() = -1;
  const Eigen::Matrix3d rotation = svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose();
  Sim3 fit;
  fit.rotation = Eigen::Quaterniond(rotation).normalized();
  if (with_scale) fit.scale = svd.singularValues().dot(sign) / source_covariance.trace();
  if (!(fit.scale > 0)) return Invalid("the points determine no scale");
  fit.translation = Mean(target) - fit.scale * (fit.rotation * Mean(source));
  return fit;
}

Result<RobustSim3> FitSim3Robust(const Points& source, const Points& target, uint64_t seed) {
  ROTUNDA_RETURN_IF_ERROR(FitSim3(source, target, true));
  RobustSim3 result;
  ROTUNDA_ASSIGN_OR_RETURN(result.target_from_source, LeastMedianFit(source, target, seed));
  const double floor = kRounding * std::sqrt(Covariance(target, target).trace());
  for (int refit = 0; refit < kMaxRefits; ++refit) {
    const std::vector<double> residuals = Residuals(result.target_from_source, source, target);
    result.sigma = kSigmaFromMedian * Median(residuals);
    std::vector<bool> inliers(source.size());
    for (size_t i = 0; i < source.size(); ++i) {
      inliers[i] = residuals[i] <= std::max(kInlierSigmas * result.sigma, floor);
    }
    if (inliers == result.inliers) break;
    result.inliers = std::move(inliers);
    ROTUNDA_ASSIGN_OR_RETURN(
        result.target_from_source,
        FitSim3(Select(source, result.inliers), Select(target, result.inliers), true));
  }
  return result;
}

}  // namespace rotunda
