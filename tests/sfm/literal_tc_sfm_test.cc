#include "sfm/literal_tc_sfm.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <string>

#include "tests/support/look_alike_world.h"
#include "tests/support/process.h"
#include "tests/support/reconstruction_near.h"

namespace rotunda::sfm {
namespace {

using test::ErrorsOf;
using test::FoldingOptions;
using test::LookAlikeOptions;
using test::MakeLookAlikeWorld;
using test::NotNear;
using test::SyntheticWorld;

class LiteralTcSfmTest : public ::testing::Test {
 protected:
  /// One grey picture is every camera's: superpixels of it are squares.
  static FrameSet GreyPictures(const SyntheticWorld& world, const test::TemporaryFolder& folder) {
    FrameSet set;
    set.folder = folder.path();
    const ImageFeatures& image = world.features.images[0];
    cv::imwrite((folder / "grey.png").string(),
                cv::Mat(image.height_px, image.width_px, CV_8UC3, cv::Scalar::all(128)));
    for (size_t i = 0; i < world.features.images.size(); ++i) {
      Frame& frame = set.frames.emplace_back();
      frame.camera = "c" + std::to_string(100 + i);
      frame.file = "grey.png";
    }
    return set;
  }

  Result<LiteralResult> Run(const SyntheticWorld& world, RunContext& context,
                            const LiteralOptions& options = {}) {
    return RunLiteralTcSfm(GreyPictures(world, folder_),
                           {world.features, world.intrinsics, world.two_views, world.view_graph},
                           options, {}, context);
  }
  Result<LiteralResult> Run(const SyntheticWorld& world, const LiteralOptions& options = {}) {
    return Run(world, context_, options);
  }

