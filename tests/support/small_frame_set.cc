#include "tests/support/small_frame_set.h"

#include <cstdint>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "rig/png_encoder.h"
#include "sfm/core/file_io.h"
#include "sfm/core/frame_set.h"

namespace rotunda::test {

void WriteSmallFrameSet(const std::filesystem::path& folder, int cameras,
                        const std::string& serial) {
  std::filesystem::create_directories(folder / "frames");
  FrameSet set;
  set.id = "small";
  set.captured_at = "2026-01-01T00:00:00Z";
  std::mt19937 random(7);
  for (int i = 0; i < cameras; ++i) {
    Frame& frame = set.frames.emplace_back();
    frame.camera = "c00r" + std::to_string(i);
    frame.serial = serial + std::to_string(i);
    frame.file = "frames/" + frame.camera + ".png";
    frame.width_px = 120;
    frame.height_px = 160;
    frame.pixel_format = "RGB8";
    std::vector<uint8_t> pixels(size_t{3} * 120 * 160);
    for (uint8_t& value : pixels) value = static_cast<uint8_t>(random());
    const auto png = rig::EncodePng({pixels, frame.width_px, frame.height_px, 3});
    if (!png || !WriteNewFile(folder / frame.file, *png)) throw std::runtime_error("cannot write");
  }
  if (!WriteNewFile(folder / "frameset.json", FrameSetToJson(set))) {
    throw std::runtime_error("cannot write");
  }
}

}  // namespace rotunda::test
