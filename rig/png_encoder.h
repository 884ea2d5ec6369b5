#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "sfm/core/result.h"

namespace rotunda::rig {

/// 8-bit pixels, row by row without padding; one channel (grey, or Bayer as the sensor gave it) or
/// three (RGB).
struct PixelsView {
  std::span<const uint8_t> bytes;
  int width_px = 0;
  int height_px = 0;
  int channels = 1;
};

/// The picture as the bytes of a PNG file. Lossless, and for speed: sensor noise does not compress,
/// so one cheap filter and the quickest search (libdeflate level 1) give what zlib's level 1 gives
/// in a third of its time. kInvalidArgument: sizes that do not fit together.
Result<std::string> EncodePng(const PixelsView& picture);

}  // namespace rotunda::rig
