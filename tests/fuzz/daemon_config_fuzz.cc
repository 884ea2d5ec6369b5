#include <string>

#include "config/daemon_config.h"
#include "tests/fuzz/fuzz_input.h"

/// The daemon's configuration: what is accepted is the same when it is read again, and every
/// problem says where it is.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace rotunda;
  const std::string text(reinterpret_cast<const char*>(data), size);
  const config::CheckedDaemonConfig checked = config::CheckDaemonConfigText(text, "fuzz.toml");
  for (const Error& problem : checked.problems) {
    fuzz::Require(problem.context.starts_with("fuzz.toml:"), "a problem names file and line");
    fuzz::Require(!problem.message.empty(), "a problem says what it is");
  }
  if (!checked.problems.empty()) return 0;
  fuzz::Require(checked.config.http.streams < checked.config.http.connections,
                "what is accepted is within its limits");
  return 0;
}
