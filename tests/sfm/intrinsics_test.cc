#include "sfm/intrinsics.h"

#include <gtest/gtest.h>

namespace rotunda::sfm {
namespace {

FrameSet SetOf(const std::vector<std::string>& cameras) {
  FrameSet set;
  for (const std::string& camera : cameras) {
    Frame frame;
    frame.camera = camera;
    frame.file = camera + ".png";
    set.frames.push_back(frame);
  }
  return set;
}

Features SizesOf(const std::vector<std::pair<int, int>>& sizes) {
  Features features;
  for (const auto& [width_px, height_px] : sizes) {
    features.images.push_back({width_px, height_px, {}, {}, {}});
  }
  return features;
}

Calibration CalibrationOf(const std::vector<std::string>& cameras) {
  Calibration calibration;
  calibration.id = "cal-1";
  for (const std::string& camera : cameras) {
    calibration.cameras.push_back(
        {camera, "", DefaultIntrinsics(1200, 1600, 1400.0 + camera.size()), {}, {}});
  }
  return calibration;
}

TEST(BuildIntrinsics, GuessesFromTheLargerSide) {
  const auto intrinsics =
      BuildIntrinsics(SetOf({"a", "b"}), SizesOf({{1200, 1600}, {800, 600}}), {});
  ASSERT_TRUE(intrinsics.ok());
  EXPECT_FALSE(intrinsics->known);
  ASSERT_EQ(intrinsics->lenses.size(), 2U);
  EXPECT_EQ(intrinsics->of(ImageId(0)).model, CameraModel::kSimpleRadial);
  EXPECT_DOUBLE_EQ(intrinsics->of(ImageId(0)).fx_px(), 1.2 * 1600);
  EXPECT_DOUBLE_EQ(intrinsics->of(ImageId(0)).cx_px(), 600);
  EXPECT_DOUBLE_EQ(intrinsics->of(ImageId(1)).fx_px(), 1.2 * 800);
  EXPECT_DOUBLE_EQ(intrinsics->of(ImageId(1)).cy_px(), 300);
}

TEST(BuildIntrinsics, TakesTheCalibrationByName) {
  const auto intrinsics = BuildIntrinsics(
      SetOf({"b", "ccc"}), SizesOf({{1200, 1600}, {1200, 1600}}), CalibrationOf({"a", "b", "ccc"}));
  ASSERT_TRUE(intrinsics.ok());
  EXPECT_TRUE(intrinsics->known);
  EXPECT_DOUBLE_EQ(intrinsics->of(ImageId(0)).fx_px(), 1401);
  EXPECT_DOUBLE_EQ(intrinsics->of(ImageId(1)).fx_px(), 1403);
}

TEST(BuildIntrinsics, ACameraWithoutAPictureNeedsNoCalibration) {
  FrameSet set = SetOf({"a", "x"});
  set.frames[1].status = "missing";
  const auto intrinsics =
      BuildIntrinsics(set, SizesOf({{1200, 1600}, {0, 0}}), CalibrationOf({"a"}));
  ASSERT_TRUE(intrinsics.ok()) << intrinsics.error().ToString();
  EXPECT_TRUE(intrinsics->known);
  EXPECT_TRUE(intrinsics->of(ImageId(1)).Validate().ok());
}

TEST(BuildIntrinsics, SaysWhatTheCalibrationLacks) {
  const auto unknown = BuildIntrinsics(SetOf({"x"}), SizesOf({{1200, 1600}}), CalibrationOf({"a"}));
  ASSERT_FALSE(unknown.ok());
  EXPECT_EQ(unknown.error().code, ErrorCode::kBadInput);
  EXPECT_NE(unknown.error().context.find("'x'"), std::string::npos);
  EXPECT_NE(unknown.error().message.find("cal-1"), std::string::npos);

  const auto size = BuildIntrinsics(SetOf({"a"}), SizesOf({{600, 800}}), CalibrationOf({"a"}));
  ASSERT_FALSE(size.ok());
  EXPECT_NE(size.error().message.find("600x800"), std::string::npos);
  EXPECT_NE(size.error().message.find("1200x1600"), std::string::npos);
}

}  // namespace
}  // namespace rotunda::sfm
