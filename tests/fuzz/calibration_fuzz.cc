#include "sfm/core/calibration.h"
#include "tests/fuzz/fuzz_input.h"

/// calibration.json: what is accepted is written and read again without a change, and every camera
/// is found by its name.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace rotunda;
  const auto calibration = CalibrationFromJson({reinterpret_cast<const char*>(data), size}, "fuzz");
  if (!calibration) return 0;
  for (const CalibratedCamera& camera : calibration->cameras) {
    fuzz::Require(calibration->Find(camera.camera) == &camera, "a camera is found by its name");
    fuzz::Require(camera.intrinsics.Validate().ok(), "the lens is valid");
  }
  const std::string text = CalibrationToJson(*calibration);
  const auto again = CalibrationFromJson(text, "written");
  fuzz::Require(again.ok() && CalibrationToJson(*again) == text, "what is written can be read");
  return 0;
}
