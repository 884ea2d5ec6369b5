#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "daemon/jobs.h"
#include "daemon/store.h"
#include "rig/board.h"
#include "rig/board_sightings.h"
#include "rig/calibration_checks.h"
#include "rig/calibration_comparison.h"
#include "rig/cross_validation.h"
#include "rig/rig_calibration.h"
#include "sfm/core/calibration.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"

namespace rotunda::daemon {

/// An earlier calibration, and what messages call it: its file, or its id in the store.
struct EarlierCalibration {
  Calibration calibration;
  std::string name;
};

/// What a calibration is made from.
struct CalibrationTask {
  rig::Board board;
  std::string board_name = "the board file";     // in messages
  std::vector<std::filesystem::path> framesets;  // as rig::FindShots takes them
  rig::LensModel model = rig::LensModel::kOpencv;
  /// Lenses, rig frame and target held as they were; refused when that was another target.
  std::optional<EarlierCalibration> intrinsics_from;
  std::optional<EarlierCalibration> frame_from;  // rig frame
  std::optional<EarlierCalibration> compare;     // name the cameras that moved since
  /// Whether `compare` was asked for: one of another target or rig is refused then before the work;
  /// else it makes a note at most.
  bool compare_asked_for = true;
  std::string not_compared;  // why there is no `compare` though there should be; a note
};

struct CalibrationOutcome {
  Calibration calibration;  // id and time are those of the newest shot; empty when none says
  rig::BoardSightings sightings;
  rig::RigCalibration result;
  rig::CrossValidation validation;
  std::vector<rig::CameraCheck> checks;
  std::optional<rig::CalibrationComparison> comparison;
  std::vector<std::string> notes;  // what the operator is to know or do

  size_t ShotsUsed() const;
  /// What moved since `compare`, in words; nullopt when there was nothing to compare with.
  std::optional<std::vector<std::string>> Changes() const;
};

/// kCancelled when stopped.
Result<CalibrationOutcome> MakeCalibration(const CalibrationTask& task, RunContext& context);

/// The page about it (HTML).
std::string CalibrationPage(const CalibrationTask& task, const CalibrationOutcome& outcome);

/// "charuco-20260118T101500Z" for "2026-01-18T10:15:00Z".
std::string CalibrationIdOf(const std::string& created_at);

struct CalibrationJobOptions {
  std::filesystem::path board;  // TOML file of the target
  int threads = 0;              // 0: the machine's cores
};

/// Jobs with bodies as CalibrationRequest. Compared with the one in
/// force unless said otherwise. Result: {"calibration", "calibrated", "of", "shots", "shots_used",
/// "corners", "kept", "rms_px", "notes", "changes"?}. It is not in force before it is activated.
JobHandler MakeCalibrationHandler(Store& store, CalibrationJobOptions options);

}  // namespace rotunda::daemon
