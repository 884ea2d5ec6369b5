#pragma once

#include <string>
#include <string_view>

namespace rotunda {

/// XXH3-64 of the bytes as 16 lower-case hexadecimal digits: the checksum of a frame set's
/// pictures.
std::string Xxh3Text(std::string_view bytes);

/// That a picture is not what the frame set says by its checksum; empty when it is, or when
/// `expected` is empty (not known).
std::string ChecksumProblem(std::string_view bytes, const std::string& expected);

}  // namespace rotunda
