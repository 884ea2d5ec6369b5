#include "sfm/exif.h"

#include <array>
#include <cstdint>

namespace rotunda::sfm {
namespace {

enum TiffType : uint16_t { kAscii = 2, kShort = 3, kLong = 4, kRational = 5 };

enum Tag : uint16_t {
  kMake = 0x010F,
  kModel = 0x0110,
  kExifIfd = 0x8769,
  kFocalLength = 0x920A,
  kPixelXDimension = 0xA002,
  kPixelYDimension = 0xA003,
  kFocalPlaneXResolution = 0xA20E,
  kFocalPlaneResolutionUnit = 0xA210,
  kFocalLengthIn35mmFilm = 0xA405,
};

/// Bounds-checked numbers of a TIFF block in its byte order.
class TiffReader {
 public:
  TiffReader(std::string_view bytes, bool big_endian) : bytes_(bytes), big_endian_(big_endian) {}

  std::optional<uint32_t> Number(size_t offset, size_t size) const {
    if (offset > bytes_.size() || bytes_.size() - offset < size) return std::nullopt;
    uint32_t value = 0;
    for (size_t i = 0; i < size; ++i) {
      const size_t place = big_endian_ ? i : size - 1 - i;
      value = (value << 8) | static_cast<uint8_t>(bytes_[offset + place]);
    }
    return value;
  }
  std::optional<uint32_t> U16(size_t offset) const { return Number(offset, 2); }
  std::optional<uint32_t> U32(size_t offset) const { return Number(offset, 4); }

  std::string Text(size_t offset, size_t size) const {
    if (offset > bytes_.size() || bytes_.size() - offset < size) return {};
    std::string text(bytes_.substr(offset, size));
    text.resize(std::min(text.size(), text.find('\0')));
    while (!text.empty() && text.back() == ' ') text.pop_back();
    return text;
  }

