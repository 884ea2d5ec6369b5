#include "rig/sim/calibrated_rig.h"

#include <cmath>

#include "rig/sim/noise.h"

namespace rotunda::sim {
namespace {

constexpr PoseSigma kSigma = {0.005, 0.15, std::nullopt};
constexpr uint64_t kStream = 0xCA11B;  // apart from the streams that draw the rig itself

Eigen::Vector3d NormalVector(Random& random, double sigma) {
  const double x = random.Normal(), y = random.Normal(), z = random.Normal();
  return sigma / std::sqrt(3.0) * Eigen::Vector3d(x, y, z);
}

}  // namespace

Calibration DrawCalibration(const Calibration& truth, uint64_t seed) {
  Calibration calibration = truth;
  calibration.id = truth.id + "-calibration";
  calibration.source = CalibrationSource::kCharuco;
  calibration.board.clear();
  Random random(Hash64(seed ^ kStream));
  for (CalibratedCamera& camera : calibration.cameras) {
    const Eigen::Vector3d center_m =
        camera.cam_from_rig.OriginInSource() + NormalVector(random, kSigma.position_mm * 1e-3);
    const Eigen::Vector3d turn_rad = NormalVector(random, RadFromDeg(kSigma.rotation_deg));
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(turn_rad.norm(), turn_rad.normalized()));
    camera.cam_from_rig.rotation = (turn * camera.cam_from_rig.rotation).normalized();
    camera.cam_from_rig.translation = -(camera.cam_from_rig.rotation * center_m);
    camera.sigma = kSigma;
  }
  return calibration;
}

}  // namespace rotunda::sim
