#include "sfm/core/frame_set.h"
#include "tests/fuzz/fuzz_input.h"

/// frameset.json: what is accepted is written and read again without a change.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace rotunda;
  const auto set = FrameSetFromJson({reinterpret_cast<const char*>(data), size}, "fuzz");
  if (!set) return 0;
  for (const Frame& frame : set->frames) {
    const std::filesystem::path file = frame.file;
    fuzz::Require(file.is_relative() && *file.lexically_normal().begin() != "..",
                  "a picture lies below its set's folder");
  }
  const std::string text = FrameSetToJson(*set);
  const auto again = FrameSetFromJson(text, "written");
  fuzz::Require(again.ok() && FrameSetToJson(*again) == text, "what is written can be read");
  return 0;
}
