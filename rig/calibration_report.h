#pragma once

#include <optional>
#include <string>
#include <vector>

#include "rig/calibration_checks.h"
#include "rig/calibration_comparison.h"
#include "rig/cross_validation.h"
#include "rig/rig_calibration.h"
#include "sfm/core/calibration.h"

namespace rotunda::rig {

struct CalibrationReportInput {
  const Board& board;
  const BoardSightings& sightings;
  const RigCalibration& result;
  const Calibration& calibration;  // ToCalibration of the result
  const std::vector<CameraCheck>& checks;
  const CrossValidation& validation;
  const std::optional<CalibrationComparison>& comparison;  // with an earlier calibration
  const std::vector<std::string>& notes;                   // what the operator is to know or do
};

/// One HTML file that needs nothing else: what was reached, what to do, where cameras and target
/// stood, what each camera's corners cover and how they fit, uncertainties, the target as it is.
/// Same input, same bytes.
std::string BuildCalibrationReport(const CalibrationReportInput& input);

}  // namespace rotunda::rig
