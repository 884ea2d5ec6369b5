#pragma once

#include <filesystem>

#include "sfm/core/result.h"

namespace rotunda::daemon {

/// Makes and listens on a socket that its owner and group may use. One that a dead process left
/// behind is replaced; kAlreadyExists: a living one listens there, or it is no socket.
Result<int> ListenOn(const std::filesystem::path& path);

/// Whether a program holds the socket `path` open. No connection is made: systemd would start a
/// service for one. A user who may not connect to it is told false.
bool IsLivingSocket(const std::filesystem::path& path);

}  // namespace rotunda::daemon
