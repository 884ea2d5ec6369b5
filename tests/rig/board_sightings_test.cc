#include "rig/board_sightings.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "sfm/core/checksum.h"
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

TEST(FindShots, AShotNamedTwiceIsRefusedBeforeItsPicturesAreRead) {
  const test::TemporaryFolder folder;
  WritePictures(folder / "shot", 2);
  fs::create_directory_symlink(folder / "shot", folder / "link");
  for (const char* again : {"shot", "shot/", "link"}) {
    const auto shots = FindShots({folder / "shot", folder / again});
    ASSERT_FALSE(shots) << again;
    EXPECT_EQ(shots.error().context, (folder / again).string());
    EXPECT_NE(shots.error().message.find("is given twice"), std::string::npos)
        << shots.error().message;
  }
}

TEST(DetectBoards, APictureWithAnotherChecksumIsNotUsed) {
  const test::TemporaryFolder folder;
  const fs::path file = folder / "a.png";
  ASSERT_TRUE(cv::imwrite(file.string(), cv::Mat(60, 80, CV_8UC1, cv::Scalar(90))));
  const std::string right = Xxh3Text(ReadFile(file).value());
  ShotPictures shots;
  shots.cameras = {{"a", "", 0, 0}};
  shots.shots = {{"known", folder.path()}, {"unknown", folder.path()}, {"changed", folder.path()}};
  for (const std::string& xxh3 : {right, std::string(), std::string("0123456789abcdef")}) {
    shots.pictures.push_back({{.file = file, .xxh3 = xxh3}});
  }
  ThreadPool pool(1);
  RunContext context{pool};
  const auto sightings = DetectBoards(shots, CuboidBoard({}), {}, context);
  ASSERT_TRUE(sightings) << sightings.error().ToString();
  EXPECT_TRUE(sightings->sightings[0][0].detection.has_value());
  EXPECT_TRUE(sightings->sightings[1][0].detection.has_value());
  EXPECT_FALSE(sightings->sightings[2][0].detection.has_value());
  EXPECT_EQ(sightings->sightings[2][0].missing,
            "cannot be read: the picture was changed after the capture: its checksum is " + right +
                ", the frame set says 0123456789abcdef");
}

}  // namespace
}  // namespace rotunda::rig
