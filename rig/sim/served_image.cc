#include "rig/sim/served_image.h"

#include <algorithm>
#include <array>
#include <mutex>
#include <opencv2/imgcodecs.hpp>

namespace rotunda::sim {
namespace {

struct FormatName {
  PixelFormat format;
  const char* name;
};
constexpr std::array<FormatName, 6> kFormats = {{{PixelFormat::kMono8, "Mono8"},
                                                 {PixelFormat::kBayerGR8, "BayerGR8"},
                                                 {PixelFormat::kBayerRG8, "BayerRG8"},
                                                 {PixelFormat::kBayerGB8, "BayerGB8"},
                                                 {PixelFormat::kBayerBG8, "BayerBG8"},
                                                 {PixelFormat::kRgb8, "RGB8"}}};

/// The channel (0 red, 1 green, 2 blue) that a sensor of a Bayer format has at a pixel. The format
/// is named after its first two pixels; red and blue stand on the other diagonal than the greens.
int BayerChannel(PixelFormat format, int x, int y) {
  const bool red_right = format == PixelFormat::kBayerGR8 || format == PixelFormat::kBayerBG8;
  const bool red_below = format == PixelFormat::kBayerGB8 || format == PixelFormat::kBayerBG8;
  return ((x ^ int{red_right}) & 1) + ((y ^ int{red_below}) & 1);
}

/// ITU-R BT.601 in units of 1/256.
uint8_t Luma(const uint8_t* rgb) {
  return static_cast<uint8_t>((77 * rgb[0] + 150 * rgb[1] + 29 * rgb[2] + 128) >> 8);
}

ServedImage BlankImage(int width_px, int height_px, PixelFormat format) {
  ServedImage image{width_px, height_px, format, {}};
  image.bytes.resize(ImageBytes(image));
  return image;
}

Result<ServedImage> DecodePicture(const std::filesystem::path& file, const std::string& format) {
  cv::Mat decoded;
  try {
    decoded = cv::imread(file.string(), cv::IMREAD_UNCHANGED | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception& e) {
    return Error{ErrorCode::kBadInput, "cannot decode: " + e.err, file.string()};
  }
  if (decoded.empty()) {
    return Error{ErrorCode::kBadInput, "expected a picture that can be decoded", file.string()};
  }
  if (decoded.type() != CV_8UC1 && decoded.type() != CV_8UC3) {
    return Error{ErrorCode::kBadInput, "expected 8-bit grey or colour without alpha",
                 file.string()};
  }
  const bool is_colour = decoded.channels() == 3;
  // A plain folder's pictures have none.
  const auto known = format.empty() ? PixelFormat::kMono8 : PixelFormatOfName(format);
  if (!is_colour && !known) {
    return Error{ErrorCode::kBadInput, "is \"" + format + "\", which simulated cameras do not have",
                 file.string()};
  }
  const PixelFormat named = known.value_or(PixelFormat::kMono8);
  ServedImage image = BlankImage(
      decoded.cols, decoded.rows,
      is_colour ? PixelFormat::kRgb8 : (named == PixelFormat::kRgb8 ? PixelFormat::kMono8 : named));
  const size_t row_bytes = static_cast<size_t>(decoded.cols) * decoded.elemSize();
  for (int y = 0; y < decoded.rows; ++y) {
    uint8_t* row = image.bytes.data() + static_cast<size_t>(y) * row_bytes;
    std::copy_n(decoded.ptr<uint8_t>(y), row_bytes, row);
    // OpenCV decodes to blue, green, red.
    for (int x = 0; is_colour && x < decoded.cols; ++x) std::swap(row[3 * x], row[3 * x + 2]);
  }
  return image;
}

/// Where a shot keeps the frames of `cameras`.
Result<std::vector<size_t>> PlacesOf(const std::vector<std::string>& cameras, const FrameSet& set) {
  std::vector<size_t> places;
  for (const std::string& camera : cameras) {
    const auto frame = std::find_if(set.frames.begin(), set.frames.end(), [&](const Frame& f) {
      return f.camera == camera && f.status == "ok";
    });
    if (frame == set.frames.end()) {
      return Error{ErrorCode::kBadInput,
                   "has no good frame of camera \"" + camera + "\", which the first shot has",
                   set.folder.string()};
    }
    places.push_back(static_cast<size_t>(frame - set.frames.begin()));
  }
  return places;
}

using Shot = std::vector<std::shared_ptr<const ServedImage>>;

Result<Shot> DecodeShot(const FrameSet& set, const std::vector<std::string>& cameras,
                        std::optional<PixelFormat> format, RunContext& context) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<size_t> places, PlacesOf(cameras, set));
  std::vector<std::optional<Result<ServedImage>>> decoded(places.size());
  context.threads.ParallelFor(
      places.size(),
      [&](size_t i) {
        const Frame& frame = set.frames[places[i]];
        decoded[i] = DecodePicture(set.folder / frame.file, frame.pixel_format);
      },
      context.stop);
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "stopped", set.folder.string()};
  Shot shot;
  for (auto& image : decoded) {
    if (!image->ok()) return image->error();
    ServedImage& value = image->value();
    shot.push_back(std::make_shared<const ServedImage>(
        format && *format != value.format ? ConvertImage(value, *format) : std::move(value)));
  }
  return shot;
}

}  // namespace

