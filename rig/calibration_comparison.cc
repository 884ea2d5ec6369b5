#include "rig/calibration_comparison.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "rig/board.h"
#include "rig/rig_model.h"
#include "sfm/core/statistics.h"

namespace rotunda::rig {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using PoseCovariance = Eigen::Matrix<double, 6, 6>;

constexpr int kPoseFreedom = 6;

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

/// The cameras' scatter over what their covariances say, squared; at least 1.
double Excess(const std::vector<Pair>& pairs, const Rigid3& before_from_after) {
  return std::max(1.0,
                  MedianChiSquare(pairs, before_from_after) / ChiSquareLimit(kPoseFreedom, 0.5));
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
    const double scale = Excess(pairs, alignment);
    PoseCovariance matrix = PoseCovariance::Zero();
    Vector6 gradient = Vector6::Zero();
    for (const Pair& pair : pairs) {
      const Change change = ChangeOf(pair, alignment);
      // Geman and McClure's weight: what is far off has no say at all.
      const double share = change.ChiSquare() / (kLossSigmas * kLossSigmas * kPoseFreedom * scale);
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

/// `scale`: the sigmas counted this many times as large.
CameraChange Describe(const Pair& pair, const Rigid3& alignment, double scale) {
  const Change change = ChangeOf(pair, alignment);
  CameraChange described;
  described.camera = pair.before->camera;
  described.rotation_deg = DegFromRad(change.difference.head<3>().norm());
  described.position_mm = 1e3 * change.difference.tail<3>().norm();
  described.sigmas = std::sqrt(change.ChiSquare() / kPoseFreedom) / scale;
  const double before_px = pair.before->intrinsics.MeanFocal_px();
  const double after_px = pair.after->intrinsics.MeanFocal_px();
  described.focal_percent = 100 * (after_px / before_px - 1);
  described.other_serial = !pair.before->serial.empty() && !pair.after->serial.empty() &&
                           pair.before->serial != pair.after->serial;
  described.sigma_before = pair.before->sigma;
  described.sigma_after = pair.after->sigma;
  return described;
}

/// How far a lens is from what it was: a squared Mahalanobis distance.
struct LensChange {
  double chi_square = 0;
  int freedom = 1;
};

/// Over all parameters; of what neither calibration found (k4 to k6 of a model with k3) there is no
/// variance.
LensChange ParameterChange(const CalibratedCamera& before, const CalibratedCamera& after) {
  const auto count = static_cast<Eigen::Index>(before.intrinsics.params.size());
  const Eigen::MatrixXd covariance = before.covariance->bottomRightCorner(count, count) +
                                     after.covariance->bottomRightCorner(count, count);
  std::vector<Eigen::Index> found;
  for (Eigen::Index i = 0; i < count; ++i) {
    if (covariance(i, i) > 0) found.push_back(i);
  }
  if (found.empty()) return {};
  const Eigen::VectorXd change =
      Eigen::Map<const Eigen::VectorXd>(after.intrinsics.params.data(), count) -
      Eigen::Map<const Eigen::VectorXd>(before.intrinsics.params.data(), count);
  // In units of the sigmas: pixels and distortion differ by orders of magnitude.
  const Eigen::VectorXd scale = covariance.diagonal()(found).cwiseSqrt();
  const Eigen::MatrixXd correlation = scale.cwiseInverse().asDiagonal() * covariance(found, found) *
                                      scale.cwiseInverse().asDiagonal();
  const Eigen::VectorXd scaled = change(found).cwiseQuotient(scale);
  return {std::max(0.0, scaled.dot(correlation.ldlt().solve(scaled))),
          static_cast<int>(found.size())};
}

/// nullopt when the calibrations do not say how sure they are of the lens.
std::optional<LensChange> LensChangeOf(const Pair& pair) {
  const CalibratedCamera &before = *pair.before, &after = *pair.after;
  if (before.intrinsics.model == after.intrinsics.model && before.covariance && after.covariance) {
    return ParameterChange(before, after);
  }
  if (!before.sigma || !after.sigma || !before.sigma->focal_px || !after.sigma->focal_px) {
    return std::nullopt;
  }
  const double sigmas = (after.intrinsics.MeanFocal_px() - before.intrinsics.MeanFocal_px()) /
                        std::hypot(*before.sigma->focal_px, *after.sigma->focal_px);
  return LensChange{sigmas * sigmas, 1};
}

/// Which lenses are not as they were.
void JudgeLenses(const std::vector<Pair>& pairs, double false_alarm,
                 CalibrationComparison& comparison) {
  std::vector<std::optional<LensChange>> changes;
  std::vector<double> excess;
  for (const Pair& pair : pairs) {
    changes.push_back(LensChangeOf(pair));
    if (!changes.back()) continue;
    excess.push_back(changes.back()->chi_square / ChiSquareLimit(changes.back()->freedom, 0.5));
  }
  const double scale = std::max(1.0, Median(std::move(excess)));
  comparison.lens_inflation = std::sqrt(scale);
  const double told_scale = comparison.SameRig() ? scale : 1;
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (!changes[i]) continue;
    const auto [chi_square, freedom] = *changes[i];
    comparison.cameras[i].lens_sigmas = std::sqrt(chi_square / (told_scale * freedom));
    comparison.cameras[i].lens_changed =
        chi_square / scale >
        ChiSquareLimit(freedom, false_alarm / static_cast<double>(pairs.size()));
  }
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

/// See CalibrationComparison::growth.
double GrowthOf(const std::vector<Pair>& pairs) {
  constexpr double kOverScatter = 3;
  std::vector<double> ratios;
  for (size_t i = 0; i < pairs.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      const auto apart_m = [&](const CalibratedCamera* Pair::*side) {
        return ((pairs[i].*side)->cam_from_rig.OriginInSource() -
                (pairs[j].*side)->cam_from_rig.OriginInSource())
            .norm();
      };
      const double before_m = apart_m(&Pair::before);
      if (before_m > 0) ratios.push_back(apart_m(&Pair::after) / before_m);
    }
  }
  if (ratios.empty()) return 0;
  const double ratio = Median(ratios);
  for (double& each : ratios) each = std::abs(each - ratio);
  const double scatter = kSigmaFromMedian * Median(std::move(ratios));
  return std::abs(ratio - 1) > kOverScatter * scatter ? ratio - 1 : 0;
}

/// That the two are not of one rig, and the likeliest reason.
std::string OtherRigText(const CalibrationComparison& comparison) {
  char text[200];
  std::snprintf(text, sizeof(text),
                "the cameras scatter %.1f times what the sigmas of both calibrations say: ",
                comparison.inflation);
  std::string told = text;
  if (!comparison.target_change.empty()) {
    return told + "they were made with two board files (" + comparison.target_change +
           "), and one of these is wrong";
  }
  if (comparison.growth == 0) return told + "they are not of the same rig, or one of them is wrong";
  std::snprintf(text, sizeof(text),
                "all of them stand %.2f %% %s apart than before, so square_mm of one of the "
                "board files is wrong",
                100 * std::abs(comparison.growth), comparison.growth > 0 ? "farther" : "less far");
  return told + text;
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
  comparison.inflation = std::sqrt(Excess(pairs, comparison.before_from_after));
  const double false_alarm = options.false_alarm / static_cast<double>(pairs.size());
  comparison.sigmas_limit = std::sqrt(ChiSquareLimit(kPoseFreedom, false_alarm) / kPoseFreedom);
  // Of two rigs the scatter is no measure of the sigmas: they stay what the calibrations say.
  if (!comparison.SameRig()) comparison.sigmas_limit *= comparison.inflation;
  for (const Pair& pair : pairs) {
    comparison.cameras.push_back(Describe(pair, comparison.before_from_after,
                                          comparison.SameRig() ? comparison.inflation : 1));
    CameraChange& change = comparison.cameras.back();
    change.moved = change.sigmas > comparison.sigmas_limit;
  }
  FindSwaps(pairs, comparison.before_from_after, comparison.cameras);
  JudgeLenses(pairs, options.false_alarm, comparison);
  comparison.growth = GrowthOf(pairs);
  comparison.target_change = TargetChange(before, after);
  for (const CalibratedCamera& camera : before.cameras) {
    if (after.Find(camera.camera) == nullptr) comparison.only_before.push_back(camera.camera);
  }
  for (const CalibratedCamera& camera : after.cameras) {
    if (before.Find(camera.camera) == nullptr) comparison.only_after.push_back(camera.camera);
  }
  return comparison;
}

std::string VerdictOn(const CameraChange& change) {
  std::string verdict;
  const auto add = [&](const std::string& what) {
    verdict += (verdict.empty() ? "" : ", ") + what;
  };
  if (change.moved) {
    add(change.swapped_with ? "stands where " + *change.swapped_with + " was" : "moved");
  }
  if (change.lens_changed) add("lens changed");
  if (change.other_serial) add("another serial number");
  return verdict;
}

std::vector<std::string> ChangesIn(const CalibrationComparison& comparison) {
  std::vector<std::string> changes;
  char text[200];
  if (!comparison.SameRig()) changes.push_back(OtherRigText(comparison));
  for (const CameraChange& change : comparison.cameras) {
    if (change.moved) {
      std::snprintf(text, sizeof(text), " moved by %.2f mm, %.3f deg (%.1f sigma)",
                    change.position_mm, change.rotation_deg, change.sigmas);
      changes.push_back(change.camera + text +
                        (change.swapped_with ? ": it stands where " + *change.swapped_with +
                                                   " was; are the two swapped?"
                                             : ""));
    }
    if (change.lens_changed && !change.swapped_with) {
      std::snprintf(text, sizeof(text),
                    " has another lens than it had (focal length %+.3f %%; %.1f sigma): was it "
                    "focused anew, or exchanged?",
                    change.focal_percent, *change.lens_sigmas);
      changes.push_back(change.camera + text);
    }
    if (change.other_serial) changes.push_back(change.camera + " has another serial number");
  }
  const auto& failed = comparison.not_calibrated;
  for (const std::string& camera : comparison.only_before) {
    const bool took_part = std::find(failed.begin(), failed.end(), camera) != failed.end();
    changes.push_back(camera + (took_part ? " was not calibrated this time"
                                          : " is only in the earlier calibration"));
  }
  for (const std::string& camera : comparison.only_after) {
    changes.push_back(camera + " is only in the later calibration");
  }
  return changes;
}

}  // namespace rotunda::rig
