#include "daemon/http_peer.h"

#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <vector>

namespace rotunda::daemon {
namespace {

constexpr int kOperatorsShare = 8;  // one in so many places

/// Groups of the process at the other end, supplementary ones too, when it connected.
std::vector<gid_t> PeerGroups(int fd, gid_t primary) {
  std::vector<gid_t> groups(64);
  auto bytes = static_cast<socklen_t>(groups.size() * sizeof(gid_t));
  int failed = getsockopt(fd, SOL_SOCKET, SO_PEERGROUPS, groups.data(), &bytes);
  if (failed != 0 && errno == ERANGE) {  // `bytes` is now what it takes
    groups.resize(bytes / sizeof(gid_t));
    failed = getsockopt(fd, SOL_SOCKET, SO_PEERGROUPS, groups.data(), &bytes);
  }
  groups.resize(failed != 0 ? 0 : bytes / sizeof(gid_t));
  groups.push_back(primary);
  return groups;
}

}  // namespace

Peer PeerOf(int fd, const HttpAccess& access) {
  ucred credentials{};
  socklen_t bytes = sizeof(credentials);
  if (getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &credentials, &bytes) != 0) return {};
  Peer peer{credentials.uid, credentials.pid, Role::kNone};
  const std::vector<gid_t> groups = PeerGroups(fd, credentials.gid);
  const auto in_one_of = [&](const std::vector<gid_t>& wanted) {
    return std::find_first_of(groups.begin(), groups.end(), wanted.begin(), wanted.end()) !=
           groups.end();
  };
  if (peer.uid == 0 || peer.uid == geteuid() || in_one_of(access.operators)) {
    peer.role = Role::kOperator;
  } else if (in_one_of(access.viewers)) {
    peer.role = Role::kViewer;
  }
  return peer;
}

uint64_t PlacesFor(Role role, int all) {
  const int kept = all < 2 ? 0 : std::max(1, all / kOperatorsShare);
  return static_cast<uint64_t>(role == Role::kOperator ? all : all - kept);
}

}  // namespace rotunda::daemon
