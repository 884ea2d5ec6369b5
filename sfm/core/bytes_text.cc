#include "sfm/core/bytes_text.h"

#include <cstdio>

namespace rotunda {

std::string BytesText(uint64_t bytes) {
  constexpr uint64_t kStep = 1000;
  if (bytes < kStep) return std::to_string(bytes) + " bytes";
  double size = 1e-3 * static_cast<double>(bytes);
  // A size that would be rounded up to a thousand has the next unit; 2^64 bytes are 18 EB.
  const char* unit = "kMGTPE";
  for (; size >= 999.5; size /= kStep) ++unit;
  const int decimals = size < 9.995 ? 2 : size < 99.95 ? 1 : 0;
  char text[32];
  std::snprintf(text, sizeof(text), "%.*f %cB", decimals, size, *unit);
  return text;
}

}  // namespace rotunda
