#include "sfm/features.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <tuple>

#include "sfm/core/rigid3.h"
#include "sfm/frame_pictures.h"

namespace rotunda::sfm {
namespace {

/// Lowe's values; the octave layers and the first blur are part of what a descriptor means.
constexpr int kOctaveLayers = 3;
constexpr double kFirstSigma_px = 1.6;
/// A keypoint whose gradient histogram has more peaks than this is a flat or cluttered spot.
constexpr int kMaxOrientations = 2;
/// Norm of a descriptor as stored.
constexpr float kDescriptorNorm = 512.0F;

/// From OpenCV 4.6's SIFT coordinates to ours. OpenCV puts pixel centres on integers (ours are
/// 0.5 further), and its SIFT doubles the picture by cv::resize, where sample i of the doubled
/// picture lies at i/2 - 1/4, but reports i/2: 0.25 too far on both axes, at every octave (the
/// octaves above take every second sample, from sample 0 on). Measured on rendered blobs in the
/// test.
constexpr float kShiftFromOpenCv_px = 0.5F - 0.25F;

bool SamePlace(const cv::KeyPoint& a, const cv::KeyPoint& b) {
  return a.pt == b.pt && a.size == b.size;
}

/// Places of the keypoints to keep: strongest first, ties by position, scale and angle; at most
/// kMaxOrientations at one place and `limit` in all.
std::vector<size_t> SelectKeypoints(const std::vector<cv::KeyPoint>& found, size_t limit) {
  std::vector<size_t> order(found.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = i;
  const auto key = [&](size_t i) {
    const cv::KeyPoint& k = found[i];
    return std::make_tuple(-k.response, k.pt.y, k.pt.x, k.size, k.angle);
  };
  std::sort(order.begin(), order.end(), [&](size_t a, size_t b) { return key(a) < key(b); });
  std::vector<size_t> kept;
  int at_place = 0;
  for (size_t i = 0; i < order.size() && kept.size() < limit; ++i) {
    const bool same = i > 0 && SamePlace(found[order[i]], found[order[i - 1]]);
    at_place = same ? at_place + 1 : 1;
    if (at_place <= kMaxOrientations) kept.push_back(order[i]);
  }
  return kept;
}

Keypoint FromOpenCv(const cv::KeyPoint& keypoint) {
  return {keypoint.pt.x + kShiftFromOpenCv_px, keypoint.pt.y + kShiftFromOpenCv_px,
          0.5F * keypoint.size, static_cast<float>(RadFromDeg(keypoint.angle))};
}

/// RootSIFT (Arandjelovic & Zisserman, CVPR 2012, section 3), scaled and rounded to bytes.
void AppendRootSift(const float* sift, std::vector<uint8_t>& descriptors) {
  float sum = 0;
  for (size_t i = 0; i < kDescriptorSize; ++i) sum += sift[i];
  for (size_t i = 0; i < kDescriptorSize; ++i) {
    const float root = sum > 0 ? kDescriptorNorm * std::sqrt(sift[i] / sum) : 0.0F;
    descriptors.push_back(static_cast<uint8_t>(std::min(255.0F, std::round(root))));
  }
}

std::array<uint8_t, 3> ColorAt(const cv::Mat& bgr, const Keypoint& keypoint) {
  const int x = std::clamp(static_cast<int>(std::floor(keypoint.x_px)), 0, bgr.cols - 1);
  const int y = std::clamp(static_cast<int>(std::floor(keypoint.y_px)), 0, bgr.rows - 1);
  const cv::Vec3b color = bgr.at<cv::Vec3b>(y, x);
  return {color[2], color[1], color[0]};
}

struct SiftFeatures {
  std::vector<cv::KeyPoint> keypoints;
  cv::Mat descriptors;
};

SiftFeatures FindSift(const cv::Mat& grey, int most, double contrast_threshold,
                      double edge_threshold) {
  const cv::Ptr<cv::SIFT> sift =
      cv::SIFT::create(most, kOctaveLayers, contrast_threshold, edge_threshold, kFirstSigma_px);
  SiftFeatures found;
  sift->detectAndCompute(grey, cv::noArray(), found.keypoints, found.descriptors);
  return found;
}

ImageFeatures Detect(const cv::Mat& bgr, const FeatureOptions& options) {
  cv::Mat grey;
  cv::cvtColor(bgr, grey, cv::COLOR_BGR2GRAY);
  SiftFeatures found =
      FindSift(grey, options.max_keypoints, options.contrast_threshold, options.edge_threshold);
  const int enough = std::min(options.enough_keypoints, options.max_keypoints);
  if (static_cast<int>(found.keypoints.size()) < enough &&
      options.faint_contrast_threshold < options.contrast_threshold) {
    found = FindSift(grey, enough, options.faint_contrast_threshold, options.edge_threshold);
  }

  ImageFeatures features;
  features.width_px = bgr.cols;
  features.height_px = bgr.rows;
  for (size_t i : SelectKeypoints(found.keypoints, static_cast<size_t>(options.max_keypoints))) {
    const Keypoint keypoint = FromOpenCv(found.keypoints[i]);
    features.keypoints.push_back(keypoint);
    features.colors_rgb.push_back(ColorAt(bgr, keypoint));
    AppendRootSift(found.descriptors.ptr<float>(static_cast<int>(i)), features.descriptors);
  }
  return features;
}

Result<ImageFeatures> FeaturesOfFrame(const FrameSet& set, ImageId id,
                                      const FeatureOptions& options) {
  const Frame& frame = set.frame(id);
  if (frame.status != "ok") return ImageFeatures{frame.width_px, frame.height_px, {}, {}, {}};
  ROTUNDA_ASSIGN_OR_RETURN(const cv::Mat bgr, ReadFramePicture(set, id));
  try {
    return Detect(bgr, options);
  } catch (const cv::Exception& exception) {
    return Error{ErrorCode::kFailed, "SIFT failed: " + exception.err, set.PicturePath(id).string()};
  }
}

/// `make(i)` for every picture of the set, on all threads; the first error in the set's order.
Result<Features> ForEveryFrame(const char* stage, const FrameSet& set, RunContext& context,
                               const std::function<Result<ImageFeatures>(size_t)>& make) {
  const size_t count = set.frames.size();
  std::vector<std::optional<Result<ImageFeatures>>> made(count);
  std::atomic<size_t> done{0};
  context.threads.ParallelFor(
      count,
      [&](size_t i) {
        made[i] = make(i);
        context.Report(stage, ++done, count);
      },
      context.stop);
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "stopped", stage};

  Features features;
  features.images.reserve(count);
  for (std::optional<Result<ImageFeatures>>& image : made) {
    if (!image->ok()) return image->error();
    features.images.push_back(std::move(**image));
  }
  return features;
}

}  // namespace

Status FeatureOptions::Validate() const {
  const auto bad = [](const std::string& what) {
    return Error{ErrorCode::kInvalidArgument, what, "features"};
  };
  if (max_keypoints < 1) {
    return bad("max_keypoints is " + std::to_string(max_keypoints) + ", expected at least 1");
  }
  if (!(contrast_threshold > 0 && contrast_threshold < 1)) {
    return bad("contrast_threshold is " + std::to_string(contrast_threshold) +
               ", expected more than 0 and less than 1");
  }
  if (enough_keypoints < 0) {
    return bad("enough_keypoints is " + std::to_string(enough_keypoints) + ", expected at least 0");
  }
  if (!(faint_contrast_threshold > 0 && faint_contrast_threshold < 1)) {
    return bad("faint_contrast_threshold is " + std::to_string(faint_contrast_threshold) +
               ", expected more than 0 and less than 1");
  }
  if (!(edge_threshold > 1)) {
    return bad("edge_threshold is " + std::to_string(edge_threshold) + ", expected more than 1");
  }
  return {};
}

Result<Features> BuildFeatures(const FrameSet& set, const FeatureOptions& options,
                               RunContext& context) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  const SerialOpenCv serial;
  return ForEveryFrame("features", set, context,
                       [&](size_t i) { return FeaturesOfFrame(set, ImageId(i), options); });
}

Result<Features> ColoredFeatures(const Features& features, const FrameSet& set,
                                 RunContext& context) {
  const SerialOpenCv serial;
  return ForEveryFrame("colours", set, context, [&](size_t i) -> Result<ImageFeatures> {
    ImageFeatures image = features.images[i];
    if (image.keypoints.empty()) return image;
    ROTUNDA_ASSIGN_OR_RETURN(const cv::Mat bgr, ReadFramePicture(set, ImageId(i)));
    if (bgr.cols != image.width_px || bgr.rows != image.height_px) {
      return Error{ErrorCode::kBadInput,
                   "picture is " + std::to_string(bgr.cols) + "x" + std::to_string(bgr.rows) +
                       ", its features are of one of " + std::to_string(image.width_px) + "x" +
                       std::to_string(image.height_px),
                   set.PicturePath(ImageId(i)).string()};
    }
    image.colors_rgb.clear();
    for (const Keypoint& keypoint : image.keypoints) {
      image.colors_rgb.push_back(ColorAt(bgr, keypoint));
    }
    return image;
  });
}

}  // namespace rotunda::sfm
