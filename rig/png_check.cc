#include "rig/png_check.h"

#include <libdeflate.h>

#include <cstdint>

namespace rotunda::rig {
namespace {

constexpr std::string_view kSignature("\x89PNG\r\n\x1a\n", 8);
constexpr size_t kWord = 4;  // length, type and checksum of a chunk

uint32_t WordAt(std::string_view bytes, size_t place) {
  uint32_t word = 0;
  for (size_t i = 0; i < kWord; ++i) {
    word = word << 8 | static_cast<unsigned char>(bytes[place + i]);
  }
  return word;
}

}  // namespace

std::string PngProblem(std::string_view bytes) {
  if (!bytes.starts_with(kSignature)) return "";
  const auto cut_short = [&] {
    return "the PNG is cut short: it ends after " + std::to_string(bytes.size()) + " bytes";
  };
  size_t place = kSignature.size();
  while (true) {
    if (bytes.size() - place < 2 * kWord) return cut_short();
    const size_t length = WordAt(bytes, place);
    if (bytes.size() - place < length + 3 * kWord) return cut_short();
    const std::string_view content = bytes.substr(place + kWord, kWord + length);
    if (libdeflate_crc32(0, content.data(), content.size()) !=
        WordAt(bytes, place + 2 * kWord + length)) {
      return "the PNG is damaged: a checksum is wrong at byte " + std::to_string(place);
    }
    if (content.starts_with("IEND")) return "";
    place += length + 3 * kWord;
  }
}

}  // namespace rotunda::rig
