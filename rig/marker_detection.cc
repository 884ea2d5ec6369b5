#include "rig/marker_detection.h"

#include <apriltag/apriltag.h>
#include <apriltag/tag16h5.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h10.h>
#include <apriltag/tag36h11.h>

#include <algorithm>
#include <memory>
#include <opencv2/aruco.hpp>
#include <optional>
#include <tuple>

#include "rig/board.h"

namespace rotunda::rig {
namespace {

struct AprilTagFamily {
  const char* dictionary;
  apriltag_family_t* (*create)();
  void (*destroy)(apriltag_family_t*);
};
constexpr AprilTagFamily kFamilies[] = {
    {"APRILTAG_16h5", tag16h5_create, tag16h5_destroy},
    {"APRILTAG_25h9", tag25h9_create, tag25h9_destroy},
    {"APRILTAG_36h10", tag36h10_create, tag36h10_destroy},
    {"APRILTAG_36h11", tag36h11_create, tag36h11_destroy},
};

/// The library's corners go counter-clockwise from the bottom left of its own drawing of a tag;
/// OpenCV's dictionary, which our prints follow, has it turned by half.
constexpr std::array<int, 4> kLibraryCorner = {1, 0, 3, 2};

/// The library's pixel (0, 0) is the corner of the top-left pixel, as ours.
FoundMarker FromLibrary(const apriltag_detection_t& detection, const std::string& dictionary) {
  FoundMarker marker;
  marker.dictionary = dictionary;
  marker.id = detection.id;
  for (size_t k = 0; k < 4; ++k) {
    const double* p = detection.p[kLibraryCorner[k]];
    marker.corners_px[k] = Eigen::Vector2d(p[0], p[1]);
  }
  return marker;
}

Result<std::vector<FoundMarker>> DetectAprilTags(const cv::Mat& grey, const AprilTagFamily& family,
                                                 const MarkerDetectionOptions& options) {
  // Neither is thread-safe: one a call.
  const std::unique_ptr<apriltag_family_t, void (*)(apriltag_family_t*)> tags(family.create(),
                                                                              family.destroy);
  const std::unique_ptr<apriltag_detector_t, void (*)(apriltag_detector_t*)> detector(
      apriltag_detector_create(), apriltag_detector_destroy);
  if (!tags || !detector) {
    return Error{ErrorCode::kFailed, "no memory for the AprilTag detector", family.dictionary};
  }
  apriltag_detector_add_family_bits(detector.get(), tags.get(), options.max_wrong_bits);
  detector->nthreads = 1;
  detector->quad_decimate =
      std::min(grey.cols, grey.rows) >= options.min_side_to_halve_px ? 2.0f : 1.0f;
  image_u8_t image = {grey.cols, grey.rows, static_cast<int32_t>(grey.step[0]), grey.data};
  const std::unique_ptr<zarray_t, void (*)(zarray_t*)> found(
      apriltag_detector_detect(detector.get(), &image), apriltag_detections_destroy);
  std::vector<FoundMarker> markers;
  for (int i = 0; i < zarray_size(found.get()); ++i) {
    apriltag_detection_t* detection = nullptr;
    zarray_get(found.get(), i, &detection);
    markers.push_back(FromLibrary(*detection, family.dictionary));
  }
  return markers;
}

/// OpenCV's pixel centres lie on integers.
FoundMarker FromOpenCv(const std::vector<cv::Point2f>& corners, int id,
                       const std::string& dictionary) {
  FoundMarker marker;
  marker.dictionary = dictionary;
  marker.id = id;
  for (size_t k = 0; k < 4; ++k) {
    marker.corners_px[k] = Eigen::Vector2d(corners[k].x + 0.5, corners[k].y + 0.5);
  }
  return marker;
}

Result<std::vector<FoundMarker>> DetectOpenCvMarkers(const cv::Mat& grey, const std::string& name) {
  std::vector<int> ids;
  std::vector<std::vector<cv::Point2f>> corners;
  try {
    ROTUNDA_ASSIGN_OR_RETURN(const int number, OpenCvDictionary(name));
    cv::Ptr<cv::aruco::DetectorParameters> parameters = cv::aruco::DetectorParameters::create();
    parameters->cornerRefinementMethod = cv::aruco::CORNER_REFINE_SUBPIX;
    parameters->cornerRefinementWinSize = 3;
    cv::aruco::detectMarkers(grey, cv::aruco::getPredefinedDictionary(number), corners, ids,
                             parameters);
  } catch (const cv::Exception& exception) {
    return Error{ErrorCode::kFailed, "OpenCV's marker detector: " + exception.err, name};
  }
  std::vector<FoundMarker> markers;
  for (size_t i = 0; i < ids.size(); ++i) {
    markers.push_back(FromOpenCv(corners[i], ids[i], name));
  }
  return markers;
}

}  // namespace

double FoundMarker::Side_px() const {
  double side = (corners_px[3] - corners_px[0]).norm();
  for (size_t k = 0; k < 3; ++k) {
    side = std::min(side, (corners_px[k + 1] - corners_px[k]).norm());
  }
  return side;
}

Result<std::vector<FoundMarker>> DetectMarkers(const cv::Mat& grey, const std::string& dictionary,
                                               const MarkerDetectionOptions& options) {
  const auto family =
      std::find_if(std::begin(kFamilies), std::end(kFamilies),
                   [&](const AprilTagFamily& f) { return dictionary == f.dictionary; });
  Result<std::vector<FoundMarker>> markers = family != std::end(kFamilies)
                                                 ? DetectAprilTags(grey, *family, options)
                                                 : DetectOpenCvMarkers(grey, dictionary);
  if (!markers) return markers;
  const auto order = [](const FoundMarker& m) {
    return std::tuple(m.id, m.corners_px[0].x(), m.corners_px[0].y());
  };
  std::sort(markers->begin(), markers->end(),
            [&](const FoundMarker& a, const FoundMarker& b) { return order(a) < order(b); });
  return markers;
}

}  // namespace rotunda::rig
