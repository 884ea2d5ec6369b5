#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace rotunda {

/// Text from outside made safe for element content and quoted attributes, in HTML and in XML:
/// markup characters become entities; control characters and bytes that are not UTF-8 become
/// U+FFFD.
std::string Escaped(std::string_view text);

/// `value` with exactly `decimals` digits behind the point, in no locale; a dash when not finite.
std::string Fixed(double value, int decimals);

/// Three significant digits at least, no exponent: 0.00412, 0.412, 41.2, 4120.
std::string Significant(double value);

/// Decimals that give a value of this size three significant digits (at most 5).
int DecimalsFor(double value);

/// Digits in groups of three, parted by a narrow space.
std::string Grouped(size_t count);

/// "1 camera", "2 cameras".
std::string Counted(size_t count, std::string_view noun);

std::string Base64(std::string_view bytes);

/// For a coordinate in a drawing: one decimal, no trailing ".0".
std::string Coordinate(double value);

}  // namespace rotunda
