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

}  // namespace rotunda
