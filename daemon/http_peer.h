#pragma once

#include <cstdint>

#include "daemon/http_message.h"
#include "daemon/http_server.h"

// Private to the .cc files of the HTTP server: who is at the other end, and what places there are.

namespace rotunda::daemon {

/// The process that connected, with its role: by its groups, supplementary ones too, when it did.
/// Without credentials it has none.
Peer PeerOf(int fd, const HttpAccess& access);

/// How many of `all` places there are for one with this role: an operator finds at least one of
/// two.
uint64_t PlacesFor(Role role, int all);

}  // namespace rotunda::daemon
