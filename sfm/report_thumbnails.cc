#include "sfm/report_thumbnails.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "sfm/image_io.h"

namespace rotunda::sfm::report {
namespace {

constexpr int kLongerSide_px = 176;
constexpr int kJpegQuality = 80;

/// As many dots as still leave the picture to be seen.
constexpr size_t kMaxMarks = 400;

std::string Jpeg(const cv::Mat& picture) {
  std::vector<uint8_t> bytes;
  if (!cv::imencode(".jpg", picture, bytes, {cv::IMWRITE_JPEG_QUALITY, kJpegQuality})) return {};
  return {bytes.begin(), bytes.end()};
}

/// Hues a golden angle apart: communities with neighbouring numbers differ most.
cv::Scalar ColourOf(uint32_t community) {
  constexpr double kGoldenAngle_deg = 137.508;
  const double hue_deg = std::fmod(kGoldenAngle_deg * community, 360.0);
  const auto channel = [&](double offset) {
    const double k = std::fmod(offset + hue_deg / 60.0, 6.0);
    return 255.0 * (1.0 - std::clamp(std::min(k, 4.0 - k), 0.0, 1.0));
  };
  return {channel(1), channel(3), channel(5)};  // blue, green, red
}

Thumbnail Shrunk(const cv::Mat& picture, const std::vector<Mark>* marks) {
  const double factor =
      std::min(1.0, static_cast<double>(kLongerSide_px) / std::max(picture.cols, picture.rows));
  Thumbnail thumbnail;
  thumbnail.width_px = std::max(1, static_cast<int>(std::lround(picture.cols * factor)));
  thumbnail.height_px = std::max(1, static_cast<int>(std::lround(picture.rows * factor)));
  try {
    cv::Mat small;
    cv::resize(picture, small, {thumbnail.width_px, thumbnail.height_px}, 0, 0, cv::INTER_AREA);
    thumbnail.jpeg = Jpeg(small);
    if (marks) thumbnail.marked_jpeg = Jpeg(WithMarks(small, factor, *marks));
  } catch (const cv::Exception& exception) {
    thumbnail.problem = exception.err;
  }
  if (thumbnail.jpeg.empty() && thumbnail.problem.empty()) thumbnail.problem = "cannot be shrunk";
  return thumbnail;
}

Thumbnail MakeThumbnail(const FrameSet& set, ImageId id, const std::vector<Mark>* marks) {
  const Frame& frame = set.frame(id);
  Thumbnail none;
  if (frame.status != "ok") {
    none.problem = frame.status;
    return none;
  }
  const Result<cv::Mat> picture = ReadPicture(set.PicturePath(id), frame.pixel_format);
  if (picture) return Shrunk(*picture, marks);
  none.problem = frame.file + ": " + picture.error().message;
  return none;
}

}  // namespace

cv::Mat WithMarks(const cv::Mat& picture, double factor, const std::vector<Mark>& marks) {
  constexpr int kFractionBits = 4;
  cv::Mat marked;
  if (picture.channels() == 1) {
    cv::cvtColor(picture, marked, cv::COLOR_GRAY2BGR);
  } else {
    marked = picture.clone();
  }
  for (const Mark& mark : marks) {
    const cv::Point place(cvRound((mark.place.x() * factor - 0.5) * (1 << kFractionBits)),
                          cvRound((mark.place.y() * factor - 0.5) * (1 << kFractionBits)));
    const auto dot = [&](double radius_px, const cv::Scalar& colour) {
      cv::circle(marked, place, cvRound(radius_px * (1 << kFractionBits)), colour, cv::FILLED,
                 cv::LINE_AA, kFractionBits);
    };
    if (mark.ambiguous) dot(2.6, {0, 0, 0});
    dot(1.7, ColourOf(mark.community));
  }
  return marked;
}

Marks MarksOf(const Features& features, const Segments& segments) {
  Marks marks(features.images.size());
  for (size_t i = 0; i < marks.size(); ++i) {
    const std::vector<Keypoint>& keypoints = features.images[i].keypoints;
    for (size_t k = 0; k < keypoints.size(); ++k) {
      const std::optional<uint32_t>& segment = segments.of_keypoint[i][k];
      if (!segment) continue;
      marks[i].push_back({{keypoints[k].x_px, keypoints[k].y_px},
                          *segment,
                          segments.segments[*segment].ambiguous});
    }
    if (marks[i].size() <= kMaxMarks) continue;
    for (size_t m = 0; m < kMaxMarks; ++m) marks[i][m] = marks[i][m * marks[i].size() / kMaxMarks];
    marks[i].resize(kMaxMarks);
  }
  return marks;
}

Result<std::vector<Thumbnail>> BuildThumbnails(const FrameSet& set, const Marks& marks,
                                               RunContext& context) {
  std::vector<Thumbnail> thumbnails(set.frames.size());
  std::atomic<size_t> done = 0;
  context.threads.ParallelFor(
      set.frames.size(),
      [&](size_t i) {
        thumbnails[i] = MakeThumbnail(set, ImageId(i), marks.empty() ? nullptr : &marks[i]);
        context.Report("report", ++done, set.frames.size());
      },
      context.stop);
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "stopped", "report"};
  return thumbnails;
}

}  // namespace rotunda::sfm::report
