#pragma once

#include <optional>
#include <string>
#include <vector>

#include "sfm/core/calibration.h"
#include "sfm/core/pose_set.h"

namespace rotunda {

struct CameraError {
  std::string camera;
  double rotation_deg = 0.0;
  double position_mm = 0.0;
};

/// Against truth, over the cameras that have a pose and are in the truth (TC-SFM.md 8).
struct Evaluation {
  std::string measured_id, truth_id;  // frame set (or calibration) and truth
  size_t registered = 0;  // cameras with a pose; of a calibration: those that are in the truth
  size_t of = 0;          // cameras of the frame set; of a calibration: of the truth
  double mean_rotation_deg = 0, median_rotation_deg = 0, max_rotation_deg = 0;
  double mean_position_mm = 0, median_position_mm = 0, max_position_mm = 0;
  bool folded = false;  // any camera more than 10 degrees off
  /// Root of the mean over cameras of (measured error / predicted sigma)^2; absent without sigmas.
  /// The predicted position sigma goes through the fit's scale, so poses need not be metric.
  std::optional<double> rotation_error_over_sigma;
  std::optional<double> position_error_over_sigma;
  std::vector<CameraError> cameras;
  std::vector<std::string> not_in_truth;  // measured, but nothing to compare with
};

/// Poses after one least-squares Sim(3) of the camera centres onto the truth's. kBadInput below 3
/// common cameras; kInvalidArgument when their centres lie on one line.
Result<Evaluation> EvaluatePoses(const PoseSet& poses, const Calibration& truth);
/// A calibration after one rigid motion: its scale counts.
Result<Evaluation> EvaluateCalibration(const Calibration& calibration, const Calibration& truth);

std::string EvaluationToJson(const Evaluation& evaluation);

}  // namespace rotunda
