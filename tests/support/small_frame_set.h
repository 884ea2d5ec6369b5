#pragma once

#include <filesystem>
#include <string>

namespace rotunda::test {

/// Writes a frame set of `cameras` pictures of 120x160 RGB noise, for tests that any pictures do:
/// rendering takes seconds. Serial numbers are `serial`0, `serial`1, ...; Aravis' discovery tells
/// cameras by them, so that tests which may run at the same time need different ones.
void WriteSmallFrameSet(const std::filesystem::path& folder, int cameras,
                        const std::string& serial);

}  // namespace rotunda::test
