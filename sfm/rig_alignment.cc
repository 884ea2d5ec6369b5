#include "sfm/rig_alignment.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <string>

#include "sfm/core/alignment.h"
#include "sfm/core/statistics.h"

namespace rotunda::sfm {
namespace {

/// A camera stands in a place of the calibration when every other place is farther by this factor.
/// Poses of swapped cameras are worse than others: their lenses are each other's, too (half a per
/// cent of the focal length is 1 cm at 2 m).
constexpr double kFartherFactor = 5.0;
/// A camera that came loose stays near its mount: it may turn by any angle, but does not go away by
/// this share of the rig's radius. A camera of a fold lands at least some columns away.
constexpr double kFarShare = 0.25;

VsCalibration Compare(const Rigid3& cam_from_rig, const Rigid3& calibrated_cam_from_rig) {
  VsCalibration difference;
  difference.rotation_deg =
      DegFromRad(RotationAngle_rad(cam_from_rig.rotation, calibrated_cam_from_rig.rotation));
  difference.position_mm =
      1e3 * (cam_from_rig.OriginInSource() - calibrated_cam_from_rig.OriginInSource()).norm();
  return difference;
}

/// Of the difference of two independent estimates of a pose.
PoseSigma SigmaOfDifference(const std::optional<PoseCovariance>& covariance,
                            const std::optional<PoseSigma>& calibrated) {
  PoseSigma sigma;
  if (covariance) sigma = SigmaOf(*covariance);
  if (!calibrated) return sigma;
  sigma.rotation_deg = std::hypot(sigma.rotation_deg, calibrated->rotation_deg);
  sigma.position_mm = std::hypot(sigma.position_mm, calibrated->position_mm);
  return sigma;
}

double InSigmas(double value, double sigma) { return sigma > 0 ? value / sigma : 0; }

void MarkMoved(const std::vector<PoseSigma>& sigmas,
               std::vector<std::optional<VsCalibration>>& differences) {
  std::vector<double> rotations_deg, positions_mm;
  for (const auto& difference : differences) {
    if (!difference) continue;
    rotations_deg.push_back(difference->rotation_deg);
    positions_mm.push_back(difference->position_mm);
  }
  const double spread_deg = kSigmaFromMedian * Median(rotations_deg);
  const double spread_mm = kSigmaFromMedian * Median(positions_mm);
  for (size_t i = 0; i < differences.size(); ++i) {
    if (!differences[i]) continue;
    VsCalibration& off = *differences[i];
    off.sigmas = std::max(InSigmas(off.rotation_deg, sigmas[i].rotation_deg),
                          InSigmas(off.position_mm, sigmas[i].position_mm));
    off.moved = off.rotation_deg > kMovedSigmas * std::max(spread_deg, sigmas[i].rotation_deg) ||
                off.position_mm > kMovedSigmas * std::max(spread_mm, sigmas[i].position_mm);
  }
}

/// Root mean square distance of the calibrated centres from their centroid.
double RigRadius_m(const Calibration& calibration) {
  const double share = 1.0 / static_cast<double>(calibration.cameras.size());
  Eigen::Vector3d centroid_m = Eigen::Vector3d::Zero();
  for (const CalibratedCamera& camera : calibration.cameras) {
    centroid_m += share * camera.cam_from_rig.OriginInSource();
  }
  double mean_square = 0;
  for (const CalibratedCamera& camera : calibration.cameras) {
    mean_square += share * (camera.cam_from_rig.OriginInSource() - centroid_m).squaredNorm();
  }
  return std::sqrt(mean_square);
}

/// The camera in whose calibrated place a pose is; empty when that is not clear. A turn counts as
/// what it moves the line of sight in the middle of the rig.
std::string PlaceOf(const Rigid3& cam_from_rig, const Calibration& calibration) {
  const double radius_m = RigRadius_m(calibration);
  double nearest_m = std::numeric_limits<double>::infinity(), second_m = nearest_m;
  std::string place;
  for (const CalibratedCamera& camera : calibration.cameras) {
    const VsCalibration off = Compare(cam_from_rig, camera.cam_from_rig);
    const double distance_m =
        std::hypot(1e-3 * off.position_mm, radius_m * RadFromDeg(off.rotation_deg));
    second_m = std::min(second_m, std::max(nearest_m, distance_m));
    if (distance_m < nearest_m) {
      nearest_m = distance_m;
      place = camera.camera;
    }
  }
  return kFartherFactor * nearest_m < second_m ? place : "";
}

/// Whether from place to place one comes back to `camera`, over at least one other.
bool InRing(const std::map<std::string, std::string>& place_of, const std::string& camera) {
  std::string next = camera;
  for (size_t step = 1; step <= place_of.size(); ++step) {
    const auto found = place_of.find(next);
    if (found == place_of.end()) return false;
    next = found->second;
    if (next == camera) return step > 1;
  }
  return false;
}

void MarkSwapped(const std::vector<std::optional<Rigid3>>& cam_from_rig, const FrameSet& set,
                 const Calibration& calibration,
                 std::vector<std::optional<VsCalibration>>& differences) {
  std::map<std::string, std::string> place_of;  // of the moved cameras
  for (size_t i = 0; i < differences.size(); ++i) {
    if (!differences[i] || !differences[i]->moved) continue;
    place_of[set.frames[i].camera] = PlaceOf(*cam_from_rig[i], calibration);
  }
  for (size_t i = 0; i < differences.size(); ++i) {
    if (!differences[i] || !InRing(place_of, set.frames[i].camera)) continue;
    differences[i]->moved = false;
    differences[i]->swapped_with = place_of.at(set.frames[i].camera);
  }
}

}  // namespace

Result<RigAlignment> AlignToCalibration(const Reconstruction& reconstruction, const FrameSet& set,
                                        const Calibration& calibration,
                                        const PoseCovariances& covariances, uint64_t seed) {
  std::vector<Eigen::Vector3d> centers, calibrated_centers_m;
  for (size_t i = 0; i < set.frames.size(); ++i) {
    const CalibratedCamera* camera = calibration.Find(set.frames[i].camera);
    if (!reconstruction.cam_from_model[i] || camera == nullptr) continue;
    centers.push_back(reconstruction.cam_from_model[i]->OriginInSource());
    calibrated_centers_m.push_back(camera->cam_from_rig.OriginInSource());
  }
  ROTUNDA_ASSIGN_OR_RETURN(const RobustSim3 fit,
                           FitSim3Robust(centers, calibrated_centers_m, seed));

  RigAlignment alignment{fit.target_from_source, {}};
  alignment.vs_calibration.resize(set.frames.size());
  std::vector<std::optional<Rigid3>> cam_from_rig(set.frames.size());
  const PoseCovariances metric = Transformed(covariances, fit.target_from_source);
  std::vector<PoseSigma> sigmas(set.frames.size());
  for (size_t i = 0; i < set.frames.size(); ++i) {
    const CalibratedCamera* camera = calibration.Find(set.frames[i].camera);
    if (!reconstruction.cam_from_model[i] || camera == nullptr) continue;
    cam_from_rig[i] = TransformPose(fit.target_from_source, *reconstruction.cam_from_model[i]);
    alignment.vs_calibration[i] = Compare(*cam_from_rig[i], camera->cam_from_rig);
    sigmas[i] = SigmaOfDifference(metric.images[i], camera->sigma);
  }
  MarkMoved(sigmas, alignment.vs_calibration);
  MarkSwapped(cam_from_rig, set, calibration, alignment.vs_calibration);
  alignment.far_mm = 1e3 * kFarShare * RigRadius_m(calibration);
  return alignment;
}

PoseCovariances Transformed(const PoseCovariances& covariances, const Sim3& target_from_model) {
  Eigen::Matrix<double, 6, 6> jacobian = Eigen::Matrix<double, 6, 6>::Identity();
  jacobian.bottomRightCorner<3, 3>() =
      target_from_model.scale * target_from_model.rotation.toRotationMatrix();
  PoseCovariances transformed = covariances;
  for (auto& covariance : transformed.images) {
    if (covariance) covariance = jacobian * *covariance * jacobian.transpose();
  }
  return transformed;
}

}  // namespace rotunda::sfm
