#include "sfm/core/checksum.h"

#include <xxhash.h>

#include <cstdio>

namespace rotunda {

std::string Xxh3Text(std::string_view bytes) {
  char text[17];
  std::snprintf(text, sizeof(text), "%016llx",
                static_cast<unsigned long long>(XXH3_64bits(bytes.data(), bytes.size())));
  return text;
}

std::string ChecksumProblem(std::string_view bytes, const std::string& expected) {
  const std::string found = Xxh3Text(bytes);
  if (expected.empty() || found == expected) return "";
  return "the picture was changed after the capture: its checksum is " + found +
         ", the frame set says " + expected;
}

}  // namespace rotunda
