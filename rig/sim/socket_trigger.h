#pragma once

#include <filesystem>

#include "rig/trigger_line.h"

namespace rotunda::sim {

/// The trigger cable of simulated cameras: each pulse is a command to a server's socket.
class SocketTrigger : public rig::TriggerLine {
 public:
  /// `line`: the cameras' input it is wired to.
  explicit SocketTrigger(std::filesystem::path socket, int line = 0);

  /// Returns when the cameras have seen the rising edge. kNotFound: no server listens.
  Result<Clock::time_point> Pulse(std::chrono::microseconds width) override;

 private:
  std::filesystem::path socket_;
  int line_ = 0;
};

}  // namespace rotunda::sim
