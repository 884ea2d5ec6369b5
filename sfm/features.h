#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "sfm/core/frame_set.h"
#include "sfm/core/ids.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"

namespace rotunda::sfm {

/// Position in COLMAP's pixel convention ((0.5, 0.5) is the centre of the top-left pixel).
struct Keypoint {
  float x_px = 0;
  float y_px = 0;
  float scale_px = 0;  // sigma of the Gaussian at which it was found, in pixels of the full picture
  float orientation_rad = 0;
};

inline constexpr size_t kDescriptorSize = 128;

struct ImageFeatures {
  int width_px = 0;
  int height_px = 0;
  std::vector<Keypoint> keypoints;  // strongest first, ties by position
  std::vector<uint8_t>
      descriptors;  // kDescriptorSize bytes a keypoint: round(512 sqrt(d / |d|_1)), at most 255
  std::vector<std::array<uint8_t, 3>> colors_rgb;  // of the picture at each keypoint
};

/// One entry a picture of the frame set, in its order.
struct Features {
  std::vector<ImageFeatures> images;
  const ImageFeatures& image(ImageId id) const { return images[id.index()]; }
};

struct FeatureOptions {
  int max_keypoints = 8192;
  /// Difference-of-Gaussians contrast, grey values in [0, 1], before OpenCV's division by the
  /// number of layers. OpenCV's default 0.04 finds too little on cloth and skin; 0.02 is COLMAP's.
  double contrast_threshold = 0.02;
  /// A picture with fewer keypoints is searched again for the strongest of so many down to the
  /// faint threshold: plain cloth and skin have no others. On rendered captures of 600x800 twice
  /// the keypoints made the poses two to three times as accurate.
  int enough_keypoints = 2000;
  double faint_contrast_threshold = 0.0067;
  double edge_threshold = 10.0;
  Status Validate() const;
};

/// SIFT (Lowe, IJCV 2004) with RootSIFT normalisation (Arandjelovic & Zisserman, CVPR 2012).
/// Pictures whose frame status is not "ok" get no keypoints. kBadInput: a picture cannot be decoded
/// (truncated, not a picture) or has another size than the frame set says; the context names the
/// file.
Result<Features> BuildFeatures(const FrameSet& set, const FeatureOptions& options,
                               RunContext& context);

/// The same features with colours taken from the set's pictures, for those that came without
/// pictures (a COLMAP database). Errors as BuildFeatures.
Result<Features> ColoredFeatures(const Features& features, const FrameSet& set,
                                 RunContext& context);

}  // namespace rotunda::sfm
