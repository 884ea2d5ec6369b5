#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "sfm/core/result.h"

namespace cv {
class Mat;
}

namespace rotunda::rig {

/// A marker as a detector found it. `corners_px`: top-left, top-right, bottom-right, bottom-left as
/// printed; (0.5, 0.5) is the centre of the top-left pixel. To a fraction of a pixel.
struct FoundMarker {
  std::string dictionary;
  int id = -1;
  std::array<Eigen::Vector2d, 4> corners_px;

  Eigen::Vector2d Centre_px() const {
    return 0.25 * (corners_px[0] + corners_px[1] + corners_px[2] + corners_px[3]);
  }
  /// Shortest side.
  double Side_px() const;
};

struct MarkerDetectionOptions {
  /// Wrong bits of an AprilTag that are put right. The codes of 36h11 differ in 11, so 2 invents
  /// next to nothing; other dictionaries are read as OpenCV reads them.
  int max_wrong_bits = 2;
  /// Pictures whose shorter side has at least this many pixels are searched for quads at half size
  /// (bits and edges are read at full size): AprilTags then take half the time, and in pictures of
  /// 1200x1600 the loss is below 1 %.
  int min_side_to_halve_px = 1000;
};

/// All markers of one dictionary (as BoardFace::dictionary) in a CV_8UC1 picture, sorted by id,
/// then place. AprilTag 16h5, 25h9, 36h10 and 36h11 are read by libapriltag, the others by OpenCV.
Result<std::vector<FoundMarker>> DetectMarkers(const cv::Mat& grey, const std::string& dictionary,
                                               const MarkerDetectionOptions& options);

}  // namespace rotunda::rig
