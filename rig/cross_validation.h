#pragma once

#include <optional>

#include "rig/rig_calibration.h"

namespace rotunda::rig {

struct CrossValidationOptions {
  int folds = 4;  // of the held-out shots
};

/// Calibrations that did not see all corners, each started from the whole one.
struct CrossValidation {
  /// Distances of corners from where a calibration without their shot puts them, the shot's pose
  /// alone being fitted to them; with few shots, corners and not shots are held out. nullopt: no
  /// camera has enough corners for that.
  std::optional<double> held_out_rms_px, held_out_p95_px;
  size_t held_out_corners = 0;
  bool by_shots = false;  // whether shots (else every other corner) were held out and split
  /// Two calibrations from one half each: differences over their predicted standard deviation, root
  /// mean square over cameras. About 1 when sigmas are honest. nullopt: a half has too little.
  std::optional<double> rotation_ratio, position_ratio;
  double half_rotation_deg = 0, half_position_mm = 0;  // mean differences of the halves
};
Result<CrossValidation> CrossValidate(const Board& board, const RigCalibration& result,
                                      const CrossValidationOptions& options, RunContext& context);

}  // namespace rotunda::rig
