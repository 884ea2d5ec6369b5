#include "sfm/image_io.h"

#include <spng.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <fstream>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string_view>

#include "sfm/core/camera.h"
#include "sfm/core/file_io.h"
#include "sfm/exif.h"

namespace rotunda::sfm {
namespace {

constexpr std::string_view kPngSignature("\x89PNG\r\n\x1a\n", 8);

/// The IEND chunk with its checksum. libspng does not mind when it is missing; whoever copies a
/// file in part should hear of it.
constexpr std::string_view kPngEnd("\0\0\0\0IEND\xAE\x42\x60\x82", 12);

/// Deflate makes its input at most 1032 times larger (zlib.net/zlib_tech.html).
constexpr size_t kMaxDeflateRatio = 1032;

Error NotAPicture(const std::string& what) { return {ErrorCode::kBadInput, what, ""}; }

struct SpngDeleter {
  void operator()(spng_ctx* context) const { spng_ctx_free(context); }
};
using SpngContext = std::unique_ptr<spng_ctx, SpngDeleter>;

/// A PNG's samples as 8-bit RGB, and whether the file holds grey only.
struct RgbPng {
  cv::Mat rgb;
  bool grey = false;
};

Result<SpngContext> OpenPng(const std::string& bytes, spng_ihdr& header) {
  SpngContext context(spng_ctx_new(0));
  if (!context) return Error{ErrorCode::kFailed, "no memory for the PNG decoder", ""};
  int status = spng_set_image_limits(context.get(), kMaxPictureSide_px, kMaxPictureSide_px);
  if (status == 0) status = spng_set_png_buffer(context.get(), bytes.data(), bytes.size());
  if (status == 0) status = spng_get_ihdr(context.get(), &header);
  if (status != 0) return NotAPicture(std::string("not a PNG header: ") + spng_strerror(status));
  return context;
}

/// 16-bit samples keep their high byte; alpha is dropped.
Result<RgbPng> DecodePng(const std::string& bytes) {
  spng_ihdr header{};
  ROTUNDA_ASSIGN_OR_RETURN(const SpngContext context, OpenPng(bytes, header));
  size_t raw_size = 0;
  if (spng_decoded_image_size(context.get(), SPNG_FMT_RAW, &raw_size) != 0 ||
      raw_size / kMaxDeflateRatio > bytes.size()) {
    return NotAPicture("PNG of " + std::to_string(bytes.size()) + " bytes cannot hold the " +
                       std::to_string(header.width) + "x" + std::to_string(header.height) +
                       " pixels that its header promises");
  }
  RgbPng png;
  png.grey = header.color_type == SPNG_COLOR_TYPE_GRAYSCALE ||
             header.color_type == SPNG_COLOR_TYPE_GRAYSCALE_ALPHA;
  png.rgb.create(static_cast<int>(header.height), static_cast<int>(header.width), CV_8UC3);
  const size_t size = png.rgb.total() * png.rgb.elemSize();
  int status = spng_decode_image(context.get(), png.rgb.data, size, SPNG_FMT_RGB8, 0);
  if (status != 0) {
    return NotAPicture(std::string("PNG cannot be decoded (cut short or damaged): ") +
                       spng_strerror(status));
  }
  if (bytes.rfind(kPngEnd) == std::string::npos) {
    return NotAPicture("PNG is cut short: the data end before the IEND chunk");
  }
  return png;
}

/// GenICam names a Bayer format by the first two pixels of the first row. OpenCV's RGGB codes name
/// them likewise (its older BG/GB/RG/GR codes name the second row's).
struct BayerRow {
  std::string_view prefix;
  int code;
};
constexpr std::array<BayerRow, 4> kBayerCodes = {{
    {"BayerRG", cv::COLOR_BayerRGGB2BGR_EA},
    {"BayerGR", cv::COLOR_BayerGRBG2BGR_EA},
    {"BayerBG", cv::COLOR_BayerBGGR2BGR_EA},
    {"BayerGB", cv::COLOR_BayerGBRG2BGR_EA},
}};

Result<cv::Mat> Demosaiced(const cv::Mat& mosaic, const std::string& pixel_format) {
  const auto row = std::find_if(kBayerCodes.begin(), kBayerCodes.end(), [&](const BayerRow& r) {
    return std::string_view(pixel_format).starts_with(r.prefix);
  });
  if (row == kBayerCodes.end()) {
    return NotAPicture("pixel format '" + pixel_format +
                       "' is not known; known are BayerRG, BayerGR, BayerBG, BayerGB");
  }
  cv::Mat bgr;
  cv::cvtColor(mosaic, bgr, row->code);
  return bgr;
}

/// OpenCV only warns when a JPEG stream ends early, so the stream is walked first.
Status CheckJpegComplete(const std::string& bytes) {
  const std::optional<JpegStructure> jpeg = ScanJpeg(bytes);
  if (jpeg && !jpeg->complete) {
    return NotAPicture("JPEG is cut short: the data end before the end-of-image marker");
  }
  return {};
}

Result<cv::Mat> DecodeByOpenCv(const std::string& bytes) {
  ROTUNDA_RETURN_IF_ERROR(CheckJpegComplete(bytes));
  const cv::Mat raw(1, static_cast<int>(bytes.size()), CV_8UC1, const_cast<char*>(bytes.data()));
  cv::Mat bgr = cv::imdecode(raw, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
  if (bgr.empty()) {
    return NotAPicture("not a picture that can be decoded (PNG, JPEG, TIFF, BMP, PPM are)");
  }
  return bgr;
}

Result<cv::Mat> Decode(const std::string& bytes, const std::string& pixel_format) {
  if (bytes.empty()) return NotAPicture("the file is empty, expected a picture");
  const bool bayer = pixel_format.starts_with("Bayer");
  cv::Mat bgr;
  bool grey = true;
  if (std::string_view(bytes).starts_with(kPngSignature)) {
    ROTUNDA_ASSIGN_OR_RETURN(const RgbPng png, DecodePng(bytes));
    cv::cvtColor(png.rgb, bgr, cv::COLOR_RGB2BGR);
    grey = png.grey;
  } else {
    ROTUNDA_ASSIGN_OR_RETURN(bgr, DecodeByOpenCv(bytes));
  }
  if (!bayer) return bgr;
  if (!grey) return NotAPicture("pixel format '" + pixel_format + "' in a colour picture");
  cv::Mat mosaic;
  cv::extractChannel(bgr, mosaic, 0);
  return Demosaiced(mosaic, pixel_format);
}

Result<std::string> ReadBeginning(const std::filesystem::path& file, size_t size) {
  std::ifstream stream(file, std::ios::binary);
  if (!stream) return Error{ErrorCode::kNotFound, "cannot be opened", file.string()};
  std::string bytes(size, '\0');
  stream.read(bytes.data(), static_cast<std::streamsize>(size));
  bytes.resize(static_cast<size_t>(stream.gcount()));
  return bytes;
}

/// Headers, EXIF and thumbnail come before this in every JPEG that cameras write.
constexpr size_t kHeaderBytes = 1 << 20;

}  // namespace

Result<cv::Mat> DecodePicture(const std::string& bytes, const std::string& pixel_format,
                              const std::filesystem::path& file) {
  try {
    Result<cv::Mat> picture = Decode(bytes, pixel_format);
    if (!picture.ok()) return picture.error().In(file.string());
    return picture;
  } catch (const cv::Exception& exception) {
    return Error{ErrorCode::kBadInput, "OpenCV refuses the picture: " + exception.err,
                 file.string()};
  }
}

Result<cv::Mat> ReadPicture(const std::filesystem::path& file, const std::string& pixel_format) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(file));
  return DecodePicture(bytes, pixel_format, file);
}

