#pragma once

#include <string>
#include <string_view>

namespace rotunda::rig {

/// What is wrong with a PNG file's chunks: cut short, or a checksum that does not fit its bytes.
/// Empty: nothing, or the bytes are no PNG. Found here since libpng tells it on standard error.
std::string PngProblem(std::string_view bytes);

}  // namespace rotunda::rig
