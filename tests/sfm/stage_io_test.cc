#include "sfm/stage_io.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <functional>

#include "sfm/core/file_io.h"
#include "tests/support/process.h"

namespace rotunda::sfm {
namespace {

Features TwoSmallPictures() {
  Features features;
  for (size_t i = 0; i < 2; ++i) {
    ImageFeatures& image = features.images.emplace_back();
    image.width_px = 40;
    image.height_px = 30;
    for (size_t k = 0; k < 3 + i; ++k) {
      image.keypoints.push_back({1.5F * k, 2.25F, 1.0F, 0.5F});
      image.colors_rgb.push_back({static_cast<uint8_t>(k), 2, 3});
      for (size_t d = 0; d < kDescriptorSize; ++d) image.descriptors.push_back(d + k);
    }
  }
  return features;
}

const ImagePair kPair = {ImageId(0), ImageId(1)};
const std::vector<Match> kMatches = {{KeypointId(0), KeypointId(3)},
                                     {KeypointId(2), KeypointId(1)}};

TEST(StageIo, EveryProductComesBackAsItWas) {
  const test::TemporaryFolder folder;
  const Features features = TwoSmallPictures();
  ASSERT_TRUE(WriteFeatures(features, folder / "f").ok());
  const auto features_back = ReadFeatures(folder / "f");
  ASSERT_TRUE(features_back.ok()) << features_back.error().ToString();
  EXPECT_EQ(features_back->images[1].descriptors, features.images[1].descriptors);
  EXPECT_EQ(features_back->images[1].colors_rgb, features.images[1].colors_rgb);
  EXPECT_EQ(features_back->images[1].keypoints[2].x_px, features.images[1].keypoints[2].x_px);

  ASSERT_TRUE(WriteMatches({{{kPair, kMatches}}}, folder / "m").ok());
  const auto matches_back = ReadMatches(folder / "m", features);
  ASSERT_TRUE(matches_back.ok()) << matches_back.error().ToString();
  EXPECT_EQ(matches_back->pairs[0].matches, kMatches);

  TwoView view;
  view.pair = kPair;
  view.kind = TwoViewKind::kPlanar;
  view.second_from_first = {Eigen::Quaterniond(0.5, 0.5, 0.5, 0.5), Eigen::Vector3d(0, 0, 1)};
  view.inliers = kMatches;
  view.median_angle_rad = 0.125;
  ASSERT_TRUE(WriteTwoViews({{view}}, folder / "t").ok());
  const auto views_back = ReadTwoViews(folder / "t", features);
  ASSERT_TRUE(views_back.ok()) << views_back.error().ToString();
  EXPECT_EQ(views_back->pairs[0].kind, view.kind);
  EXPECT_EQ(views_back->pairs[0].inliers, kMatches);
  EXPECT_EQ(views_back->pairs[0].median_angle_rad, 0.125);
  EXPECT_EQ(views_back->pairs[0].second_from_first.rotation.coeffs(),
            view.second_from_first.rotation.coeffs());

  const Tracks tracks{{{{{ImageId(0), KeypointId(1)}, {ImageId(1), KeypointId(3)}}}}};
  ASSERT_TRUE(WriteTracks(tracks, folder / "k").ok());
  const auto tracks_back = ReadTracks(folder / "k", features);
  ASSERT_TRUE(tracks_back.ok()) << tracks_back.error().ToString();
  EXPECT_EQ(tracks_back->tracks[0].observations, tracks.tracks[0].observations);
}

TEST(StageIo, EveryTruncationIsRefused) {
  const test::TemporaryFolder folder;
  const Features features = TwoSmallPictures();
  ASSERT_TRUE(WriteMatches({{{kPair, kMatches}}}, folder / "m").ok());
  const std::string whole = *ReadFile(folder / "m");
  for (size_t length = 0; length < whole.size(); ++length) {
    ASSERT_TRUE(WriteFileAtomically(folder / "m", whole.substr(0, length)).ok());
    const auto read = ReadMatches(folder / "m", features);
    ASSERT_FALSE(read.ok()) << length << " of " << whole.size() << " bytes were taken";
    EXPECT_EQ(read.error().code, ErrorCode::kBadInput);
  }
  ASSERT_TRUE(WriteFileAtomically(folder / "m", whole + "x").ok());
  EXPECT_FALSE(ReadMatches(folder / "m", features).ok());
}

TEST(StageIo, KeypointsThatAreNotThereAreRefused) {
  const test::TemporaryFolder folder;
  const Features features = TwoSmallPictures();
  ASSERT_TRUE(WriteMatches({{{kPair, {{KeypointId(3), KeypointId(0)}}}}}, folder / "m").ok());
  EXPECT_FALSE(ReadMatches(folder / "m", features).ok());
  ASSERT_TRUE(WriteMatches({{{{ImageId(1), ImageId(0)}, {}}}}, folder / "m").ok());
  EXPECT_FALSE(ReadMatches(folder / "m", features).ok());
  ASSERT_TRUE(WriteTracks({{{{{ImageId(2), KeypointId(0)}}}}}, folder / "k").ok());
  EXPECT_FALSE(ReadTracks(folder / "k", features).ok());
}

TEST(StageIo, AnotherKindOfFileIsNamed) {
  const test::TemporaryFolder folder;
  ASSERT_TRUE(WriteTracks({}, folder / "k").ok());
  const auto read = ReadFeatures(folder / "k");
  ASSERT_FALSE(read.ok());
  EXPECT_NE(read.error().ToString().find("rotunda-tracks/1"), std::string::npos);
  EXPECT_NE(read.error().ToString().find("rotunda-features/1"), std::string::npos);
}

}  // namespace
}  // namespace rotunda::sfm
