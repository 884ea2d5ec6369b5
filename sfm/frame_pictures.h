#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/utility.hpp>

#include "sfm/core/frame_set.h"
#include "sfm/core/result.h"

namespace rotunda::sfm {

/// OpenCV's own threads off while pictures are worked on side by side; the number of threads is a
/// global of OpenCV, so it is put back.
class SerialOpenCv {
 public:
  SerialOpenCv() : threads_(cv::getNumThreads()) { cv::setNumThreads(1); }
  ~SerialOpenCv() { cv::setNumThreads(threads_); }
  SerialOpenCv(const SerialOpenCv&) = delete;
  SerialOpenCv& operator=(const SerialOpenCv&) = delete;

 private:
  int threads_;
};

/// The frame's picture as 8-bit BGR. Errors as ReadPicture; also kBadInput: it has another size or
/// checksum than the frame set says, if that says one.
Result<cv::Mat> ReadFramePicture(const FrameSet& set, ImageId id);

}  // namespace rotunda::sfm
