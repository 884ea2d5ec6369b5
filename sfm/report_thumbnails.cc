#include "sfm/report_thumbnails.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "sfm/image_io.h"

namespace rotunda::sfm::report {
namespace {

constexpr int kLongerSide_px = 176;
constexpr int kJpegQuality = 80;

Thumbnail Shrunk(const cv::Mat& picture) {
  const double factor =
      std::min(1.0, static_cast<double>(kLongerSide_px) / std::max(picture.cols, picture.rows));
  Thumbnail thumbnail;
  thumbnail.width_px = std::max(1, static_cast<int>(std::lround(picture.cols * factor)));
  thumbnail.height_px = std::max(1, static_cast<int>(std::lround(picture.rows * factor)));
  try {
    cv::Mat small;
    cv::resize(picture, small, {thumbnail.width_px, thumbnail.height_px}, 0, 0, cv::INTER_AREA);
    std::vector<uint8_t> bytes;
    if (cv::imencode(".jpg", small, bytes, {cv::IMWRITE_JPEG_QUALITY, kJpegQuality})) {
      thumbnail.jpeg.assign(bytes.begin(), bytes.end());
    }
  } catch (const cv::Exception& exception) {
    thumbnail.problem = exception.err;
  }
  if (thumbnail.jpeg.empty() && thumbnail.problem.empty()) thumbnail.problem = "cannot be shrunk";
  return thumbnail;
}

Thumbnail MakeThumbnail(const FrameSet& set, ImageId id) {
  const Frame& frame = set.frame(id);
  if (frame.status != "ok") return {0, 0, {}, frame.status};
  const Result<cv::Mat> picture = ReadPicture(set.PicturePath(id), frame.pixel_format);
  if (!picture) return {0, 0, {}, frame.file + ": " + picture.error().message};
  return Shrunk(*picture);
}

}  // namespace

Result<std::vector<Thumbnail>> BuildThumbnails(const FrameSet& set, RunContext& context) {
  std::vector<Thumbnail> thumbnails(set.frames.size());
  std::atomic<size_t> done = 0;
  context.threads.ParallelFor(
      set.frames.size(),
      [&](size_t i) {
        thumbnails[i] = MakeThumbnail(set, ImageId(i));
        context.Report("report", ++done, set.frames.size());
      },
      context.stop);
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "stopped", "report"};
  return thumbnails;
}

}  // namespace rotunda::sfm::report
