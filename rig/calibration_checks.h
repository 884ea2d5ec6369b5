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
  /// A camera that loses a larger share of the corners in its pictures that were used is named. Of
  /// real cameras with a target that is not quite as described, the worst loses 0.2 in a single
  /// shot; simulated ones lose 0.003.
  double max_lost_of_camera = 0.25;
  /// Likewise of all cameras together: real ones lose up to 0.08 in a single shot.
  double max_lost = 0.1;
  /// Noise over that of the earlier calibration of the same cameras. What lens model and print
  /// leave is the same on every day: single shots of real cameras with kept lenses give 1.0 to 1.6
  /// times, lenses of another rig (focal lengths 1 % off) 17 times.
  double max_noise_growth = 3;
  /// A printed target and a lens in focus stay below a pixel: real ones reach 0.15 to 0.9 px.
  double max_rms_px = 1;
  /// Difference of the halves over what the sigmas promise. With few cameras chance makes it
  /// larger: then what it exceeds once in `1 / half_split_chance` calibrations (a camera's squared
  /// ratio counted as chi-square with one degree of freedom, its widest spread).
  double max_half_split = 2;
  double half_split_chance = 1e-3;
  /// The board file is doubted when the faces stand this many times farther from its drawing than
  /// face_position_sigma_mm says (root mean square over faces and axes: of four faces' twelve, 2 is
  /// exceeded three times in a million),
  double max_off_drawing = 2;
  /// or when in this share of a camera's pictures markers are not where it puts them, for more than
  /// that share of the cameras. A print or a damaged marker in view of some cameras, or in one shot
  /// of several, is less; of real cameras with the right board file two of four have some.
  double misplaced_pictures = 1.0 / 3;
  double misplaced_cameras = 0.5;
};

/// What a camera's corners cover, and how they fit.
struct CameraCheck {
  size_t found = 0, kept = 0;
  size_t fitting = 0;                    // of those found, in pictures that were not left out
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

/// What in the pictures contradicts the board file, for the operator; empty when nothing does. Few
/// cameras that are wrong cannot bring it about. `result` may be absent: it could not be solved.
std::string DoubtOnBoard(const Board& board, const BoardSightings& sightings,
                         const RigCalibration* result, const CalibrationCheckOptions& options);

/// What makes a calibration doubtful as a whole, though it was solved: corners that scatter, halves
/// that differ, many corners lost. A sentence each. `earlier`: one of the same cameras that lenses
/// were kept from or that it is compared with; may be absent.
std::vector<std::string> DoubtsOnFit(const Calibration& calibration,
                                     const std::vector<CameraCheck>& checks,
                                     const Calibration* earlier,
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