std::span<const PixelFormat> PixelFormats() {
  static constexpr auto formats = [] {
    std::array<PixelFormat, kFormats.size()> all{};
    for (size_t i = 0; i < all.size(); ++i) all[i] = kFormats[i].format;
    return all;
  }();
  return formats;
}

const char* PixelFormatName(PixelFormat format) {
  return std::find_if(kFormats.begin(), kFormats.end(),
                      [&](const FormatName& known) { return known.format == format; })
      ->name;
}

std::optional<PixelFormat> PixelFormatOfName(std::string_view name) {
  for (const FormatName& known : kFormats) {
    if (name == known.name) return known.format;
  }
  return std::nullopt;
}

std::optional<PixelFormat> PixelFormatOfCode(uint32_t code) {
  for (const FormatName& known : kFormats) {
    if (code == static_cast<uint32_t>(known.format)) return known.format;
  }
  return std::nullopt;
}

int BytesPerPixel(PixelFormat format) { return format == PixelFormat::kRgb8 ? 3 : 1; }

size_t ImageBytes(const ServedImage& image) {
  return static_cast<size_t>(image.width_px) * static_cast<size_t>(image.height_px) *
         static_cast<size_t>(BytesPerPixel(image.format));
}

ServedImage ConvertImage(const ServedImage& image, PixelFormat format) {
  ServedImage converted = BlankImage(image.width_px, image.height_px, format);
  const bool from_colour = image.format == PixelFormat::kRgb8;
  const bool to_colour = format == PixelFormat::kRgb8;
  if (from_colour == to_colour) {
    converted.bytes = image.bytes;
    return converted;
  }
  size_t pixel = 0;
  for (int y = 0; y < image.height_px; ++y) {
    for (int x = 0; x < image.width_px; ++x, ++pixel) {
      if (to_colour) {
        std::fill_n(converted.bytes.begin() + static_cast<ptrdiff_t>(3 * pixel), 3,
                    image.bytes[pixel]);
      } else {
        const uint8_t* rgb = &image.bytes[3 * pixel];
        converted.bytes[pixel] =
            format == PixelFormat::kMono8 ? Luma(rgb) : rgb[BayerChannel(format, x, y)];
      }
    }
  }
  return converted;
}

ServedImage CropImage(const ServedImage& image, const ImageRegion& region) {
  ServedImage crop = BlankImage(region.width_px, region.height_px, image.format);
  const int columns = std::min(region.width_px, image.width_px - region.x);
  const int rows = std::min(region.height_px, image.height_px - region.y);
  const auto pixel = static_cast<size_t>(BytesPerPixel(image.format));
  for (int y = 0; y < rows && columns > 0; ++y) {
    const size_t from = (static_cast<size_t>(region.y + y) * static_cast<size_t>(image.width_px) +
                         static_cast<size_t>(region.x)) *
                        pixel;
    const size_t to = static_cast<size_t>(y) * static_cast<size_t>(region.width_px) * pixel;
    std::copy_n(image.bytes.begin() + static_cast<ptrdiff_t>(from),
                static_cast<size_t>(columns) * pixel,
                crop.bytes.begin() + static_cast<ptrdiff_t>(to));
  }
  return crop;
}

FrameSource PatternSource(int width_px, int height_px) {
  return [width_px, height_px](const Exposure& exposure) {
    auto image = std::make_shared<ServedImage>(BlankImage(width_px, height_px, exposure.format));
    const size_t row_bytes = ImageBytes(*image) / static_cast<size_t>(height_px);
    const int begin = 37 * exposure.camera + 101 * exposure.shot;
    for (size_t y = 0; y < static_cast<size_t>(height_px); ++y) {
      uint8_t* row = image->bytes.data() + y * row_bytes;
      for (size_t x = 0; x < row_bytes; ++x) row[x] = static_cast<uint8_t>(begin + x + 3 * y);
    }
    return std::shared_ptr<const ServedImage>(std::move(image));
  };
}

Result<ServedShots> LoadShots(const std::vector<std::filesystem::path>& folders,
                              std::optional<PixelFormat> format, RunContext& context) {
  if (folders.empty()) return Error{ErrorCode::kInvalidArgument, "expected a frame set", ""};
  ServedShots served;
  const auto images = std::make_shared<std::vector<Shot>>();
  for (const std::filesystem::path& folder : folders) {
    ROTUNDA_ASSIGN_OR_RETURN(FrameSet set, ReadFrameSet(folder));
    if (served.shots.empty()) {
      for (const Frame& frame : set.frames) {
        if (frame.status != "ok") continue;
        served.cameras.push_back(frame.camera);
        served.serials.push_back(frame.serial);
      }
    }
    ROTUNDA_ASSIGN_OR_RETURN(Shot shot, DecodeShot(set, served.cameras, format, context));
    images->push_back(std::move(shot));
    served.shots.push_back(std::move(set));
    context.Report("decode", served.shots.size(), folders.size());
  }
  for (const Shot& shot : *images) {
    for (const auto& image : shot) {
      served.width_px = std::max(served.width_px, image->width_px);
      served.height_px = std::max(served.height_px, image->height_px);
    }
  }
  if (served.cameras.empty()) {
    return Error{ErrorCode::kBadInput, "has no good frame", folders[0].string()};
  }
  served.format = images->front().front()->format;
  served.source = [images](const Exposure& exposure) {
    const auto shot = static_cast<size_t>(std::max(0, exposure.shot)) % images->size();
    return (*images)[shot][static_cast<size_t>(exposure.camera)];
  };
  return served;
}

}  // namespace rotunda::sim
