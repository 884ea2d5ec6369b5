#include "rig/calibration_comparison.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "rig/rig_model.h"
#include "sfm/core/statistics.h"

namespace rotunda::rig {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using PoseCovariance = Eigen::Matrix<double, 6, 6>;

constexpr double kMedianChiSquare6 = 5.3481;  // of six degrees of freedom

/// A camera of both calibrations; covariances of turn (camera axes) and centre (own rig's axes).
struct Pair {
  const CalibratedCamera* before;
  const CalibratedCamera* after;
  PoseCovariance before_covariance, after_covariance;
};

PoseCovariance CovarianceOf(const CalibratedCamera& camera,
                            const CalibrationComparisonOptions& options) {
  if (camera.covariance) return camera.covariance->topLeftCorner<6, 6>();
  const double rotation_deg =
      camera.sigma ? camera.sigma->rotation_deg : options.default_rotation_deg;
  const double position_mm = camera.sigma ? camera.sigma->position_mm : options.default_position_mm;
  Vector6 variances;
  variances << Eigen::Vector3d::Constant(std::pow(RadFromDeg(rotation_deg), 2) / 3),
      Eigen::Vector3d::Constant(std::pow(1e-3 * position_mm, 2) / 3);
  // A camera that claims to be exact would decide alone.
  constexpr double kLeastVariance = 1e-16;
  return PoseCovariance(variances.cwiseMax(kLeastVariance).asDiagonal());
}

std::vector<Pair> PairUp(const Calibration& before, const Calibration& after,
                         const CalibrationComparisonOptions& options) {
  std::vector<Pair> pairs;
  for (const CalibratedCamera& camera : before.cameras) {
    const CalibratedCamera* other = after.Find(camera.camera);
    if (other == nullptr) continue;
    pairs.push_back({&camera, other, CovarianceOf(camera, options), CovarianceOf(*other, options)});
  }
  return pairs;
}

/// How far a camera is from where it was (turn in camera axes, centre in the axes of `before`), and
/// the inverse covariance of that.
struct Change {
  Vector6 difference;
  PoseCovariance information;
  double ChiSquare() const { return difference.dot(information * difference); }
};

Change ChangeOf(const Pair& pair, const Rigid3& before_from_after) {
  const Rigid3 after = pair.after->cam_from_rig * before_from_after.Inverse();
  const Rigid3& before = pair.before->cam_from_rig;
  Change change;
  change.difference << TurnOf(after.rotation * before.rotation.conjugate()),
      after.OriginInSource() - before.OriginInSource();
  PoseCovariance axes = PoseCovariance::Identity();
  axes.bottomRightCorner<3, 3>() = before_from_after.RotationMatrix();
  const PoseCovariance covariance =
      pair.before_covariance + axes * pair.after_covariance * axes.transpose();
  change.information = covariance.ldlt().solve(PoseCovariance::Identity());
  return change;
}

double MedianChiSquare(const std::vector<Pair>& pairs, const Rigid3& before_from_after) {
  std::vector<double> values;
  for (const Pair& pair : pairs) values.push_back(ChangeOf(pair, before_from_after).ChiSquare());
  return Median(std::move(values));
}

/// Each camera alone says how the rigs lie to each other: the one that most agree with.
Rigid3 LeastMedianAlignment(const std::vector<Pair>& pairs) {
  Rigid3 best;
  double least = std::numeric_limits<double>::infinity();
  for (const Pair& pair : pairs) {
    const Rigid3 alignment = pair.before->cam_from_rig.Inverse() * pair.after->cam_from_rig;
    const double median = MedianChiSquare(pairs, alignment);
    if (median < least) {
      least = median;
      best = alignment;
    }
  }
  return best;
}

/// Reweighted least squares over turn and shift of the frame, about the cameras' middle.
Rigid3 Align(const std::vector<Pair>& pairs) {
  constexpr int kIterations = 30;
  constexpr double kLossSigmas = 3.0;
  Rigid3 alignment = LeastMedianAlignment(pairs);
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const Pair& pair : pairs) middle += pair.before->cam_from_rig.OriginInSource();
  middle /= static_cast<double>(pairs.size());
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    const double scale = std::max(1.0, MedianChiSquare(pairs, alignment) / kMedianChiSquare6);
    PoseCovariance matrix = PoseCovariance::Zero();
    Vector6 gradient = Vector6::Zero();
    for (const Pair& pair : pairs) {
      const Change change = ChangeOf(pair, alignment);
      // Geman and McClure's weight: what is far off has no say at all.
      const double share = change.ChiSquare() / (kLossSigmas * kLossSigmas * 6 * scale);
      const double weight = 1.0 / ((1.0 + share) * (1.0 + share));
      PoseCovariance by_motion = PoseCovariance::Zero();
      by_motion.topLeftCorner<3, 3>() = -pair.before->cam_from_rig.RotationMatrix();
      by_motion.bottomLeftCorner<3, 3>() =
          -CrossMatrix(pair.before->cam_from_rig.OriginInSource() - middle);
      by_motion.bottomRightCorner<3, 3>().setIdentity();
      matrix += weight * by_motion.transpose() * change.information * by_motion;
      gradient += weight * by_motion.transpose() * change.information * change.difference;
    }
    const Vector6 step = -matrix.ldlt().solve(gradient);
    if (!step.allFinite()) break;
    const Eigen::Quaterniond turn = RotationOf(step.head<3>());
    const Rigid3 motion = {turn, middle - turn * middle + step.tail<3>()};
    alignment = motion * alignment;
    constexpr double kConverged = 1e-14;
    if (step.squaredNorm() < kConverged * kConverged) break;
  }
  return alignment;
}

