#include "config/board_config.h"
#include "config/capture_config.h"
#include "config/sim_config.h"
#include "tests/fuzz/fuzz_input.h"

/// The TOML files of the rig, of its target and of its cameras: options that are accepted are
/// valid, and every problem says where it is.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace rotunda;
  const std::string text(reinterpret_cast<const char*>(data), size);
  const auto rig = config::ParseRigOptions(text, "fuzz");
  fuzz::Require(!rig || rig->Validate().ok(), "accepted rig options are valid");
  const auto board = config::ParseBoard(text, "fuzz");
  fuzz::Require(!board || board->Validate().ok(), "accepted boards are valid");
  const auto capture = config::CheckCaptureOptions(text, "fuzz");
  fuzz::Require(!capture.problems.empty() || capture.options.Validate().ok(),
                "accepted capture options are valid");
  for (const Error& problem : capture.problems) {
    fuzz::Require(problem.context.starts_with("fuzz"), "a problem names its file");
  }
  return 0;
}
