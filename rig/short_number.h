#pragma once

#include <cstdio>
#include <string>

namespace rotunda::rig {

/// A number in a sentence; `format` is printf's, with a unit ("%.2f mm"): at most 31 characters.
inline std::string Number(double value, const char* format) {
  char text[32];
  std::snprintf(text, sizeof(text), format, value);
  return text;
}

}  // namespace rotunda::rig
