#include "sfm/core/pose_set.h"
#include "tests/fuzz/fuzz_input.h"

/// poses.json: what is accepted is written and read again without a change.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace rotunda;
  const auto poses = PoseSetFromJson({reinterpret_cast<const char*>(data), size}, "fuzz");
  if (!poses) return 0;
  const std::string text = PoseSetToJson(*poses);
  const auto again = PoseSetFromJson(text, "written");
  fuzz::Require(again.ok() && PoseSetToJson(*again) == text, "what is written can be read");
  return 0;
}
