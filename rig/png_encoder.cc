#include "rig/png_encoder.h"

#include <libdeflate.h>

#include <cstring>
#include <memory>
#include <string_view>
#include <vector>

namespace rotunda::rig {
namespace {

// Portable Network Graphics, W3C 2003: section 5 (chunks), 9 (filters), 11.2.2 (IHDR).
constexpr std::string_view kSignature("\x89PNG\r\n\x1a\n", 8);
constexpr uint8_t kFilterSub = 1;  // each byte less the one a pixel to the left
constexpr uint8_t kColourGrey = 0;
constexpr uint8_t kColourRgb = 2;
constexpr uint8_t kBitDepth = 8;
constexpr int kQuickest = 1;

void AppendNumber(std::string& file, uint32_t value) {
  for (const int shift : {24, 16, 8, 0}) file.push_back(static_cast<char>(value >> shift));
}

void AppendChunk(std::string& file, std::string_view type, std::string_view data) {
  AppendNumber(file, static_cast<uint32_t>(data.size()));
  const size_t begin = file.size();
  file += type;
  file += data;
  AppendNumber(file, libdeflate_crc32(0, file.data() + begin, file.size() - begin));
}

std::string Header(const PixelsView& picture) {
  std::string header;
  AppendNumber(header, static_cast<uint32_t>(picture.width_px));
  AppendNumber(header, static_cast<uint32_t>(picture.height_px));
  header.push_back(kBitDepth);
  header.push_back(picture.channels == 1 ? kColourGrey : kColourRgb);
  header.append(3, '\0');  // deflate, adaptive filters, not interlaced
  return header;
}

/// Every row filtered, its filter's number in front.
std::vector<uint8_t> FilterRows(const PixelsView& picture) {
  const size_t row_bytes = static_cast<size_t>(picture.width_px) * picture.channels;
  const size_t step = static_cast<size_t>(picture.channels);
  std::vector<uint8_t> filtered((row_bytes + 1) * picture.height_px);
  for (int y = 0; y < picture.height_px; ++y) {
    const uint8_t* row = picture.bytes.data() + y * row_bytes;
    uint8_t* out = filtered.data() + y * (row_bytes + 1);
    *out++ = kFilterSub;
    std::memcpy(out, row, step);
    for (size_t x = step; x < row_bytes; ++x) out[x] = static_cast<uint8_t>(row[x] - row[x - step]);
  }
  return filtered;
}

}  // namespace

Result<std::string> EncodePng(const PixelsView& picture) {
  const bool has_size = picture.width_px > 0 && picture.height_px > 0 &&
                        (picture.channels == 1 || picture.channels == 3);
  const size_t expected =
      has_size ? static_cast<size_t>(picture.width_px) * picture.height_px * picture.channels : 0;
  if (!has_size || picture.bytes.size() != expected) {
    return Error{ErrorCode::kInvalidArgument,
                 std::to_string(picture.bytes.size()) + " bytes for " +
                     std::to_string(picture.width_px) + "x" + std::to_string(picture.height_px) +
                     " pixels of " + std::to_string(picture.channels) + " channels",
                 "PNG"};
  }
  const std::unique_ptr<libdeflate_compressor, void (*)(libdeflate_compressor*)> compressor(
      libdeflate_alloc_compressor(kQuickest), &libdeflate_free_compressor);
  if (!compressor) return Error{ErrorCode::kFailed, "no memory for the compressor", "PNG"};
  const std::vector<uint8_t> filtered = FilterRows(picture);
  std::string data(libdeflate_zlib_compress_bound(compressor.get(), filtered.size()), '\0');
  data.resize(libdeflate_zlib_compress(compressor.get(), filtered.data(), filtered.size(),
                                       data.data(), data.size()));
  std::string file(kSignature);
  file.reserve(data.size() + 64);
  AppendChunk(file, "IHDR", Header(picture));
  AppendChunk(file, "IDAT", data);
  AppendChunk(file, "IEND", "");
  return file;
}

}  // namespace rotunda::rig
