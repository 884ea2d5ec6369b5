#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>

#include "sfm/core/result.h"

namespace rotunda::sfm {

/// Decodes a picture to 8-bit BGR (CV_8UC3). `pixel_format` beginning with "Bayer" is demosaiced.
/// PNG goes through libspng (strict), JPEG and the rest through OpenCV; a file that ends early, has
/// bad checksums or is not a picture is kBadInput with the path as context. EXIF orientation is not
/// applied: pixels stay where the sensor put them.
Result<cv::Mat> ReadPicture(const std::filesystem::path& file, const std::string& pixel_format);
/// The same of a file's `bytes`.
Result<cv::Mat> DecodePicture(const std::string& bytes, const std::string& pixel_format,
                              const std::filesystem::path& file);

/// 35 mm-equivalent or absolute focal length from EXIF (JPEG): FocalLengthIn35mmFilm x larger side
/// / 36 where that tag is there, else FocalLength x FocalPlaneXResolution. `lens_key` names make,
/// model and focal length, so that pictures taken with one lens setting can share intrinsics.
struct ExifFocal {
  double focal_px = 0;
  std::string lens_key;
};
std::optional<ExifFocal> ReadExifFocal(const std::filesystem::path& file, int width_px,
                                       int height_px);

}  // namespace rotunda::sfm
