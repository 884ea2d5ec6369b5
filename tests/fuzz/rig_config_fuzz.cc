#include "config/sim_config.h"
#include "tests/fuzz/fuzz_input.h"

/// The simulator's TOML files: options that are accepted are valid.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace rotunda;
  const std::string text(reinterpret_cast<const char*>(data), size);
  const auto rig = config::ParseRigOptions(text, "fuzz");
  fuzz::Require(!rig || rig->Validate().ok(), "accepted rig options are valid");
  const auto cuboid = config::ParseCuboidOptions(text, "fuzz");
  fuzz::Require(!cuboid || cuboid->Validate().ok(), "accepted cuboid options are valid");
  return 0;
}
