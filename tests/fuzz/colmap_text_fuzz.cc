#include "tests/fuzz/colmap_input.h"

/// cameras.txt, images.txt and points3D.txt: a model that is accepted is sound.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace rotunda;
  const auto records = sfm::DecodeColmapText(fuzz::SplitColmapFiles(data, size));
  if (!records) return 0;
  const auto model = sfm::ModelOfRecords(*records, ".txt");
  if (model) fuzz::RequireSound(*model);
  return 0;
}
