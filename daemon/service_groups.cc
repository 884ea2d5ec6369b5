#include "daemon/service_groups.h"

#include <grp.h>

#include <cerrno>
#include <utility>

namespace rotunda::daemon {
namespace {

// A group with a million members; more is a broken directory service.
constexpr size_t kMaxGroupBytes = size_t{1} << 26;

}  // namespace

std::optional<gid_t> GroupId(const std::string& name) {
  std::vector<char> memory(1 << 16);
  group entry{};
  group* found = nullptr;
  const auto look = [&] {
    return getgrnam_r(name.c_str(), &entry, memory.data(), memory.size(), &found);
  };
  while (look() == ERANGE && memory.size() < kMaxGroupBytes) memory.resize(2 * memory.size());
  return found == nullptr ? std::nullopt : std::optional(found->gr_gid);
}

std::vector<std::string> MissingGroups(const config::DaemonConfig::Access& access) {
  std::vector<std::string> missing;
  for (const auto& [key, name] : {std::pair("access.viewer_group", access.viewer_group),
                                  std::pair("access.operator_group", access.operator_group)}) {
    if (name.empty() || GroupId(name)) continue;
    missing.push_back(std::string(key) + ": there is no group '" + name +
                      "': nobody has its rights");
  }
  return missing;
}

}  // namespace rotunda::daemon
