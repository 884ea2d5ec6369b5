#pragma once

#include <cstdint>
#include <string>

namespace rotunda {

/// A size for people, to three digits, in the unit that suits it (powers of 1000): "999 bytes",
/// "1.50 kB", "23.4 MB", "20.0 GB".
std::string BytesText(uint64_t bytes);

}  // namespace rotunda
