#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/process.h"

namespace rotunda::test {

/// `rotunda ARGUMENTS`, as built beside the test; SIGINT as for RunProcess.
inline ProcessOutcome RunRotunda(std::vector<std::string> arguments,
                                 const std::function<bool()>& interrupt_when = nullptr) {
  arguments.insert(arguments.begin(), ROTUNDA_COMMAND);
  return RunProcess(arguments, interrupt_when);
}

}  // namespace rotunda::test
