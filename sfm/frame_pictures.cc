#include "sfm/frame_pictures.h"

#include "sfm/core/checksum.h"
#include "sfm/core/file_io.h"
#include "sfm/image_io.h"

namespace rotunda::sfm {

namespace {

Result<cv::Mat> Checked(const Frame& frame, const std::filesystem::path& file) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(file));
  ROTUNDA_ASSIGN_OR_RETURN(const cv::Mat bgr, DecodePicture(bytes, frame.pixel_format, file));
  if (const std::string changed = ChecksumProblem(bytes, frame.xxh3); !changed.empty()) {
    return Error{ErrorCode::kBadInput, changed, file.string()};
  }
  const bool size_known = frame.width_px > 0 && frame.height_px > 0;
  if (size_known && (bgr.cols != frame.width_px || bgr.rows != frame.height_px)) {
    return Error{ErrorCode::kBadInput,
                 "picture is " + std::to_string(bgr.cols) + "x" + std::to_string(bgr.rows) +
                     ", the frame set says " + std::to_string(frame.width_px) + "x" +
                     std::to_string(frame.height_px),
                 file.string()};
  }
  return bgr;
}

}  // namespace

Result<cv::Mat> ReadFramePicture(const FrameSet& set, ImageId id) {
  Result<cv::Mat> bgr = Checked(set.frame(id), set.PicturePath(id));
  if (bgr.ok() || bgr.error().code != ErrorCode::kBadInput) return bgr;
  Error error = bgr.error();
  error.message += "; " + HowToLeaveOut(set);
  return error;
}

}  // namespace rotunda::sfm
