#pragma once

#include <opencv2/core/mat.hpp>

#include "sfm/colmap_io.h"

namespace rotunda::bench {

/// A COLMAP model from above, 8-bit BGR: points in their colours, cameras as numbered wedges
/// (numbers: their order by name). "Above" is against the mean of the cameras' downward axes.
cv::Mat LayoutDrawing(const sfm::ColmapModel& model);

}  // namespace rotunda::bench
