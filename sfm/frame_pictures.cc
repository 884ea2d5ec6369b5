#include "sfm/frame_pictures.h"

#include "sfm/core/checksum.h"
#include "sfm/core/file_io.h"
#include "sfm/image_io.h"

namespace rotunda::sfm {

Result<cv::Mat> ReadFramePicture(const FrameSet& set, ImageId id) {
  const Frame& frame = set.frame(id);
  const std::filesystem::path file = set.PicturePath(id);
  const Result<cv::Mat> read = ReadPicture(file, frame.pixel_format);
  if (!read.ok()) {
    Error error = read.error();
    if (error.code == ErrorCode::kBadInput) error.message += "; " + HowToLeaveOut(set);
    return error;
  }
  const cv::Mat& bgr = *read;
  if (!frame.xxh3.empty()) {
    ROTUNDA_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(file));
    if (const std::string found = Xxh3Text(bytes); found != frame.xxh3) {
      return Error{ErrorCode::kBadInput,
                   "the picture was changed after the capture: its checksum is " + found +
                       ", the frame set says " + frame.xxh3 + "; " + HowToLeaveOut(set),
                   file.string()};
    }
  }
  const bool size_known = frame.width_px > 0 && frame.height_px > 0;
  if (size_known && (bgr.cols != frame.width_px || bgr.rows != frame.height_px)) {
    return Error{ErrorCode::kBadInput,
                 "picture is " + std::to_string(bgr.cols) + "x" + std::to_string(bgr.rows) +
                     ", the frame set says " + std::to_string(frame.width_px) + "x" +
                     std::to_string(frame.height_px) + "; " + HowToLeaveOut(set),
                 file.string()};
  }
  return bgr;
}

}  // namespace rotunda::sfm
