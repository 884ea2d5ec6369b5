#pragma once

#include <string>
#include <string_view>

namespace rotunda {

/// XXH3-64 of the bytes as 16 lower-case hexadecimal digits: the checksum of a frame set's
/// pictures.
std::string Xxh3Text(std::string_view bytes);

}  // namespace rotunda
