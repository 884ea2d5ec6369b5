#pragma once

#include <string>
#include <vector>

namespace rotunda {

/// Names are listed up to here, then counted.
inline constexpr size_t kNamesListed = 6;

/// "c01, c02", "c01, c02, c03, c04, c05, c06 and 3 more".
std::string ListOfNames(const std::vector<std::string>& names);

/// All of them: "c01, c02".
std::string Joined(const std::vector<std::string>& names);

}  // namespace rotunda
