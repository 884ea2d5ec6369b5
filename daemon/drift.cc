#include "daemon/drift.h"

#include <cmath>

namespace rotunda::daemon {
namespace {

/// Of the difference of reconstruction and calibration, which are independent.
void AddSigmas(const CameraPose& pose, const CalibratedCamera* calibrated, DriftRecord& record) {
  double rotation_deg = 0, position_mm = 0;
  if (pose.sigma) {
    rotation_deg = pose.sigma->rotation_deg;
    position_mm = pose.sigma->position_mm;
  }
  if (calibrated != nullptr && calibrated->sigma) {
    rotation_deg = std::hypot(rotation_deg, calibrated->sigma->rotation_deg);
    position_mm = std::hypot(position_mm, calibrated->sigma->position_mm);
  }
  if (rotation_deg > 0) record.rotation_sigma_deg = rotation_deg;
  if (position_mm > 0) record.position_sigma_mm = position_mm;
}

}  // namespace

bool MaySpeakOfDrift(const PoseSet& poses) {
  const PoseSummary& summary = poses.summary;
  // The plain method gives no verdict: nothing speaks for its poses.
  return poses.metric && poses.aligned_to && summary.verdict == "sure" &&
         !summary.folded.value_or(false);
}

std::vector<DriftRecord> DriftOf(const PoseSet& poses, const Calibration& calibration,
                                 const DriftLimits& limits) {
  std::vector<DriftRecord> records;
  if (!MaySpeakOfDrift(poses)) return records;
  for (const CameraPose& pose : poses.cameras) {
    if (!pose.registered || !pose.vs_calibration) continue;
    const VsCalibration& change = *pose.vs_calibration;
    DriftRecord& record = records.emplace_back();
    record.calibration = *poses.aligned_to;
    record.camera = pose.camera;
    record.rotation_deg = change.rotation_deg;
    record.position_mm = change.position_mm;
    AddSigmas(pose, calibration.Find(pose.camera), record);
    record.swapped_with = change.swapped_with;
    record.beyond_limit = change.swapped_with.has_value() ||
                          (change.moved && (change.position_mm > limits.position_mm ||
                                            change.rotation_deg > limits.rotation_deg));
  }
  return records;
}

}  // namespace rotunda::daemon
