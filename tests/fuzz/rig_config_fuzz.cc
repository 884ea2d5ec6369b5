#include "config/board_config.h"
#include "config/sim_config.h"
#include "tests/fuzz/fuzz_input.h"

/// The TOML files of the rig and of its target: options that are accepted are valid.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace rotunda;
  const std::string text(reinterpret_cast<const char*>(data), size);
  const auto rig = config::ParseRigOptions(text, "fuzz");
  fuzz::Require(!rig || rig->Validate().ok(), "accepted rig options are valid");
  const auto board = config::ParseBoard(text, "fuzz");
  fuzz::Require(!board || board->Validate().ok(), "accepted boards are valid");
  return 0;
}
