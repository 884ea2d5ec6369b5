#pragma once

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
  /// A camera that loses a larger share of the corners in its pictures that were used is named. Of
  /// real cameras with a target that is not quite as described, the worst loses 0.2 in a single
  /// shot; simulated ones lose 0.003.
  double max_lost_of_camera = 0.25;
};

/// What a camera's corners cover, and how they fit.
struct CameraCheck {
  std::string camera;
  size_t found = 0, kept = 0;
  size_t fitting = 0;                    // of those found, in pictures that were not left out
  size_t pictures = 0;                   // shots with kept corners
  double rms_px = 0;                     // root of the mean squared distance of the kept ones
  std::vector<size_t> cells;             // kept corners by cell, row by row
  std::vector<Eigen::Vector2d> mean_px;  // mean residual by cell; (0, 0) where there is none
  double covered = 0;                    // share of cells with a corner
  std::vector<std::string> advice;       // for the operator; empty when all is well

  /// Of the corners in its pictures that were used; `fitting` is not 0.
  double LostShare() const;
};
std::vector<CameraCheck> CheckCameras(const Board& board, const BoardSightings& sightings,
                                      const RigCalibration& result,
                                      const CalibrationCheckOptions& options);

}  // namespace rotunda::rig
