#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "sfm/colmap_io.h"
#include "sfm/core/camera.h"
#include "sfm/core/result.h"

// The three files of a COLMAP 3.8 model as they stand on disk (src/base/reconstruction.cc there).
// Used by colmap_model.cc alone; apart so that decoding can be tested on bytes.

namespace rotunda::sfm {

inline constexpr uint64_t kColmapNoPoint = UINT64_MAX;  // "-1" in text

struct ColmapCamera {
  uint32_t id = 0;
  CameraIntrinsics intrinsics;
};

struct ColmapPoint2 {
  double x_px = 0;
  double y_px = 0;
  uint64_t point_id = kColmapNoPoint;
};

/// Rotation and translation are cam_from_model.
struct ColmapImage {
  uint32_t id = 0;
  std::array<double, 4> rotation_wxyz = {1, 0, 0, 0};
  std::array<double, 3> translation = {0, 0, 0};
  uint32_t camera_id = 0;
  std::string name;
  std::vector<ColmapPoint2> points;
};

struct ColmapTrackElement {
  uint32_t image_id = 0;
  uint32_t point_index = 0;  // in ColmapImage::points
};

struct ColmapPoint3 {
  uint64_t id = 0;
  std::array<double, 3> position = {0, 0, 0};
  std::array<uint8_t, 3> color_rgb = {0, 0, 0};
  double error_px = 0;  // mean reprojection error over the track
  std::vector<ColmapTrackElement> track;
};

struct ColmapRecords {
  std::vector<ColmapCamera> cameras;
  std::vector<ColmapImage> images;
  std::vector<ColmapPoint3> points;
};

/// Bytes of cameras, images and points3D (.bin or .txt).
struct ColmapFiles {
  std::string cameras;
  std::string images;
  std::string points;
};

ColmapFiles EncodeColmapBinary(const ColmapRecords& records);
/// kInvalidArgument when an image's name has white space: the text format ends a name there.
Result<ColmapFiles> EncodeColmapText(const ColmapRecords& records);

/// kBadInput, the context being the file's name and the record: cut short, too long, a number out
/// of range. References between records are not looked at.
Result<ColmapRecords> DecodeColmapBinary(const ColmapFiles& files);
Result<ColmapRecords> DecodeColmapText(const ColmapFiles& files);

/// Checks the references and turns the records into a model; errors name the files with `ending`.
Result<ColmapModel> ModelOfRecords(const ColmapRecords& records, const std::string& ending);

}  // namespace rotunda::sfm
