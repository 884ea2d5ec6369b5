#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rig/board_sightings.h"
#include "rig/calibration_result.h"

namespace rotunda::bench {

/// A calibration as the command makes it, with the time of each stage.
struct CalibrationRun {
  rig::RigCalibration result;
  rig::CrossValidation validation;
  Calibration file;
  std::string times;   // by stage
  double seconds = 0;  // of all stages
};

struct CalibrationRunOptions {
  const Calibration* intrinsics_from = nullptr;
  rig::LensModel model = rig::LensModel::kOpencv;
  bool validate = true;
};

/// Ends the program when the calibration fails.
CalibrationRun Calibrate(const rig::Board& board, const rig::BoardSightings& sightings,
                         const CalibrationRunOptions& options, ThreadPool& threads);

/// What makes the calibration or the board file doubtful, a sentence each.
std::vector<std::string> DoubtsOn(const rig::Board& board, const rig::BoardSightings& sightings,
                                  const CalibrationRun& run);

/// The board in all pictures of a folder of shots, and how long that took.
struct TimedSightings {
  rig::BoardSightings sightings;
  size_t pictures = 0;
  double seconds = 0;
  double cores = 0;  // processor time over the time that passed

  std::string TimeText() const;
};
TimedSightings Detect(const std::filesystem::path& folder, const rig::Board& board,
                      ThreadPool& threads);

/// Means over the cameras.
struct TruthErrors {
  double found = 0;  // share of the cameras
  double rotation_deg = 0, position_mm = 0, focal_percent = 0, board_mm = 0;
  double rotation_ratio = 0, position_ratio = 0;  // (measured / predicted)^2
};

/// A row of errors, under the heading.
void PrintTruthHeading();
TruthErrors PrintAgainstTruth(const rig::Board& board, const CalibrationRun& run,
                              const Calibration& truth, const std::string& name);

}  // namespace rotunda::bench
