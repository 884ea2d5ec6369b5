#include "sfm/core/file_io.h"
#include "sfm/stage_io.h"
#include "tests/fuzz/fuzz_input.h"

namespace {

using rotunda::Result;
using rotunda::Status;

std::string BytesOf(const std::filesystem::path& file) {
  const Result<std::string> bytes = rotunda::ReadFile(file);
  rotunda::fuzz::Require(bytes.ok(), "what was written is there");
  return *bytes;
}

/// What is accepted is written to the same bytes.
template <typename Product>
void RequireSameBytes(const Result<Product>& product, const std::filesystem::path& file,
                      Status (*write)(const Product&, const std::filesystem::path&)) {
  if (!product) return;
  const rotunda::fuzz::InputFile copy(nullptr, 0);
  rotunda::fuzz::Require(write(*product, copy.path()).ok(), "it can be written");
  rotunda::fuzz::Require(BytesOf(copy.path()) == BytesOf(file), "the same bytes are written");
}

rotunda::sfm::Features TwoPictures() {
  rotunda::sfm::Features features;
  for (size_t i = 0; i < 2; ++i) features.images.emplace_back().keypoints.resize(4);
  return features;
}

}  // namespace

/// Products of stages, read as each kind: what is accepted is sound and written to the same bytes.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace rotunda;
  const fuzz::InputFile file(data, size);
  const sfm::Features two = TwoPictures();
  RequireSameBytes(sfm::ReadFeatures(file.path()), file.path(), &sfm::WriteFeatures);
  RequireSameBytes(sfm::ReadMatches(file.path(), two), file.path(), &sfm::WriteMatches);
  RequireSameBytes(sfm::ReadTwoViews(file.path(), two), file.path(), &sfm::WriteTwoViews);
  const auto tracks = sfm::ReadTracks(file.path(), two);
  RequireSameBytes(tracks, file.path(), &sfm::WriteTracks);
  if (!tracks) return 0;
  for (const sfm::Track& track : tracks->tracks) {
    fuzz::Require(track.observations.size() == 2 && track.observations[1].image == ImageId(1),
                  "a track sees each of the two pictures once");
  }
  return 0;
}