  test::TemporaryFolder folder_;
  ThreadPool threads_{2};
  RunContext context_{threads_};
};

/// A print all round the body whose two sides are different.
SyntheticWorld NothingLooksAlike(uint64_t seed) {
  LookAlikeOptions options;
  options.print_half_width_deg = 90;
  options.crossed_share = 0;
  options.seed = seed;
  return MakeLookAlikeWorld(options).world;
}

TEST_F(LiteralTcSfmTest, IsAsGoodAsPlainWhereNothingLooksAlike) {
  for (uint64_t seed = 1; seed <= 2; ++seed) {
    const SyntheticWorld world = NothingLooksAlike(seed);
    const auto plain = BuildReconstructions(world.Input(), {}, context_);
    const auto literal = Run(world);
    ASSERT_TRUE(plain && literal) << "seed " << seed;
    ASSERT_EQ(literal->models.models.size(), 1u) << "seed " << seed;
    EXPECT_TRUE(literal->models.unregistered.empty()) << "seed " << seed;
    const test::PoseErrors expected = ErrorsOf(plain->models[0], world.cam_from_world);
    EXPECT_EQ(NotNear(literal->models.models[0], world.cam_from_world,
                      1.5 * expected.max_rotation_rad, 1.5 * expected.max_position),
              "")
        << "seed " << seed;
  }
}

TEST_F(LiteralTcSfmTest, LabelsKeypointsAndTracksByCommunity) {
  const SyntheticWorld world = NothingLooksAlike(1);
  const auto literal = Run(world);
  ASSERT_TRUE(literal) << literal.error().ToString();
  const Segments& segments = literal->segments;
  ASSERT_GT(segments.segments.size(), 1u);
  size_t labelled = 0, of_all = 0;
  ASSERT_EQ(segments.of_keypoint.size(), world.features.images.size());
  for (size_t i = 0; i < segments.of_keypoint.size(); ++i) {
    ASSERT_EQ(segments.of_keypoint[i].size(), world.features.images[i].keypoints.size());
    for (const std::optional<uint32_t>& label : segments.of_keypoint[i]) {
      labelled += label.has_value();
      ++of_all;
      if (label) {
        EXPECT_LT(*label, segments.segments.size());
      }
    }
  }
  EXPECT_GT(labelled, of_all / 2);
  for (const Segment& segment : segments.segments) {
    EXPECT_TRUE(segment.look_alikes.empty()) << "the paper rejects no pair that could name them";
  }
}

/// Crossed pairs, many but light.
SyntheticWorld LightlyCrossed() {
  LookAlikeOptions options;
  options.crossed_share = 0.3;
  options.print_half_width_deg = 90;
  return MakeLookAlikeWorld(options).world;
}

TEST_F(LiteralTcSfmTest, TheConsistentViewGraphInFrontOfItTakesTheCrossedPairs) {
  const SyntheticWorld world = LightlyCrossed();
  LiteralOptions options;
  options.min_edge_weight = 0;  // so that the paper's threshold takes none of them
  const auto literal = Run(world, options);
  options.consistent_view_graph = true;
  const auto consistent = Run(world, options);
  ASSERT_TRUE(literal && consistent);
  const auto error_rad = [&](const LiteralResult& result) {
    return ErrorsOf(result.models.models[0], world.cam_from_world).max_rotation_rad;
  };
  EXPECT_GT(error_rad(*literal), RadFromDeg(10));
  EXPECT_LT(error_rad(*consistent), RadFromDeg(0.5));
}

TEST_F(LiteralTcSfmTest, TheLeastWeightCanBeThatOfTheHeaviestContradiction) {
  const SyntheticWorld world = LightlyCrossed();
  LiteralOptions options;
  options.min_edge_weight = 0;
  options.adaptive_edge_weight = true;
  const auto adaptive = Run(world, options);
  ASSERT_TRUE(adaptive) << adaptive.error().ToString();
  ASSERT_TRUE(adaptive->view_graph_margin.has_value());
  // Tracks of heavy edges alone are right; the light ones come back behind them and fold.
  const auto error_rad = [&](const LiteralResult& result) {
    return ErrorsOf(result.models.models[0], world.cam_from_world).max_rotation_rad;
  };
  EXPECT_GT(error_rad(*adaptive), RadFromDeg(10));
  options.confirmed_light_edges = true;
  const auto confirmed = Run(world, options);
  ASSERT_TRUE(confirmed) << confirmed.error().ToString();
  EXPECT_LT(error_rad(*confirmed), RadFromDeg(0.5));
}

TEST_F(LiteralTcSfmTest, NotesWhatWasKeptAndWhatCorrectionFound) {
  LiteralOptions options;
  options.min_edge_weight = 2;  // above all
  options.segments.min_diversity = 0;
  options.segments.diversity_inclusive = true;
  const auto literal = Run(NothingLooksAlike(1), options);
  ASSERT_TRUE(literal) << literal.error().ToString();
  ASSERT_GT(literal->notes.size(), 1u);
  const size_t images = NothingLooksAlike(1).cam_from_world.size();
  EXPECT_EQ(literal->notes[0], "lighter than 2.000000, but kept to hold the pictures together: " +
                                   std::to_string(images - 1) + " pairs");
  EXPECT_NE(literal->notes[1].find(" is ambiguous: "), std::string::npos) << literal->notes[1];
}

TEST_F(LiteralTcSfmTest, RejectedLinksNameWhatLooksAlike) {
  const SyntheticWorld world = LightlyCrossed();
  LiteralOptions options;
  options.segments.sign = AmbiguitySign::kRejectedLinks;
  options.min_edge_weight = 0.5;  // so that no track runs through a crossed pair
  const auto literal = Run(world, options);
  ASSERT_TRUE(literal) << literal.error().ToString();
  size_t named = 0;
  for (const Segment& segment : literal->segments.segments) named += !segment.look_alikes.empty();
  EXPECT_GT(named, 0u);
}

TEST_F(LiteralTcSfmTest, GivesTheSameBytesOnAnyNumberOfThreads) {
  const SyntheticWorld world = MakeLookAlikeWorld(FoldingOptions()).world;
  ThreadPool single(1);
  RunContext alone{single};
  const auto one = Run(world, alone), two = Run(world);
  ASSERT_TRUE(one && two);
  EXPECT_EQ(test::Difference(one->models.models, two->models.models), "");
  EXPECT_EQ(one->segments.of_keypoint, two->segments.of_keypoint);
  EXPECT_EQ(one->segments.of_track, two->segments.of_track);
}

TEST_F(LiteralTcSfmTest, RefusesBadOptions) {
  const SyntheticWorld world = NothingLooksAlike(1);
  const auto refusal_of = [&](const LiteralOptions& options) {
    const auto refused = Run(world, options);
    if (refused) return std::string("accepted");
    EXPECT_EQ(refused.error().code, ErrorCode::kInvalidArgument);
    return refused.error().ToString();
  };
  const auto expect = [&](const LiteralOptions& options, const std::string& name) {
    const std::string refusal = refusal_of(options);
    EXPECT_NE(refusal.find(name), std::string::npos) << refusal;
  };
  LiteralOptions options;
  options.min_edge_weight = -0.1;
  expect(options, "min_edge_weight");
  options = {};
  options.superpixels.count = 0;
  expect(options, "count");
  options = {};
  options.track_graph.min_track_length = 1;
  expect(options, "min_track_length");
  options = {};
  options.communities.resolution = 0;
  expect(options, "resolution");
  options = {};
  options.segments.min_diversity = 2;
  expect(options, "min_diversity");
  options = {};
  options.correction.max_place_rad = 0;
  expect(options, "max_place_rad");
  options = {};
  options.correction.min_met_ratio = 0;
  expect(options, "min_met_ratio");
  options = {};
  options.clusters.min_pair_matches = 0;
  expect(options, "min_pair_matches");
  options = {};
  options.clusters.trusted_margin = 0;
  expect(options, "trusted_margin");
  options = {};
  options.merging.max_duplicate_px = 0;
  expect(options, "max_duplicate_px");
}

TEST_F(LiteralTcSfmTest, StopsWhenAskedToAndSaysWhatFailed) {
  const SyntheticWorld world = NothingLooksAlike(1);
  std::stop_source stop;
  stop.request_stop();
  RunContext stopped{threads_, stop.get_token()};
  const auto cancelled = Run(world, stopped);
  ASSERT_FALSE(cancelled);
  EXPECT_EQ(cancelled.error().code, ErrorCode::kCancelled);
  // Without pictures nothing has a label, and nothing unlabelled is joined.
  FrameSet missing = GreyPictures(world, folder_);
  for (Frame& frame : missing.frames) frame.status = "missing";
  const auto none = RunLiteralTcSfm(
      missing, {world.features, world.intrinsics, world.two_views, world.view_graph}, {}, {},
      context_);
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::kFailed);
  EXPECT_NE(none.error().message.find("no cluster of pictures"), std::string::npos)
      << none.error().ToString();
}

}  // namespace
}  // namespace rotunda::sfm
