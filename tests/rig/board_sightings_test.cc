#include "rig/board_sightings.h"

#include <gtest/gtest.h>

#include "sfm/core/file_io.h"
#include "tests/support/process.h"

namespace rotunda::rig {
namespace {

namespace fs = std::filesystem;

void WritePictures(const fs::path& folder, int count) {
  fs::create_directories(folder);
  for (int i = 0; i < count; ++i) {
    ASSERT_TRUE(WriteNewFile(folder / (std::to_string(i) + ".png"), "never decoded here"));
  }
}

TEST(FindShots, AFolderOfOneCameraIsAShotAPicture) {
  const test::TemporaryFolder folder;
  WritePictures(folder / "rig/left", 3);
  const auto shots = FindShots({folder / "rig"});
  ASSERT_TRUE(shots) << shots.error().ToString();
  EXPECT_EQ(shots->shots.size(), 3u);
  ASSERT_EQ(shots->cameras.size(), 1u);
  EXPECT_EQ(shots->cameras[0].camera, "left");
}

TEST(FindShots, FoldersOfCamerasAreReadSideBySide) {
  const test::TemporaryFolder folder;
  WritePictures(folder / "rig/left", 2);
  WritePictures(folder / "rig/right", 2);
  const auto shots = FindShots({folder / "rig"});
  ASSERT_TRUE(shots) << shots.error().ToString();
  EXPECT_EQ(shots->shots.size(), 2u);
  EXPECT_EQ(shots->cameras.size(), 2u);
}

TEST(FindShots, PicturesOfOneShotMayHaveAFolderBesideThem) {
  const test::TemporaryFolder folder;
  WritePictures(folder / "shot", 4);
  fs::create_directories(folder / "shot/thumbnails");
  WritePictures(folder / "framed/frames", 4);
  for (const char* name : {"shot", "framed"}) {
    const auto shots = FindShots({folder / name});
    ASSERT_TRUE(shots) << shots.error().ToString();
    EXPECT_EQ(shots->shots.size(), 1u) << name;
    EXPECT_EQ(shots->cameras.size(), 4u) << name;
  }
}

}  // namespace
}  // namespace rotunda::rig
