#pragma once

#include <string>
#include <vector>

#include "rig/rig_calibration.h"

namespace rotunda::bench {

/// A camera as Debian's mrcal-calibrate-cameras found it.
struct MrcalCamera {
  std::vector<double> intrinsics;  // fx fy cx cy k1 k2 p1 p2 [k3]; centres of pixels on integers
  Rigid3 cam_from_first;
};

struct MrcalOutcome {
  std::vector<MrcalCamera> cameras;  // as in the sightings
  std::string summary;               // its RMS and outliers
  double seconds = 0;
};

/// Gives mrcal the same corners (`views`: of a board with one face) and runs it with `lens_model`
/// ("LENSMODEL_OPENCV5", ...). Ends the program when that fails.
MrcalOutcome RunMrcal(const rig::Board& board, const rig::BoardSightings& sightings,
                      const std::vector<rig::FaceView>& views, const std::string& lens_model,
                      double focal_px);

}  // namespace rotunda::bench
