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

/// Where nothing is known; valid also for a frame without a picture, which may have no size.
CameraIntrinsics GuessedLens(const ImageFeatures& image) {
  const int width_px = std::max(1, image.width_px), height_px = std::max(1, image.height_px);
  return DefaultIntrinsics(width_px, height_px, kDefaultFocalRatio * std::max(width_px, height_px));
}

Result<Intrinsics> FromCalibration(const FrameSet& set, const Features& features,
                                   const Calibration& calibration) {
  Intrinsics intrinsics;
  intrinsics.known = true;
  for (size_t i = 0; i < set.frames.size(); ++i) {
    const std::string& camera = set.frames[i].camera;
    const ImageFeatures& image = features.images[i];
    const CalibratedCamera* calibrated = calibration.Find(camera);
    if (calibrated == nullptr && set.frames[i].status == "ok") {
      return Error{
          ErrorCode::kBadInput,
          "the calibration '" + calibration.id + "' has no such camera; " + HowToLeaveOut(set),
          "camera '" + camera + "'"};
    }
    const CameraIntrinsics lens = calibrated ? calibrated->intrinsics : GuessedLens(image);
    const bool used = set.frames[i].status == "ok" && image.width_px > 0 && image.height_px > 0;
    if (used && (lens.width_px != image.width_px || lens.height_px != image.height_px)) {
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
    CameraIntrinsics guess = GuessedLens(features.images[i]);
    const int width_px = guess.width_px, height_px = guess.height_px;
    const std::optional<ExifFocal> exif =
        set.plain_folder ? ReadExifFocal(set.PicturePath(ImageId(i)), width_px, height_px)
                         : std::nullopt;
    size_t lens = intrinsics.lenses.size();
    if (exif) {
      const std::string key = exif->lens_key + "/" + SizeText(width_px, height_px);
      lens = lens_of_key.emplace(key, lens).first->second;
      guess = DefaultIntrinsics(width_px, height_px, exif->focal_px);
    }
    intrinsics.lens_of_image.push_back(lens);
    if (lens == intrinsics.lenses.size()) intrinsics.lenses.push_back(guess);
  }
  return intrinsics;
}

}  // namespace rotunda::sfm
