#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "rig/capture_options.h"
#include "sfm/core/result.h"

namespace rotunda::config {

/// Capture options from the text of a TOML file (config/capture.toml shows every key). What is left
/// out keeps its default. Refused with kBadInput, naming `source`, the line, the key and what is
/// allowed: bad TOML, a key that is not known, a wrong type, a value out of range, a camera twice,
/// frames that do not get through their uplink in time.
Result<rig::CaptureOptions> ParseCaptureOptions(const std::string& text, const std::string& source);
Result<rig::CaptureOptions> ReadCaptureOptions(const std::filesystem::path& file);

/// The same, with every key that is wrong instead of the first.
struct CheckedCaptureOptions {
  rig::CaptureOptions options;  // to be used only when there are no problems
  std::vector<Error> problems;
};
CheckedCaptureOptions CheckCaptureOptions(const std::string& text, const std::string& source);

}  // namespace rotunda::config
