#include "rig/calibration_result.h"

#include <cmath>
#include <utility>

#include "rig/calibration_checks.h"

namespace rotunda::rig {
namespace {

/// A camera with a pose, as the file has it; `c` is its place.
CalibratedCamera CameraOf(const SightedCamera& sighted, size_t c, const CameraCheck& check,
                          const RigCalibration& result) {
  const CameraUncertainty& uncertainty = *result.uncertainty.cameras[c];
  CalibratedCamera camera;
  camera.camera = sighted.camera;
  camera.serial = sighted.serial;
  camera.intrinsics = result.model.intrinsics[c];
  camera.cam_from_rig = *result.model.cam_from_rig[c];
  camera.sigma = uncertainty.sigma;
  camera.covariance = uncertainty.covariance;
  camera.fit = CameraFit{check.found, check.kept, check.rms_px, uncertainty.projection_mean_px,
                         uncertainty.projection_max_px};
  return camera;
}

}  // namespace

Calibration ToCalibration(const Board& board, const BoardSightings& sightings,
                          const RigCalibration& result, const CrossValidation* validation) {
  Calibration calibration;
  calibration.source = CalibrationSource::kCharuco;
  const auto checks = CheckCameras(board, sightings, result, {});
  double squares = 0;
  for (size_t c = 0; c < sightings.cameras.size(); ++c) {
    if (!result.model.cam_from_rig[c]) continue;
    calibration.cameras.push_back(CameraOf(sightings.cameras[c], c, checks[c], result));
    squares += std::pow(checks[c].rms_px, 2) * static_cast<double>(checks[c].kept);
  }
  for (size_t f = 0; f < board.faces.size(); ++f) {
    if (!result.uncertainty.faces[f]) continue;
    CalibratedFace face = result.model.faces[f];
    face.print = PrintOf(board.faces[f]);
    const FaceUncertainty& sigma = *result.uncertainty.faces[f];
    face.sigma = FaceSigma{sigma.rotation_deg, sigma.position_mm, sigma.bow_mm};
    calibration.board.push_back(std::move(face));
  }
  CalibrationResiduals residuals;
  residuals.corners = CornerCount(result.found);
  residuals.kept = CornerCount(result.kept);
  residuals.rms_px = std::sqrt(squares / static_cast<double>(residuals.kept));
  residuals.noise = result.noise;
  if (validation != nullptr) {
    residuals.held_out_rms_px = validation->held_out_rms_px;
    residuals.held_out_p95_px = validation->held_out_p95_px;
    residuals.half_split_rotation_ratio = validation->rotation_ratio;
    residuals.half_split_position_ratio = validation->position_ratio;
  }
  calibration.residuals = residuals;
  return calibration;
}

}  // namespace rotunda::rig
