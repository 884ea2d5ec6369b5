#pragma once

#include <string>
#include <string_view>

namespace rotunda {

/// Why `text` is not UTF-8 without control characters (U+0000 to U+001F, U+007F to U+009F, and
/// those that break lines or turn the direction of writing, U+2028 to U+202E, U+2066 to U+2069):
/// "the control character U+000A at byte 3" (the first is 0), "bytes that are not UTF-8"; empty
/// when it is. Other text does not go into lists, logs and terminals.
std::string NotPlain(std::string_view text);

/// `text` (UTF-8) with '?' for each control character.
std::string Printable(std::string_view text);

}  // namespace rotunda
