#include "sfm/colmap_io.h"
#include "tests/fuzz/fuzz_input.h"

namespace {

rotunda::FrameSet MakeSet() {
  rotunda::FrameSet set;
  for (const char* camera : {"a", "b", "c"}) {
    rotunda::Frame frame;
    frame.camera = camera;
    frame.file = frame.camera + ".png";
    set.frames.push_back(frame);
  }
  return set;
}

}  // namespace

/// COLMAP's database.db: matches that are accepted lie within the keypoints.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace rotunda;
  const fuzz::InputFile file(data, size);
  const auto database = sfm::ReadColmapDatabase(file.path(), MakeSet());
  if (!database) return 0;
  for (const sfm::PairMatches& pair : database->matches.pairs) {
    fuzz::Require(pair.pair.first < pair.pair.second, "a pair is in order");
    for (const sfm::Match& match : pair.matches) {
      const auto& first = database->features.image(pair.pair.first).keypoints;
      const auto& second = database->features.image(pair.pair.second).keypoints;
      fuzz::Require(match.first.index() < first.size() && match.second.index() < second.size(),
                    "a match lies within the keypoints");
    }
  }
  return 0;
}
