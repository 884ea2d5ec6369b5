#include "sfm/superpixels.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/ximgproc/slic.hpp>
#include <optional>
#include <string>

#include "sfm/frame_pictures.h"

namespace rotunda::sfm {
namespace {

constexpr char kStage[] = "superpixels";

/// Weight of distance in the picture against distance in colour (m of the paper, which takes 10).
constexpr float kCompactness = 10.0F;
/// The paper takes 10, for more than three times the time; its patches are only 2 % more even in
/// colour (mean deviation from the patch's colour, pictures of the rig).
constexpr int kIterations = 3;
/// Pieces smaller than this share of the mean patch become part of one beside them.
constexpr int kMinPatch_percent = 25;
/// Labels must fit their type even if every patch is as small as kMinPatch_percent allows; half of
/// that, because SLIC rounds the side of its patches to pixels.
constexpr int kMaxCount = 65536 * kMinPatch_percent / 200;
/// Smaller patches are hardly more than single pixels; SLIC's windows are whole pixels wide.
constexpr double kMinPatch_px = 9.0;

/// OpenCV's SLIC crashes on a picture that is narrower than its patches; such a one is one patch.
constexpr int kMinPatchesAcross = 2;

/// Reduced copy in CIELAB, in which SLIC measures colour.
cv::Mat ReducedLab(const cv::Mat& bgr, double scale) {
  const cv::Size size(std::max(1, cvRound(bgr.cols * scale)),
                      std::max(1, cvRound(bgr.rows * scale)));
  cv::Mat reduced, lab;
  cv::resize(bgr, reduced, size, 0, 0, cv::INTER_AREA);
  cv::cvtColor(reduced, lab, cv::COLOR_BGR2Lab);
  return lab;
}

std::vector<std::vector<uint16_t>> TouchingLabels(const Superpixels& map, size_t count) {
  std::vector<std::vector<uint16_t>> touching(count);
  const auto label = [&](int x, int y) {
    return map.labels[static_cast<size_t>(y) * map.width_px + x];
  };
  for (int y = 0; y < map.height_px; ++y) {
    for (int x = 0; x < map.width_px; ++x) {
      const auto meet = [&](int other_x, int other_y) {
        if (other_x < 0 || other_x >= map.width_px || other_y >= map.height_px) return;
        const uint16_t a = label(x, y), b = label(other_x, other_y);
        if (a == b) return;
        touching[a].push_back(b);
        touching[b].push_back(a);
      };
      meet(x + 1, y);
      meet(x - 1, y + 1);
      meet(x, y + 1);
      meet(x + 1, y + 1);
    }
  }
  for (std::vector<uint16_t>& labels : touching) {
    std::sort(labels.begin(), labels.end());
    labels.erase(std::unique(labels.begin(), labels.end()), labels.end());
  }
  return touching;
}

Superpixels Cut(const cv::Mat& bgr, const SuperpixelOptions& options) {
  const double pixels = static_cast<double>(bgr.cols) * bgr.rows;
  Superpixels map;
  map.map_from_picture = std::min(1.0, std::sqrt(options.picture_px / pixels));
  const cv::Mat lab = ReducedLab(bgr, map.map_from_picture);
  map.width_px = lab.cols;
  map.height_px = lab.rows;

  const double patch_px = static_cast<double>(lab.total()) / options.count;
  const int side_px = cvRound(std::sqrt(std::max(kMinPatch_px, patch_px)));
  if (std::min(lab.cols, lab.rows) < kMinPatchesAcross * side_px) {
    map.labels.assign(lab.total(), 0);
    map.neighbours.resize(1);
    return map;
  }
  const cv::Ptr<cv::ximgproc::SuperpixelSLIC> slic =
      cv::ximgproc::createSuperpixelSLIC(lab, cv::ximgproc::SLIC, side_px, kCompactness);
  slic->iterate(kIterations);
  slic->enforceLabelConnectivity(kMinPatch_percent);
  cv::Mat labels;
  slic->getLabels(labels);
  map.labels.assign(labels.begin<int>(), labels.end<int>());
  map.neighbours = TouchingLabels(map, static_cast<size_t>(slic->getNumberOfSuperpixels()));
  return map;
}

Result<Superpixels> SuperpixelsOfFrame(const FrameSet& set, ImageId id,
                                       const SuperpixelOptions& options) {
  if (set.frame(id).status != "ok") return Superpixels{};
  ROTUNDA_ASSIGN_OR_RETURN(const cv::Mat bgr, ReadFramePicture(set, id));
  try {
    return Cut(bgr, options);
  } catch (const cv::Exception& exception) {
    return Error{ErrorCode::kFailed, "SLIC failed: " + exception.err, set.PicturePath(id).string()};
  }
}

}  // namespace

uint16_t Superpixels::LabelAt(float x_px, float y_px) const {
  // Clamped before it becomes an integer, which it may be too large for.
  const auto place = [&](float at_px, int size_px) {
    const double on_map = std::floor(at_px * map_from_picture);
    return on_map > 0 ? static_cast<size_t>(std::min(on_map, size_px - 1.0)) : size_t{0};
  };
  return labels[place(y_px, height_px) * static_cast<size_t>(width_px) + place(x_px, width_px)];
}

Status SuperpixelOptions::Validate() const {
  const auto bad = [](const std::string& what) {
    return Error{ErrorCode::kInvalidArgument, what, kStage};
  };
  if (count < 1 || count > kMaxCount) {
    return bad("count is " + std::to_string(count) + ", expected 1 to " +
               std::to_string(kMaxCount));
  }
  if (!(picture_px >= kMinPatch_px * count && std::isfinite(picture_px))) {
    return bad("picture_px is " + std::to_string(picture_px) + ", expected at least " +
               std::to_string(static_cast<int>(kMinPatch_px)) + " times count (" +
               std::to_string(count) + ")");
  }
  return {};
}

Result<std::vector<Superpixels>> BuildSuperpixels(const FrameSet& set,
                                                  const SuperpixelOptions& options,
                                                  RunContext& context) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  const SerialOpenCv serial;
  const size_t count = set.frames.size();
  std::vector<std::optional<Result<Superpixels>>> made(count);
  std::atomic<size_t> done{0};
  context.threads.ParallelFor(
      count,
      [&](size_t i) {
        made[i] = SuperpixelsOfFrame(set, ImageId(i), options);
        context.Report(kStage, ++done, count);
      },
      context.stop);
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "stopped", kStage};

  std::vector<Superpixels> superpixels;
  superpixels.reserve(count);
  for (std::optional<Result<Superpixels>>& one : made) {
    if (!one->ok()) return one->error();
    superpixels.push_back(std::move(**one));
  }
  return superpixels;
}

}  // namespace rotunda::sfm
