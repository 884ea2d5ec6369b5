#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "sfm/core/frame_set.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"

namespace rotunda::sim {

/// What a simulated camera can send, with the codes of GenICam's Pixel Format Naming Convention.
enum class PixelFormat : uint32_t {
  kMono8 = 0x01080001,
  kBayerGR8 = 0x01080008,
  kBayerRG8 = 0x01080009,
  kBayerGB8 = 0x0108000A,
  kBayerBG8 = 0x0108000B,
  kRgb8 = 0x02180014,
};
std::span<const PixelFormat> PixelFormats();
const char* PixelFormatName(PixelFormat format);
std::optional<PixelFormat> PixelFormatOfName(std::string_view name);
std::optional<PixelFormat> PixelFormatOfCode(uint32_t code);
int BytesPerPixel(PixelFormat format);

/// Rows from top to bottom without padding.
struct ServedImage {
  int width_px = 0;
  int height_px = 0;
  PixelFormat format = PixelFormat::kMono8;
  std::vector<uint8_t> bytes;
};

/// How many bytes an image of its size and format has.
size_t ImageBytes(const ServedImage& image);

/// `image` as a camera set to `format` would send it: colour becomes luma or keeps one channel a
/// pixel (Bayer), grey becomes three equal channels. Bayer becomes others without interpolation,
/// each pixel its own value in all channels.
ServedImage ConvertImage(const ServedImage& image, PixelFormat format);

/// The part of `image` that begins at (x, y); what lies outside is black.
struct ImageRegion {
  int x = 0;
  int y = 0;
  int width_px = 0;
  int height_px = 0;
};
ServedImage CropImage(const ServedImage& image, const ImageRegion& region);

/// One exposure that a simulated camera asks a picture for.
struct Exposure {
  int camera = 0;  // place in CameraServerOptions::cameras
  int shot = 0;    // CameraServer::SetShot and the pulses since
  PixelFormat format = PixelFormat::kMono8;
  double exposure_us = 0;
  double gain_db = 0;
};

/// What the camera sees. Called from the server's sender thread, one call at a time, and may take
/// its time (rendering). Of any size: it is converted and cut to what the camera is set to. The
/// server holds it while the frame can still be asked for again. Nothing, or an image whose bytes
/// do not fit its size, is sent as black.
using FrameSource = std::function<std::shared_ptr<const ServedImage>(const Exposure&)>;

/// Grey ramps that differ from camera to camera and from shot to shot.
FrameSource PatternSource(int width_px, int height_px);

/// Frame sets in a row, decoded once: `shots[s]` is what the rig sees in shot s.
struct ServedShots {
  std::vector<FrameSet> shots;
  std::vector<std::string> cameras;  // of the first shot, sorted; every shot has them all
  std::vector<std::string> serials;  // beside `cameras`
  int width_px = 0;                  // largest picture
  int height_px = 0;
  PixelFormat format = PixelFormat::kMono8;
  FrameSource source;  // shot s modulo the number of shots
};

/// Reads and decodes the frames in `format` (default: that of the first frame), so that serving
/// them costs no decoding. kBadInput: a camera that is not in all of them, a picture that is
/// neither 8-bit grey nor colour, a picture's format that cameras do not have.
Result<ServedShots> LoadShots(const std::vector<std::filesystem::path>& folders,
                              std::optional<PixelFormat> format, RunContext& context);

}  // namespace rotunda::sim
