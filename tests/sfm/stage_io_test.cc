#include "sfm/stage_io.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <limits>

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
}

TEST(StageIo, FeaturesThatAreNotNumbersAreRefused) {
  const test::TemporaryFolder folder;
  Features features = TwoSmallPictures();
  features.images[1].keypoints[2].y_px = std::numeric_limits<float>::quiet_NaN();
  ASSERT_TRUE(WriteFeatures(features, folder / "f").ok());
  const auto read = ReadFeatures(folder / "f");
  ASSERT_FALSE(read.ok());
  EXPECT_EQ(read.error().message, "a keypoint of picture 1 is not finite numbers");
}

TEST(StageIo, PosesThatAreNoneAreRefused) {
  const test::TemporaryFolder folder;
  const auto reads = [&](const std::function<void(TwoView&)>& change) {
    TwoView view;
    view.pair = kPair;
    change(view);
    EXPECT_TRUE(WriteTwoViews({{view}}, folder / "t").ok());
    return ReadTwoViews(folder / "t", TwoSmallPictures()).ok();
  };
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  EXPECT_TRUE(reads([](TwoView&) {}));
  EXPECT_TRUE(reads([](TwoView& v) { v.second_from_first.rotation.w() = 1 + 0.9e-6; }));
  EXPECT_FALSE(reads([](TwoView& v) { v.second_from_first.rotation.w() = 1 + 1.1e-6; }));
  EXPECT_FALSE(reads([](TwoView& v) { v.second_from_first.rotation.x() = kNaN; }));
  EXPECT_FALSE(reads([](TwoView& v) { v.second_from_first.translation.y() = kInfinity; }));
  EXPECT_FALSE(reads([](TwoView& v) { v.median_angle_rad = kNaN; }));
}

TEST(StageIo, TracksThatAreNoneAreRefused) {
  const test::TemporaryFolder folder;
  const auto problem = [&](const std::vector<Observation>& observations) -> std::string {
    EXPECT_TRUE(WriteTracks({{{observations}}}, folder / "k").ok());
    const auto read = ReadTracks(folder / "k", TwoSmallPictures());
    return read.ok() ? "" : read.error().message;
  };
  const auto at = [](size_t image, size_t keypoint) {
    return Observation{ImageId(image), KeypointId(keypoint)};
  };
  EXPECT_EQ(problem({at(0, 2), at(1, 3)}), "");
  EXPECT_EQ(problem({at(0, 3), at(1, 3)}), "track 0 names a keypoint that is not there");
  EXPECT_EQ(problem({at(0, 0), at(2, 0)}), "track 0 names a keypoint that is not there");
  EXPECT_EQ(problem({at(1, 0), at(0, 0)}), "track 0 is not sorted by picture");
  EXPECT_EQ(problem({at(0, 0), at(0, 1)}), "track 0 has two observations in one picture");
  EXPECT_EQ(problem({at(1, 0)}), "track 0 has 1 observations, expected 2 or more");
  EXPECT_EQ(problem({}), "track 0 has 0 observations, expected 2 or more");
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
