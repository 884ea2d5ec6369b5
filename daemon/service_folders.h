#pragma once

#include <vector>

#include "config/daemon_config.h"
#include "sfm/core/result.h"

namespace rotunda::daemon {

/// Why a daemon of this process's user could not use the folders of its state and of its socket;
/// the context is the key. Folders that systemd makes for rotunda.service are not missed, and their
/// socket's is not looked at. No errors: another user may run the daemon, and a folder may be made
/// until then.
std::vector<Error> FolderDoubts(const config::DaemonConfig::Service& service);

}  // namespace rotunda::daemon
