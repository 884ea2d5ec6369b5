#include "sfm/image_io.h"
#include "tests/fuzz/fuzz_input.h"

/// PNG, JPEG and EXIF: what is decoded is a picture, and its focal length is one.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace rotunda;
  const fuzz::InputFile file(data, size);
  const auto exif = sfm::ReadExifFocal(file.path(), 4000, 3000);
  fuzz::Require(!exif || exif->focal_px > 0, "a focal length is positive");
  const auto picture = sfm::ReadPicture(file.path(), "RGB8");
  if (!picture) return 0;
  fuzz::Require(picture->type() == CV_8UC3 && !picture->empty(), "a picture is 8-bit BGR");
  return 0;
}
