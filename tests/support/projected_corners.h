#pragma once

#include <cstdint>
#include <vector>

#include "rig/board.h"
#include "rig/board_sightings.h"
#include "sfm/core/calibration.h"

namespace rotunda::test {

/// A simulated rig's shots of the cuboid as a detector would report them, without rendering.
struct ProjectedOptions {
  int cameras = 90;
  int shots = 12;
  int first_placement = 0;
  double picture_scale = 1.0;
  double board_errors = 1.0;  // times sim::BoardErrors
  /// One standard deviation of each coordinate of a corner seen head-on; it grows with the slant.
  double noise_px = 0.05;
  double wrong_share = 0.003;    // of the corners, off by up to half a square
  double detected_share = 0.97;  // of the visible corners
  double max_slant_deg = 72;     // of a face that is still read
  uint64_t rig_seed = 1;         // of cameras and target
  uint64_t noise_seed = 1;
};

struct ProjectedRig {
  rig::Board board;
  Calibration truth;                   // cameras and target
  std::vector<Rigid3> rig_from_board;  // by shot
  rig::BoardSightings sightings;
};

ProjectedRig ProjectCorners(const ProjectedOptions& options);
/// The same with cameras of the caller's.
ProjectedRig ProjectCorners(const ProjectedOptions& options, const Calibration& truth);

/// Detection of one camera in one shot; `stands_at` is where the board is.
rig::BoardDetection ProjectView(const ProjectedRig& rig, const CalibratedCamera& camera,
                                const Rigid3& rig_from_board, const ProjectedOptions& options,
                                uint64_t seed);

/// Root mean square distance of all corners of the found target from the true one, after one rigid
/// motion, in millimetres.
double BoardError_mm(const rig::Board& board, const std::vector<CalibratedFace>& found,
                     const std::vector<CalibratedFace>& truth);

}  // namespace rotunda::test
