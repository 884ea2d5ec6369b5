#pragma once

#include <optional>
#include <vector>

#include "sfm/core/calibration.h"
#include "sfm/core/camera.h"
#include "sfm/core/frame_set.h"
#include "sfm/core/ids.h"
#include "sfm/core/run_context.h"
#include "sfm/features.h"

namespace rotunda::sfm {

/// Which lens took which picture, and what is known of it before reconstruction.
struct Intrinsics {
  std::vector<CameraIntrinsics> lenses;
  std::vector<size_t> lens_of_image;  // by ImageId
  bool known = false;                 // from a calibration: two-view geometry is calibrated

  const CameraIntrinsics& of(ImageId id) const { return lenses[lens_of_image[id.index()]]; }
};

/// From the calibration when there is one (kBadInput when it lacks a camera of the set or has it at
/// another size), else SIMPLE_RADIAL with the EXIF focal length, else 1.2 x the larger side.
/// Pictures of a plain folder whose EXIF names the same camera, lens setting and size share one
/// lens.
Result<Intrinsics> BuildIntrinsics(const FrameSet& set, const Features& features,
                                   const std::optional<Calibration>& calibration);

}  // namespace rotunda::sfm
