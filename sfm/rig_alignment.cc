#include "sfm/rig_alignment.h"

#include <algorithm>
#include <cmath>

#include "sfm/core/alignment.h"

namespace rotunda::sfm {
namespace {

constexpr double kMovedSigmas = 6.0;
constexpr double kSigmaFromMedian = 1.4826;

double Median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

VsCalibration Compare(const Rigid3& cam_from_rig, const Rigid3& calibrated_cam_from_rig) {
  VsCalibration difference;
  difference.rotation_deg =
      DegFromRad(RotationAngle_rad(cam_from_rig.rotation, calibrated_cam_from_rig.rotation));
  difference.position_mm =
      1e3 * (cam_from_rig.OriginInSource() - calibrated_cam_from_rig.OriginInSource()).norm();
  return difference;
}

void MarkMoved(const PoseCovariances& metric_covariances,
               std::vector<std::optional<VsCalibration>>& differences) {
  std::vector<double> rotations_deg, positions_mm;
  for (const auto& difference : differences) {
    if (!difference) continue;
    rotations_deg.push_back(difference->rotation_deg);
    positions_mm.push_back(difference->position_mm);
  }
  const double rotation_sigma_deg = kSigmaFromMedian * Median(rotations_deg);
  const double position_sigma_mm = kSigmaFromMedian * Median(positions_mm);
  for (size_t i = 0; i < differences.size(); ++i) {
    if (!differences[i]) continue;
    PoseSigma predicted;
    if (metric_covariances.images[i]) predicted = SigmaOf(*metric_covariances.images[i]);
    differences[i]->moved =
        differences[i]->rotation_deg >
            kMovedSigmas * std::max(rotation_sigma_deg, predicted.rotation_deg) ||
        differences[i]->position_mm >
            kMovedSigmas * std::max(position_sigma_mm, predicted.position_mm);
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
  for (size_t i = 0; i < set.frames.size(); ++i) {
    const CalibratedCamera* camera = calibration.Find(set.frames[i].camera);
    if (!reconstruction.cam_from_model[i] || camera == nullptr) continue;
    alignment.vs_calibration[i] =
        Compare(TransformPose(fit.target_from_source, *reconstruction.cam_from_model[i]),
                camera->cam_from_rig);
  }
  MarkMoved(Transformed(covariances, fit.target_from_source), alignment.vs_calibration);
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
