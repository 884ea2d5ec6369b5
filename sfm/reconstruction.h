#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "sfm/core/camera.h"
#include "sfm/core/ids.h"
#include "sfm/core/rigid3.h"
#include "sfm/features.h"
#include "sfm/intrinsics.h"

namespace rotunda::sfm {

struct Point3 {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // model frame
  std::vector<Observation> observations;               // sorted by image, at most one a picture
  std::array<uint8_t, 3> color_rgb = {0, 0, 0};
};

/// Poses and points in one frame ("model": arbitrary, or the rig's after alignment).
struct Reconstruction {
  Intrinsics intrinsics;                              // refined where that was asked for
  std::vector<std::optional<Rigid3>> cam_from_model;  // by ImageId; nullopt: not registered
  std::vector<Point3> points;

  bool Registered(ImageId id) const { return cam_from_model[id.index()].has_value(); }
};

size_t RegisteredCount(const Reconstruction& reconstruction);

/// Pixel distance between keypoint and projection; nullopt when the point is behind the camera.
std::optional<double> ReprojectionError_px(const Reconstruction& reconstruction,
                                           const Features& features, const Point3& point,
                                           const Observation& observation);

struct ImageResidual {
  size_t observations = 0;
  double rms_px = 0;
};
struct ReprojectionSummary {
  size_t observations = 0;
  double rms_px = 0;                  // over all observations, root of mean squared distance
  double mean_over_points_px = 0;     // mean over points of the mean over the point's observations
  std::vector<ImageResidual> images;  // by ImageId
};
ReprojectionSummary SummarizeReprojection(const Reconstruction& reconstruction,
                                          const Features& features);

/// The reconstruction in another frame.
Reconstruction Transformed(const Reconstruction& reconstruction, const Sim3& target_from_model);

/// Sets every point's colour to the mean of its keypoints' colours.
Reconstruction WithColors(Reconstruction reconstruction, const Features& features);

}  // namespace rotunda::sfm
