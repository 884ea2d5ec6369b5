#include "daemon/service_folders.h"

#include <unistd.h>

#include <filesystem>
#include <string>
#include <system_error>

#include "daemon/http_listener.h"
#include "daemon/store_folder.h"

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;

/// StateDirectory= of rotunda.service makes the usual one.
Status CheckStateFolder(const fs::path& folder) {
  std::error_code ignored;
  const bool is_usual = folder == config::DaemonConfig::Service().state_folder;
  if (is_usual && !fs::exists(folder, ignored)) return {};
  return CheckFolderForWriting(folder, R_OK | W_OK | X_OK);
}

/// rotunda.socket makes the usual one. The daemon, unlike systemd, makes no folder for a socket.
Status CheckSocketFolder(const fs::path& socket) {
  if (socket == config::DaemonConfig::Service().socket || IsLivingSocket(socket)) return {};
  const fs::path folder = socket.parent_path();
  std::error_code failed;
  if (fs::exists(folder, failed) || failed) return CheckFolderForWriting(folder, W_OK | X_OK);
  return Error{ErrorCode::kNotFound,
               "is not there: expected a folder that the daemon's user can write, or a socket that "
               "systemd listens on (rotunda.socket)",
               folder.string()};
}

}  // namespace

std::vector<Error> FolderDoubts(const config::DaemonConfig::Service& service) {
  std::vector<Error> doubts;
  const auto add = [&doubts](const char* key, const Status& found) {
    if (!found) doubts.push_back({found.error().code, found.error().ToString(), key});
  };
  add("service.state_folder", CheckStateFolder(service.state_folder));
  add("service.socket", CheckSocketFolder(service.socket));
  return doubts;
}

}  // namespace rotunda::daemon
