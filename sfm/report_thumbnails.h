#pragma once

#include <string>
#include <vector>

#include "sfm/core/frame_set.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"

namespace rotunda::sfm::report {

struct Thumbnail {
  int width_px = 0;
  int height_px = 0;
  std::string jpeg;     // empty when there is no picture to show
  std::string problem;  // why, plain text
};

/// One small picture a frame, in order. A picture that cannot be read is a `problem`, not an
/// error. kCancelled when the context was stopped.
Result<std::vector<Thumbnail>> BuildThumbnails(const FrameSet& set, RunContext& context);

}  // namespace rotunda::sfm::report
