#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "sfm/core/frame_set.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"
#include "sfm/features.h"
#include "sfm/segments.h"

namespace rotunda::sfm::report {

struct Thumbnail {
  int width_px = 0;
  int height_px = 0;
  std::string jpeg;         // empty when there is no picture to show
  std::string marked_jpeg;  // the same with its marks; empty without marks
  std::string problem;      // why there is no picture, plain text
};

/// A keypoint to be drawn: a dot in its community's colour, with a dark rim when the community
/// looks like another.
struct Mark {
  Eigen::Vector2d place;  // pixels of the whole picture
  uint32_t community = 0;
  bool ambiguous = false;
};
using Marks = std::vector<std::vector<Mark>>;  // by ImageId

/// Of every picture the keypoints that belong to a segment, evenly thinned to what a small picture
/// can show.
Marks MarksOf(const Features& features, const Segments& segments);

/// A copy of the picture, 8-bit grey or BGR, with its marks. `factor`: its pixels in one of the
/// whole picture.
cv::Mat WithMarks(const cv::Mat& picture, double factor, const std::vector<Mark>& marks);

/// One small picture a frame, in order. A picture that cannot be read is a `problem`, not an
/// error. kCancelled when the context was stopped. `marks`: by frame, or empty.
Result<std::vector<Thumbnail>> BuildThumbnails(const FrameSet& set, const Marks& marks,
                                               RunContext& context);

}  // namespace rotunda::sfm::report
