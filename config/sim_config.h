#pragma once

#include <filesystem>
#include <string>

#include "rig/sim/rig_options.h"
#include "sfm/core/result.h"

namespace rotunda::config {

/// Typed options from the text of a TOML file (config/rig-90.toml shows every key). What is left
/// out keeps its default. Refused with kBadInput, naming `source`, the line, the key and what is
/// allowed: bad TOML, a key that is not known, a wrong type, a value out of range.
Result<sim::RigOptions> ParseRigOptions(const std::string& text, const std::string& source);

Result<sim::RigOptions> ReadRigOptions(const std::filesystem::path& file);

}  // namespace rotunda::config
