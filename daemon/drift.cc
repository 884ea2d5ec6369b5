#include "daemon/drift.h"

#include <cmath>

#include "sfm/core/name_list.h"
#include "sfm/rig_alignment.h"
#include "sfm/run_choices.h"

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

/// The calibration makes no verdict better: a sure one, all that files of earlier versions have, is
/// also that of the pictures. The plain method gives none: nothing speaks for its poses.
bool PicturesAreSure(const PoseSummary& summary) {
  return summary.verdict == "sure" || summary.verdict_of_pictures == "sure";
}

/// Else the calibration is not theirs, or nobody knows which cameras stand where it has them.
bool MostAreInPlace(const std::vector<CameraPose>& cameras) {
  size_t compared = 0, far_off = 0;
  for (const CameraPose& camera : cameras) {
    compared += camera.vs_calibration.has_value();
    far_off += camera.vs_calibration && camera.vs_calibration->far_off;
  }
  return 2 * far_off < compared && !DisagreesAsAWhole(cameras, sfm::kMovedSigmas);
}

bool IsBeyond(const VsCalibration& change, const DriftLimits& limits) {
  const bool is_large =
      change.position_mm > limits.position_mm || change.rotation_deg > limits.rotation_deg;
  return change.swapped_with || change.far_off || (change.moved && is_large);
}

}  // namespace

bool SpeaksOfTheRig(const PoseSet& poses) {
  const auto preset = poses.options.find(sfm::kPresetOption);
  const bool is_of_a_rig = preset == poses.options.end() ||
                           preset->second == NameIn(sfm::PresetsByName(), sfm::Preset::kRig);
  return is_of_a_rig && !sfm::HadPrior(poses);
}

bool MaySpeakOfDrift(const PoseSet& poses) {
  const PoseSummary& summary = poses.summary;
  return poses.metric && poses.aligned_to && SpeaksOfTheRig(poses) && PicturesAreSure(summary) &&
         !summary.folded.value_or(false) && MostAreInPlace(poses.cameras);
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
    record.beyond_limit = IsBeyond(change, limits);
  }
  return records;
}

std::vector<UnregisteredRecord> UnregisteredOf(const PoseSet& poses,
                                               const Calibration& calibration) {
  std::vector<UnregisteredRecord> records;
  if (!MaySpeakOfDrift(poses)) return records;
  for (const CameraPose& pose : poses.cameras) {
    if (pose.registered || calibration.Find(pose.camera) == nullptr) continue;
    UnregisteredRecord& record = records.emplace_back();
    record.calibration = *poses.aligned_to;
    record.camera = pose.camera;
    record.reason = pose.reason;
  }
  return records;
}

}  // namespace rotunda::daemon
