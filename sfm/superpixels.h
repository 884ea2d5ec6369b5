#pragma once

#include <cstdint>
#include <vector>

#include "sfm/core/frame_set.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"

namespace rotunda::sfm {

/// One picture cut into patches of even colour. Labels are 0 .. count-1. No labels at all: the
/// frame has no picture, and nothing lies anywhere in it.
struct Superpixels {
  int width_px = 0;  // of the label map, which may be smaller than the picture
  int height_px = 0;
  double map_from_picture = 1;   // scale from picture pixels to pixels of the map
  std::vector<uint16_t> labels;  // row by row, width_px * height_px
  std::vector<std::vector<uint16_t>>
      neighbours;  // by label, sorted: those that touch it (8-connected)

  /// Patch under a position of the picture (COLMAP's pixel convention), clamped to the picture; NaN
  /// counts as 0. Not to be asked when there are no labels.
  uint16_t LabelAt(float x_px, float y_px) const;
};

struct SuperpixelOptions {
  double picture_px = 120e3;  // pixels of the reduced copy that is cut
  int count = 1000;           // patches aimed at
  Status Validate() const;
};

/// SLIC (Achanta et al., PAMI 2012) on a reduced copy of every picture; frames whose status
/// is not "ok" get no labels. Errors as BuildFeatures.
Result<std::vector<Superpixels>> BuildSuperpixels(const FrameSet& set,
                                                  const SuperpixelOptions& options,
                                                  RunContext& context);

}  // namespace rotunda::sfm
