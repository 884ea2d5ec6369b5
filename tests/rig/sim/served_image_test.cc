#include "rig/sim/served_image.h"

#include <gtest/gtest.h>

#include "rig/png_encoder.h"
#include "rig/sim/camera_server.h"
#include "rig/sim/png_writer.h"
#include "sfm/core/file_io.h"
#include "tests/support/process.h"

namespace rotunda::sim {
namespace {

using Bytes = std::vector<uint8_t>;

/// 2x2: red, green / blue, white.
ServedImage Colours() {
  return {2, 2, PixelFormat::kRgb8, {250, 0, 0, 0, 240, 0, 0, 0, 230, 255, 255, 255}};
}

TEST(ServedImage, ConvertsAsASensorSees) {
  // Red, green / green, blue.
  EXPECT_EQ(ConvertImage(Colours(), PixelFormat::kBayerRG8).bytes, (Bytes{250, 240, 0, 255}));
  EXPECT_EQ(ConvertImage(Colours(), PixelFormat::kBayerGR8).bytes, (Bytes{0, 0, 230, 255}));
  EXPECT_EQ(ConvertImage(Colours(), PixelFormat::kBayerGB8).bytes, (Bytes{0, 0, 0, 255}));
  EXPECT_EQ(ConvertImage(Colours(), PixelFormat::kBayerBG8).bytes, (Bytes{0, 240, 0, 255}));
  // 0.299 R + 0.587 G + 0.114 B, within its 1/256.
  const Bytes grey = ConvertImage(Colours(), PixelFormat::kMono8).bytes;
  EXPECT_NEAR(grey[0], 0.299 * 250, 1);
  EXPECT_NEAR(grey[1], 0.587 * 240, 1);
  EXPECT_NEAR(grey[2], 0.114 * 230, 1);
  EXPECT_EQ(grey[3], 255);
  const ServedImage mono = {2, 1, PixelFormat::kMono8, {7, 9}};
  EXPECT_EQ(ConvertImage(mono, PixelFormat::kRgb8).bytes, (Bytes{7, 7, 7, 9, 9, 9}));
  EXPECT_EQ(ConvertImage(mono, PixelFormat::kBayerRG8).bytes, mono.bytes);
}

TEST(ServedImage, RegionsBeyondTheImageAreBlack) {
  const ServedImage image = {3, 2, PixelFormat::kMono8, {1, 2, 3, 4, 5, 6}};
  EXPECT_EQ(CropImage(image, {1, 0, 2, 2}).bytes, (Bytes{2, 3, 5, 6}));
  EXPECT_EQ(CropImage(image, {2, 1, 2, 2}).bytes, (Bytes{6, 0, 0, 0}));
  EXPECT_EQ(CropImage(image, {5, 5, 1, 1}).bytes, (Bytes{0}));
  EXPECT_EQ(CropImage(Colours(), {1, 1, 1, 1}).bytes, (Bytes{255, 255, 255}));
}

/// A frame set of cameras "left" and "right" whose pictures are of one brightness each.
std::filesystem::path WriteSet(const std::filesystem::path& folder, uint8_t left,
                               const std::string& second = "right") {
  std::filesystem::create_directories(folder / "frames");
  FrameSet set;
  set.id = folder.filename();
  for (const std::string& camera : {std::string("left"), second}) {
    Picture picture(4, 3);
    picture.rgb[0] = left;
    picture.rgb[1] = camera == "left" ? 1 : 2;
    Frame frame;
    frame.camera = camera;
    frame.serial = "S-" + camera;
    frame.file = "frames/" + camera + ".png";
    frame.width_px = 4;
    frame.height_px = 3;
    frame.pixel_format = "RGB8";
    set.frames.push_back(frame);
    EXPECT_TRUE(WriteFileAtomically(folder / frame.file, *EncodePng(picture)).ok());
  }
  EXPECT_TRUE(WriteFileAtomically(folder / "frameset.json", FrameSetToJson(set)).ok());
  return folder;
}

TEST(LoadShots, ServesFrameSetsInARow) {
  const test::TemporaryFolder folder;
  ThreadPool threads(2);
  RunContext context{threads};
  const auto shots =
      LoadShots({WriteSet(folder / "a", 10), WriteSet(folder / "b", 20)}, std::nullopt, context);
  ASSERT_TRUE(shots.ok()) << shots.error().ToString();
  EXPECT_EQ(shots->cameras, (std::vector<std::string>{"left", "right"}));
  EXPECT_EQ(shots->format, PixelFormat::kRgb8);
  EXPECT_EQ(shots->source({1, 0})->bytes[0], 10);
  EXPECT_EQ(shots->source({1, 1})->bytes[0], 20);
  EXPECT_EQ(shots->source({1, 2})->bytes[0], 10);  // from the first again
  EXPECT_EQ(shots->source({0, 0})->bytes[1], 1);
  EXPECT_EQ(shots->source({1, 0})->bytes[1], 2);
  EXPECT_EQ(shots->source({0, 0}), shots->source({0, 2}));  // decoded once
  const auto cameras = CamerasOf(*shots);
  ASSERT_EQ(cameras.size(), 2u);
  EXPECT_EQ(cameras[1].name, "right");
  EXPECT_EQ(cameras[1].serial, "S-right");
  EXPECT_EQ(cameras[1].width_px, 4);
}

TEST(LoadShots, ServesEveryBayerPatternAsItIs) {
  const test::TemporaryFolder folder;
  ThreadPool threads(1);
  RunContext context{threads};
  for (const char* format : {"Mono8", "BayerRG8", "BayerGR8", "BayerGB8", "BayerBG8", "Mono12"}) {
    const auto place = folder / format;
    std::filesystem::create_directories(place);
    const Bytes pixels = {1, 2, 3, 4, 5, 6};
    const auto png = rig::EncodePng({pixels, 3, 2, 1});
    ASSERT_TRUE(png && WriteNewFile(place / "a.png", *png));
    FrameSet set;
    set.id = format;
    Frame& frame = set.frames.emplace_back();
    frame.camera = "a";
    frame.file = "a.png";
    frame.width_px = 3;
    frame.height_px = 2;
    frame.pixel_format = format;
    ASSERT_TRUE(WriteNewFile(place / "frameset.json", FrameSetToJson(set)));
    const auto shots = LoadShots({place}, std::nullopt, context);
    if (std::string(format) == "Mono12") {
      ASSERT_FALSE(shots);
      EXPECT_NE(shots.error().message.find("is \"Mono12\""), std::string::npos);
      continue;
    }
    ASSERT_TRUE(shots) << shots.error().ToString();
    EXPECT_STREQ(PixelFormatName(shots->format), format);
    EXPECT_EQ(shots->source({0, 0})->bytes, pixels);
  }
}

TEST(LoadShots, NamesWhatIsMissing) {
  const test::TemporaryFolder folder;
  ThreadPool threads(1);
  RunContext context{threads};
  const auto other =
      LoadShots({WriteSet(folder / "a", 10), WriteSet(folder / "b", 20, "middle")}, {}, context);
  ASSERT_FALSE(other.ok());
  EXPECT_NE(other.error().ToString().find("b: has no good frame of camera \"right\""),
            std::string::npos)
      << other.error().ToString();
  std::filesystem::resize_file(folder / "a/frames/left.png", 30);
  const auto cut = LoadShots({folder / "a"}, {}, context);
  ASSERT_FALSE(cut.ok());
  EXPECT_NE(cut.error().ToString().find("left.png"), std::string::npos);
  EXPECT_EQ(LoadShots({folder / "none"}, {}, context).error().code, ErrorCode::kNotFound);
}

}  // namespace
}  // namespace rotunda::sim
