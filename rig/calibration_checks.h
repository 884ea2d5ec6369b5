#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "rig/rig_calibration.h"

namespace rotunda::rig {

struct CalibrationCheckOptions {
  /// Cells of the coverage grid over the picture's sides.
  int cells_across = 6, cells_down = 8;
  /// A part of the picture (a third of its height or width) is uncovered with fewer of its cells
  /// holding a corner.
  double min_covered = 0.25;
  /// Uncertainties above these are named, with what to do: a share of the focal length, and where
  /// a point of the rig appears.
  double max_focal_sigma = 0.002;
  double max_projection_px = 0.3;
  /// Error over the noise of a whole camera that is named.
  double max_rms_ratio = 2.0;
  int folds = 4;  // of the held-out shots
};

/// What a camera's corners cover, and how they fit.
struct CameraCheck {
  size_t found = 0, kept = 0;
  size_t pictures = 0;                   // shots with kept corners
  double rms_px = 0;                     // root of the mean squared distance of the kept ones
  std::vector<size_t> cells;             // kept corners by cell, row by row
  std::vector<Eigen::Vector2d> mean_px;  // mean residual by cell; (0, 0) where there is none
  double covered = 0;                    // share of cells with a corner
  std::vector<std::string> advice;       // for the operator; empty when all is well
};
std::vector<CameraCheck> CheckCameras(const Board& board, const BoardSightings& sightings,
                                      const RigCalibration& result,
                                      const CalibrationCheckOptions& options);

/// Calibrations that did not see all corners, each started from the whole one.
struct CrossValidation {
  /// Distances of corners from where a calibration without their shot puts them, the shot's pose
  /// alone being fitted to them; with a single shot, corners and not shots are held out.
  double held_out_rms_px = 0, held_out_p95_px = 0;
  size_t held_out_corners = 0;
  bool by_shots = false;  // whether shots (else every other corner) were held out and split
  /// Two calibrations from one half each: differences over their predicted standard deviation, root
  /// mean square over cameras. About 1 when sigmas are honest. nullopt: a half has too little.
  std::optional<double> rotation_ratio, position_ratio;
  double half_rotation_deg = 0, half_position_mm = 0;  // mean differences of the halves
};
Result<CrossValidation> CrossValidate(const Board& board, const RigCalibration& result,
                                      const CalibrationCheckOptions& options, RunContext& context);

}  // namespace rotunda::rig
