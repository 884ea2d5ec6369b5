#pragma once

#include <string>
#include <vector>

#include "rig/rig_calibration.h"

namespace rotunda::bench {

/// A camera as Debian's mrcal-calibrate-cameras found it, in our conventions.
struct MrcalCamera {
  CameraIntrinsics intrinsics;
  Rigid3 cam_from_first;
};

struct MrcalOutcome {
  std::vector<MrcalCamera> cameras;  // as in the sightings
  std::string summary;               // its RMS and outliers
  double seconds = 0;
};

/// Gives mrcal the same corners (`views`: of a board with one face), weighted by their sigma_px as
/// we weight them, and runs it with `lens_model` ("LENSMODEL_OPENCV5", ...). Ends the program when
/// that fails.
MrcalOutcome RunMrcal(const rig::Board& board, const rig::BoardSightings& sightings,
                      const std::vector<rig::FaceView>& views, const std::string& lens_model,
                      double focal_px);

}  // namespace rotunda::bench