std::optional<ExifFocal> ReadExifFocal(const std::filesystem::path& file, int width_px,
                                       int height_px) {
  // Sanity bounds on focal length / larger side, COLMAP's (src/base/camera.h HasBogusParams).
  constexpr double kMinFocalRatio = 0.1, kMaxFocalRatio = 10.0;
  constexpr double kFilmWidth_mm = 36.0;
  const Result<std::string> bytes = ReadBeginning(file, kHeaderBytes);
  if (!bytes.ok()) return std::nullopt;
  const std::optional<JpegStructure> jpeg = ScanJpeg(*bytes);
  if (!jpeg) return std::nullopt;
  const std::optional<ExifTags> tags = ParseExif(jpeg->exif);
  if (!tags) return std::nullopt;

  const double larger_px = std::max(width_px, height_px);
  double focal_px = 0;
  if (tags->focal_35mm_mm) {
    focal_px = *tags->focal_35mm_mm * larger_px / kFilmWidth_mm;
  } else if (tags->focal_mm && tags->focal_plane_x_px_per_mm) {
    focal_px = *tags->focal_mm * *tags->focal_plane_x_px_per_mm;
    if (tags->pixel_width && tags->pixel_height) {  // the picture may have been resized since
      focal_px *= larger_px / std::max(*tags->pixel_width, *tags->pixel_height);
    }
  }
  if (!(focal_px >= kMinFocalRatio * larger_px && focal_px <= kMaxFocalRatio * larger_px)) {
    return std::nullopt;
  }
  std::array<char, 64> focal_text;
  std::snprintf(focal_text.data(), focal_text.size(), "%.3f/%.3f", tags->focal_mm.value_or(0),
                focal_px / larger_px);
  return ExifFocal{focal_px, tags->make + "/" + tags->model + "/" + focal_text.data()};
}

}  // namespace rotunda::sfm