 private:
  std::string_view bytes_;
  bool big_endian_;
};

/// One directory entry: where its value lies.
struct Entry {
  uint32_t tag, type, count;
  size_t value_offset;  // of the value, or of the offset to it when it does not fit in 4 bytes
};

std::optional<double> PositiveNumber(const TiffReader& reader, const Entry& entry) {
  if (entry.count < 1) return std::nullopt;
  std::optional<double> value;
  if (entry.type == kShort) {
    if (const auto number = reader.U16(entry.value_offset)) value = *number;
  } else if (entry.type == kLong) {
    if (const auto number = reader.U32(entry.value_offset)) value = *number;
  } else if (entry.type == kRational) {
    const auto where = reader.U32(entry.value_offset);
    if (!where) return std::nullopt;
    const auto numerator = reader.U32(*where);
    const auto denominator = reader.U32(size_t{*where} + 4);
    if (numerator && denominator && *denominator != 0) {
      value = static_cast<double>(*numerator) / *denominator;
    }
  }
  return value && *value > 0 ? value : std::nullopt;
}

std::string Text(const TiffReader& reader, const Entry& entry) {
  if (entry.type != kAscii) return {};
  if (entry.count <= 4) return reader.Text(entry.value_offset, entry.count);
  const auto where = reader.U32(entry.value_offset);
  return where ? reader.Text(*where, entry.count) : std::string();
}

template <typename Visit>
void ForEachEntry(const TiffReader& reader, size_t ifd_offset, const Visit& visit) {
  constexpr size_t kEntrySize = 12;
  const auto count = reader.U16(ifd_offset);
  if (!count) return;
  for (size_t i = 0; i < *count; ++i) {
    const size_t at = ifd_offset + 2 + i * kEntrySize;
    const auto tag = reader.U16(at);
    const auto type = reader.U16(at + 2);
    const auto values = reader.U32(at + 4);
    if (!tag || !type || !values) return;
    visit(Entry{*tag, *type, *values, at + 8});
  }
}

/// Millimetres in a FocalPlaneResolutionUnit; EXIF's default is the inch.
double MillimetresPerUnit(uint32_t unit) { return unit == 3 ? 10.0 : 25.4; }

}  // namespace

std::optional<ExifTags> ParseExif(std::string_view tiff) {
  if (tiff.size() < 8) return std::nullopt;
  const bool big_endian = tiff.substr(0, 2) == "MM";
  if (!big_endian && tiff.substr(0, 2) != "II") return std::nullopt;
  const TiffReader reader(tiff, big_endian);
  if (reader.U16(2) != 42) return std::nullopt;

  ExifTags tags;
  std::optional<double> exif_ifd;
  ForEachEntry(reader, *reader.U32(4), [&](const Entry& entry) {
    if (entry.tag == kMake) tags.make = Text(reader, entry);
    if (entry.tag == kModel) tags.model = Text(reader, entry);
    if (entry.tag == kExifIfd) exif_ifd = PositiveNumber(reader, entry);
  });
  if (!exif_ifd) return tags;

  std::optional<double> plane_px_per_unit;
  uint32_t unit = 2;
  ForEachEntry(reader, static_cast<size_t>(*exif_ifd), [&](const Entry& entry) {
    const std::optional<double> number = PositiveNumber(reader, entry);
    if (entry.tag == kFocalLength) tags.focal_mm = number;
    if (entry.tag == kFocalLengthIn35mmFilm) tags.focal_35mm_mm = number;
    if (entry.tag == kPixelXDimension) tags.pixel_width = number;
    if (entry.tag == kPixelYDimension) tags.pixel_height = number;
    if (entry.tag == kFocalPlaneXResolution) plane_px_per_unit = number;
    if (entry.tag == kFocalPlaneResolutionUnit && number) unit = static_cast<uint32_t>(*number);
  });
  if (plane_px_per_unit)
    tags.focal_plane_x_px_per_mm = *plane_px_per_unit / MillimetresPerUnit(unit);
  return tags;
}

namespace {

enum JpegMarker : uint8_t {
  kTem = 0x01,
  kRst0 = 0xD0,
  kSoi = 0xD8,
  kEoi = 0xD9,
  kApp1 = 0xE1,
};

bool StandsAlone(uint8_t marker) { return marker == kTem || (marker >= kRst0 && marker <= kSoi); }

/// Place of the next marker's 0xFF, from `at` on: skips entropy-coded data with its stuffed zeros
/// and restart markers. npos when there is none.
size_t NextMarker(std::string_view bytes, size_t at) {
  for (; at + 1 < bytes.size(); ++at) {
    if (static_cast<uint8_t>(bytes[at]) != 0xFF) continue;
    const auto code = static_cast<uint8_t>(bytes[at + 1]);
    const bool stuffed = code == 0x00 || code == 0xFF || (code >= kRst0 && code < kSoi);
    if (!stuffed) return at;
  }
  return std::string_view::npos;
}

}  // namespace

std::optional<JpegStructure> ScanJpeg(std::string_view bytes) {
  constexpr std::string_view kExifHeader("Exif\0\0", 6);
  if (bytes.substr(0, 2) != "\xFF\xD8") return std::nullopt;
  const TiffReader reader(bytes, /*big_endian=*/true);
  JpegStructure structure;
  size_t at = NextMarker(bytes, 2);
  while (at != std::string_view::npos) {
    const auto marker = static_cast<uint8_t>(bytes[at + 1]);
    if (marker == kEoi) {
      structure.complete = true;
      return structure;
    }
    if (StandsAlone(marker)) {
      at = NextMarker(bytes, at + 2);
      continue;
    }
    const auto length = reader.U16(at + 2);
    if (!length || *length < 2) return structure;
    if (at + 2 + *length > bytes.size()) return structure;
    const std::string_view payload = bytes.substr(at + 4, *length - 2);
    if (marker == kApp1 && structure.exif.empty() && payload.starts_with(kExifHeader)) {
      structure.exif = payload.substr(kExifHeader.size());
    }
    at = NextMarker(bytes, at + 2 + *length);
  }
  return structure;
}

}  // namespace rotunda::sfm
