#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace rotunda::sfm {

/// The tags of an EXIF block that say something about the focal length. Absent or unusable
/// (zero denominator, not positive) numbers are nullopt; text has no trailing blanks or zeros.
struct ExifTags {
  std::string make;
  std::string model;
  std::optional<double> focal_mm;
  std::optional<double> focal_35mm_mm;              // FocalLengthIn35mmFilm
  std::optional<double> focal_plane_x_px_per_mm;    // FocalPlaneXResolution, unit applied
  std::optional<double> pixel_width, pixel_height;  // PixelXDimension, PixelYDimension
};

/// Reads IFD0 and the EXIF IFD of a TIFF block (the bytes after "Exif\0\0" in JPEG's APP1; CIPA
/// DC-008). nullopt when the header is not TIFF's; entries that point outside of the block are left
/// out. Safe on any bytes.
std::optional<ExifTags> ParseExif(std::string_view tiff);

/// What the marker segments of a JPEG stream say (ITU T.81, annex B).
struct JpegStructure {
  bool complete = false;  // the entropy-coded data reach EOI
  std::string_view exif;  // TIFF block of the first Exif APP1 segment; empty when there is none
};

/// Walks the segments; nullopt when the bytes do not begin with SOI. Safe on any bytes; `exif`
/// points into `bytes`.
std::optional<JpegStructure> ScanJpeg(std::string_view bytes);

}  // namespace rotunda::sfm
