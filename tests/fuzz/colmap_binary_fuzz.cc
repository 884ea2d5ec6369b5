#include "tests/fuzz/colmap_input.h"

/// cameras.bin, images.bin and points3D.bin: what is decoded is encoded to the same bytes, and a
/// model that is accepted is sound.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace rotunda;
  const sfm::ColmapFiles files = fuzz::SplitColmapFiles(data, size);
  const auto records = sfm::DecodeColmapBinary(files);
  if (!records) return 0;
  const sfm::ColmapFiles encoded = sfm::EncodeColmapBinary(*records);
  fuzz::Require(encoded.cameras == files.cameras && encoded.images == files.images &&
                    encoded.points == files.points,
                "the same bytes are written");
  const auto model = sfm::ModelOfRecords(*records, ".bin");
  if (model) fuzz::RequireSound(*model);
  return 0;
}
