#pragma once

#include <string>
#include <vector>

#include "rig/calibration_checks.h"
#include "sfm/core/calibration.h"

namespace rotunda::rig {

struct CalibrationDoubtOptions {
  /// Share of the corners that all cameras together lose: real ones lose up to 0.08 in a single
  /// shot (one alone: CalibrationCheckOptions::max_lost_of_camera).
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
  /// And for so many cameras at least: one or two may themselves be what is wrong.
  size_t least_misplaced_cameras = 3;
};

/// What in the pictures contradicts the board file, for the operator; empty when nothing does. Few
/// cameras that are wrong cannot bring it about. `result` may be absent: it could not be solved.
std::string DoubtOnBoard(const Board& board, const BoardSightings& sightings,
                         const RigCalibration* result, const CalibrationDoubtOptions& options);

/// What makes a calibration doubtful as a whole, though it was solved: corners that scatter, halves
/// that differ, many corners lost. A sentence each. `earlier`: one of the same cameras that lenses
/// were kept from or that it is compared with; may be absent.
std::vector<std::string> DoubtsOnFit(const Calibration& calibration,
                                     const std::vector<CameraCheck>& checks,
                                     const Calibration* earlier,
                                     const CalibrationDoubtOptions& options);

}  // namespace rotunda::rig
