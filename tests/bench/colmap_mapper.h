#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "sfm/core/calibration.h"
#include "sfm/core/frame_set.h"
#include "sfm/core/pose_set.h"
#include "sfm/features.h"
#include "sfm/two_view.h"

namespace rotunda::bench {

/// Gives every camera of colmap's database the calibrated intrinsics, marked as known.
void WriteKnownIntrinsics(const std::filesystem::path& database, const FrameSet& set,
                          const Calibration& calibration);

/// What colmap's mapper is given so that it starts from our matches.
struct MapperInput {
  const FrameSet& set;
  const Calibration& calibration;  // known intrinsics
  const sfm::Features& features;
  const sfm::TwoViews& two_views;
};
/// Writes a new COLMAP 3.8 database: a camera and an image a frame (id: place in the set + 1; name:
/// file without its folder), keypoints, and the inliers as matches and as verified geometry.
void WriteMatchedDatabase(const std::filesystem::path& database, const MapperInput& input);

/// The call of colmap's incremental mapper with intrinsics that stay as they are.
std::vector<std::string> MapperCommand(const std::filesystem::path& database,
                                       const std::filesystem::path& pictures,
                                       const std::filesystem::path& models);

struct MapperModels {
  PoseSet largest;  // its cameras: those of the truth
  size_t count = 0;
};
/// What the mapper wrote; images are cameras' names with an ending.
MapperModels ReadMapperModels(const std::filesystem::path& models, const Calibration& truth);

}  // namespace rotunda::bench
