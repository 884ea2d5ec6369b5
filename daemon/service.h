#pragma once

#include <spdlog/logger.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "config/daemon_config.h"
#include "daemon/store.h"
#include "sfm/core/result.h"

namespace rotunda::daemon {

/// The whole daemon: store, cameras, jobs, housekeeping, API; started in this order, ended in the
/// reverse, as the log tells.
class Service {
 public:
  struct Options {
    config::DaemonConfig config;
    std::string version;
    std::optional<int> listening_fd;  // systemd's; else config.service.socket is made
    WallClock clock;
    std::function<void()> still_starting;  // called now and then while Start() works
  };

  /// Serves when it returns. `log` outlives the service. Cameras that cannot be opened are logged
  /// and tried again by the next capture.
  static Result<std::unique_ptr<Service>> Start(Options options, spdlog::logger& log);
  /// Ends event streams, lets answers under way finish, marks running jobs interrupted. Waits as
  /// long as a disk that is read or written does not answer.
  ~Service();
  Service(const Service&) = delete;
  Service& operator=(const Service&) = delete;

  /// Takes over what can be changed while it runs, and warns of the rest.
  void Reload(const config::DaemonConfig& wanted);
  /// What is wrong with a configuration that was to be taken over; in the status until Reload().
  void RefuseReload(const std::string& why);

  /// What hangs, in words; nullopt while input/output, handlers and workers are alive.
  std::optional<std::string> Hung() const;
  /// A line for `systemctl status`.
  std::string Summary() const;

 private:
  struct Parts;
  Service(Options options, spdlog::logger& log);
  Status StartStore();
  Status StartServer();

  Options options_;
  spdlog::logger& log_;
  std::unique_ptr<Parts> parts_;
};

}  // namespace rotunda::daemon
