#pragma once

#include <filesystem>

namespace rotunda::test {

/// Writes a frame set of `cameras` pictures of 120x160 RGB noise, serial numbers SIM00100,
/// SIM00101, ...: what takes a second to render where any pictures do.
void WriteSmallFrameSet(const std::filesystem::path& folder, int cameras);

}  // namespace rotunda::test
