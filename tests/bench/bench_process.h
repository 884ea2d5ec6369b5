#pragma once

#include <string>
#include <utility>
#include <vector>

#include "sfm/core/result.h"
#include "tests/support/process.h"

namespace rotunda::bench {

/// Ends the program with a message under its name.
[[noreturn]] void Die(const std::string& what);

template <typename T>
T OrDie(Result<T> result) {
  if (!result.ok()) Die(result.error().ToString());
  return std::move(result).value();
}
void OrDie(const Status& status);

/// Runs a program; one that fails ends this one too.
test::ProcessOutcome RunOrDie(const std::vector<std::string>& arguments);

}  // namespace rotunda::bench
