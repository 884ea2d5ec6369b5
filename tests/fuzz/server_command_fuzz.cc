#include "rig/sim/camera_fault.h"
#include "tests/fuzz/fuzz_input.h"

/// A line of the simulated cameras' command socket: a fault that is accepted is within its limits.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace rotunda;
  const auto command = sim::ParseServerCommand({reinterpret_cast<const char*>(data), size});
  if (!command.ok()) return 0;
  if (command->kind == sim::ServerCommand::Kind::kFault) {
    fuzz::Require(command->fault.Validate().ok(), "the fault is within its limits");
  }
  return 0;
}
