#pragma once

#include <sys/types.h>

#include <optional>
#include <string>
#include <vector>

#include "config/daemon_config.h"

namespace rotunda::daemon {

/// The number of the system's group of this name; nullopt: there is none.
std::optional<gid_t> GroupId(const std::string& name);

/// A line for each group of the configuration that the system does not have. No error: a group may
/// be made later, and be found by a reload.
std::vector<std::string> MissingGroups(const config::DaemonConfig::Access& access);

}  // namespace rotunda::daemon
