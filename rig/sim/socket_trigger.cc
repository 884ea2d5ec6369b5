#include "rig/sim/socket_trigger.h"

#include <sstream>
#include <utility>

#include "rig/sim/camera_server.h"

namespace rotunda::sim {

SocketTrigger::SocketTrigger(std::filesystem::path socket, int line)
    : socket_(std::move(socket)), line_(line) {}

Result<SocketTrigger::Clock::time_point> SocketTrigger::Pulse(std::chrono::microseconds width) {
  const auto edge = Clock::now();
  const auto edge_ns =
      std::chrono::duration_cast<std::chrono::nanoseconds>(edge.time_since_epoch()).count();
  std::ostringstream command;
  command << "pulse " << line_ << ' ' << edge_ns << ' ' << width.count();
  ROTUNDA_ASSIGN_OR_RETURN([[maybe_unused]] const std::string answer,
                           SendServerCommand(socket_, command.str()));
  return edge;
}

}  // namespace rotunda::sim
