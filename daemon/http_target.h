#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "sfm/core/result.h"

namespace rotunda::daemon {

/// The target of a request, taken apart and decoded.
struct HttpTarget {
  std::vector<std::string> segments;         // "/v1/captures/x" -> v1, captures, x
  std::map<std::string, std::string> query;  // each key once
};

/// Longer targets are refused: no route needs nearly as much.
inline constexpr size_t kMaxTargetBytes = 2048;

/// kBadInput: not an absolute path, too long, broken percent-encoding, an encoded control character
/// or slash, an empty segment, "." or "..", a query key twice. So no segment can name another
/// folder.
Result<HttpTarget> ParseTarget(std::string_view target);

}  // namespace rotunda::daemon
