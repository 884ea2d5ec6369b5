#pragma once

#include <map>
#include <string>
#include <vector>

namespace rotunda {

/// Names are listed up to here, then counted.
inline constexpr size_t kNamesListed = 6;

/// "c01, c02", "c01, c02, c03, c04, c05, c06 and 3 more".
std::string ListOfNames(const std::vector<std::string>& names);

/// All of them: "c01, c02".
std::string Joined(const std::vector<std::string>& names);

/// The names of values that are known by name.
template <typename T>
std::vector<std::string> NamesIn(const std::map<std::string, T>& by_name) {
  std::vector<std::string> names;
  for (const auto& [name, value] : by_name) names.push_back(name);
  return names;
}
/// The name of `value`; empty when it has none.
template <typename T>
std::string NameIn(const std::map<std::string, T>& by_name, T value) {
  for (const auto& [name, each] : by_name) {
    if (each == value) return name;
  }
  return "";
}

}  // namespace rotunda
