#include "sfm/intrinsics.h"

#include <algorithm>
#include <map>
#include <string>

#include "sfm/image_io.h"

namespace rotunda::sfm {
namespace {

/// COLMAP's guess where nothing is known (default_focal_length_factor).
constexpr double kDefaultFocalRatio = 1.2;

std::string SizeText(int width_px, int height_px) {
  return std::to_string(width_px) + "x" + std::to_string(height_px);
}

Result<Intrinsics> FromCalibration(const FrameSet& set, const Features& features,
                                   const Calibration& calibration) {
  Intrinsics intrinsics;
  intrinsics.known = true;
  for (size_t i = 0; i < set.frames.size(); ++i) {
    const std::string& camera = set.frames[i].camera;
    const CalibratedCamera* calibrated = calibration.Find(camera);
    if (calibrated == nullptr) {
      return Error{ErrorCode::kBadInput,
                   "the calibration '" + calibration.id + "' has no such camera",
                   "camera '" + camera + "'"};
    }
    const CameraIntrinsics& lens = calibrated->intrinsics;
    const ImageFeatures& image = features.images[i];
    const bool size_known = image.width_px > 0 && image.height_px > 0;
    if (size_known && (lens.width_px != image.width_px || lens.height_px != image.height_px)) {
      return Error{ErrorCode::kBadInput,
                   "the picture is " + SizeText(image.width_px, image.height_px) +
                       ", the calibration '" + calibration.id + "' was made at " +
                       SizeText(lens.width_px, lens.height_px),
                   "camera '" + camera + "'"};
    }
    intrinsics.lens_of_image.push_back(intrinsics.lenses.size());
    intrinsics.lenses.push_back(lens);
  }
  return intrinsics;
}

}  // namespace

Result<Intrinsics> BuildIntrinsics(const FrameSet& set, const Features& features,
                                   const std::optional<Calibration>& calibration) {
  if (features.images.size() != set.frames.size()) {
    return Error{ErrorCode::kInvalidArgument,
                 "features of " + std::to_string(features.images.size()) + " pictures, expected " +
                     std::to_string(set.frames.size()),
                 "intrinsics"};
  }
  if (calibration) return FromCalibration(set, features, *calibration);

  Intrinsics intrinsics;
  std::map<std::string, size_t> lens_of_key;
  for (size_t i = 0; i < set.frames.size(); ++i) {
    // A frame without a picture has no size; one pixel keeps its lens valid and is never used.
    const int width_px = std::max(1, features.images[i].width_px);
    const int height_px = std::max(1, features.images[i].height_px);
    const std::optional<ExifFocal> exif =
        set.plain_folder ? ReadExifFocal(set.PicturePath(ImageId(i)), width_px, height_px)
                         : std::nullopt;
    size_t lens = intrinsics.lenses.size();
    if (exif) {
      const std::string key = exif->lens_key + "/" + SizeText(width_px, height_px);
      lens = lens_of_key.emplace(key, lens).first->second;
    }
    intrinsics.lens_of_image.push_back(lens);
    if (lens < intrinsics.lenses.size()) continue;
    const double focal_px =
        exif ? exif->focal_px : kDefaultFocalRatio * std::max(width_px, height_px);
    intrinsics.lenses.push_back(DefaultIntrinsics(width_px, height_px, focal_px));
  }
  return intrinsics;
}

}  // namespace rotunda::sfm
