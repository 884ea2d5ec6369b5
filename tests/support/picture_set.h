#pragma once

#include <opencv2/core/mat.hpp>
#include <string>

#include "sfm/core/frame_set.h"
#include "tests/support/process.h"

namespace rotunda::test {

/// A frame set of pictures made by a test, in a folder that is removed in the end.
class PictureSet {
 public:
  PictureSet() { set.folder = folder_.path(); }

  /// Written as PNG, as the picture of the next camera: "c0", "c1", ...
  void Add(const cv::Mat& picture, const std::string& status = "ok");

 private:
  TemporaryFolder folder_;

 public:
  FrameSet set;
};

}  // namespace rotunda::test
