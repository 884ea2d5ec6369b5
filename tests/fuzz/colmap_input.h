#pragma once

#include <algorithm>
#include <string>

#include "sfm/colmap_io.h"
#include "sfm/colmap_records.h"
#include "sfm/reconstruction.h"
#include "tests/fuzz/fuzz_input.h"

namespace rotunda::fuzz {

/// The three files of a model out of one input: two lines with the sizes of the first two, then
/// the files one after the other.
inline sfm::ColmapFiles SplitColmapFiles(const uint8_t* data, size_t size) {
  std::string rest(reinterpret_cast<const char*>(data), size);
  const auto take_size = [&rest] {
    const size_t end = std::min(rest.find('\n'), rest.size());
    const size_t value =
        std::strtoul(rest.substr(0, std::min<size_t>(end, 9)).c_str(), nullptr, 10);
    rest.erase(0, end + 1);
    return value;
  };
  const auto take = [&rest](size_t count) {
    const std::string taken = rest.substr(0, count);
    rest.erase(0, count);
    return taken;
  };
  const size_t cameras_size = take_size();
  const size_t images_size = take_size();
  sfm::ColmapFiles files;
  files.cameras = take(cameras_size);
  files.images = take(images_size);
  files.points = rest;
  return files;
}

/// What a reader of the model relies on.
inline void RequireSound(const sfm::ColmapModel& model) {
  const size_t images = model.reconstruction.cam_from_model.size();
  Require(model.image_names.size() == images && model.features.images.size() == images &&
              model.reconstruction.intrinsics.lens_of_image.size() == images,
          "every table has one entry an image");
  for (const size_t lens : model.reconstruction.intrinsics.lens_of_image) {
    Require(lens < model.reconstruction.intrinsics.lenses.size(), "a lens exists");
  }
  for (const sfm::Point3& point : model.reconstruction.points) {
    for (const Observation& observation : point.observations) {
      Require(observation.image.index() < images &&
                  observation.keypoint.index() <
                      model.features.image(observation.image).keypoints.size(),
              "an observation exists");
    }
  }
  sfm::SummarizeReprojection(model.reconstruction, model.features);
}

}  // namespace rotunda::fuzz