/// The value that a chi-square variable of six degrees of freedom exceeds with this probability:
/// exp(-x/2) (1 + x/2 + x^2/8).
double ChiSquare6Limit(double probability) {
  double low = 0, high = 1000;
  for (int i = 0; i < 100; ++i) {
    const double x = 0.5 * (low + high);
    (std::exp(-0.5 * x) * (1 + 0.5 * x + x * x / 8) > probability ? low : high) = x;
  }
  return low;
}

CameraChange Describe(const Pair& pair, const Rigid3& alignment, double inflation) {
  const Change change = ChangeOf(pair, alignment);
  CameraChange described;
  described.camera = pair.before->camera;
  described.rotation_deg = DegFromRad(change.difference.head<3>().norm());
  described.position_mm = 1e3 * change.difference.tail<3>().norm();
  described.sigmas = std::sqrt(change.ChiSquare() / 6) / inflation;
  const double before_px = pair.before->intrinsics.MeanFocal_px();
  const double after_px = pair.after->intrinsics.MeanFocal_px();
  described.focal_percent = 100 * (after_px / before_px - 1);
  if (pair.before->sigma && pair.after->sigma && pair.before->sigma->focal_px &&
      pair.after->sigma->focal_px) {
    described.focal_sigmas =
        std::abs(after_px - before_px) /
        std::hypot(*pair.before->sigma->focal_px, *pair.after->sigma->focal_px);
  }
  described.other_serial = !pair.before->serial.empty() && !pair.after->serial.empty() &&
                           pair.before->serial != pair.after->serial;
  return described;
}

/// Two cameras that each stand where the other was.
void FindSwaps(const std::vector<Pair>& pairs, const Rigid3& alignment,
               std::vector<CameraChange>& changes) {
  const auto distance_m = [&](size_t after, size_t before) {
    return (alignment * pairs[after].after->cam_from_rig.OriginInSource() -
            pairs[before].before->cam_from_rig.OriginInSource())
        .norm();
  };
  constexpr double kInPlace = 0.2;  // of the distance between the two
  for (size_t i = 0; i < pairs.size(); ++i) {
    for (size_t j = 0; j < pairs.size(); ++j) {
      if (i == j || !changes[i].moved || !changes[j].moved) continue;
      const double apart_m = (pairs[i].before->cam_from_rig.OriginInSource() -
                              pairs[j].before->cam_from_rig.OriginInSource())
                                 .norm();
      if (distance_m(i, j) < kInPlace * apart_m && distance_m(j, i) < kInPlace * apart_m) {
        changes[i].swapped_with = changes[j].camera;
      }
    }
  }
}

}  // namespace

Result<Rigid3> AlignRigs(const Calibration& before, const Calibration& after,
                         const CalibrationComparisonOptions& options) {
  const std::vector<Pair> pairs = PairUp(before, after, options);
  if (pairs.empty()) {
    return Error{ErrorCode::kBadInput, "the two calibrations have no camera in common", ""};
  }
  return Align(pairs);
}

Result<CalibrationComparison> CompareCalibrations(const Calibration& before,
                                                  const Calibration& after,
                                                  const CalibrationComparisonOptions& options) {
  const std::vector<Pair> pairs = PairUp(before, after, options);
  if (pairs.size() < kMinComparedCameras) {
    return Error{ErrorCode::kBadInput,
                 "expected at least " + std::to_string(kMinComparedCameras) +
                     " cameras that are in both calibrations, found " +
                     std::to_string(pairs.size()),
                 ""};
  }
  CalibrationComparison comparison;
  comparison.before_from_after = Align(pairs);
  comparison.inflation = std::sqrt(
      std::max(1.0, MedianChiSquare(pairs, comparison.before_from_after) / kMedianChiSquare6));
  comparison.sigmas_limit =
      std::sqrt(ChiSquare6Limit(options.false_alarm / static_cast<double>(pairs.size())) / 6);
  for (const Pair& pair : pairs) {
    comparison.cameras.push_back(
        Describe(pair, comparison.before_from_after, comparison.inflation));
    CameraChange& change = comparison.cameras.back();
    change.moved = change.sigmas > comparison.sigmas_limit;
  }
  FindSwaps(pairs, comparison.before_from_after, comparison.cameras);
  for (const CalibratedCamera& camera : before.cameras) {
    if (after.Find(camera.camera) == nullptr) comparison.only_before.push_back(camera.camera);
  }
  for (const CalibratedCamera& camera : after.cameras) {
    if (before.Find(camera.camera) == nullptr) comparison.only_after.push_back(camera.camera);
  }
  return comparison;
}

}  // namespace rotunda::rig
