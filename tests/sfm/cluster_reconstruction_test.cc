#include "sfm/cluster_reconstruction.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/look_alike_world.h"
#include "tests/support/reconstruction_near.h"

namespace rotunda::sfm {
namespace {

using test::ErrorsOf;
using test::kPrintSegment;
using test::LookAlikeOptions;
using test::LookAlikeWorld;
using test::MakeLookAlikeWorld;

std::vector<ImageId> ImagesFromTo(size_t begin, size_t end) {
  std::vector<ImageId> images;
  for (size_t i = begin; i < end; ++i) images.push_back(ImageId(i));
  return images;
}

class ClusterTest : public ::testing::Test {
 protected:
  Correction Corrected(const LookAlikeWorld& look) {
    return BuildCorrection(look.world.Input(), look.segments, {}, context_).value();
  }
  Result<std::vector<Reconstruction>> Build(const LookAlikeWorld& look,
                                            const Correction& correction,
                                            const ClusterOptions& options) {
    return BuildClusterReconstructions(look.world.Input(), correction, options, {}, context_);
  }
  ThreadPool threads_{2};
  RunContext context_{threads_};
};

TEST(BuildClusters, MergesWhatSharesMoreImagesThanAllowed) {
  const test::SyntheticWorld world;  // only images count
  Correction correction;
  correction.parts = {{0, ImagesFromTo(50, 75)},   // shares 20 with the largest: just not enough
                      {1, ImagesFromTo(0, 70)},    // the largest
                      {2, ImagesFromTo(40, 61)},   // 21 with the largest
                      {3, {}},                     // nothing related to it
                      {4, ImagesFromTo(80, 100)},  // shares nothing
                      {5, ImagesFromTo(75, 95)}};  // as large; 15 with the one before
  const std::vector<ImageCluster> clusters = BuildClusters(world.Input(), correction, {});
  ASSERT_EQ(clusters.size(), 4u);
  EXPECT_EQ(clusters[0].parts, (std::vector<uint32_t>{1, 2}));
  EXPECT_EQ(clusters[0].images, ImagesFromTo(0, 70));
  EXPECT_EQ(clusters[1].parts, (std::vector<uint32_t>{0}));
  EXPECT_EQ(clusters[2].parts, (std::vector<uint32_t>{4}));
  EXPECT_EQ(clusters[3].parts, (std::vector<uint32_t>{5}));
}

TEST(BuildClusters, AClusterThatGrewTakesUpWhatItDidNotBefore) {
  const test::SyntheticWorld world;  // only images count
  Correction correction;
  correction.parts = {
      {0, ImagesFromTo(0, 40)}, {0, ImagesFromTo(45, 70)}, {1, ImagesFromTo(15, 52)}};
  // 25 images tie the first and the third; the second shares 7 with the third alone.
  EXPECT_EQ(BuildClusters(world.Input(), correction, {}).size(), 2u);
  const std::vector<ImageCluster> clusters =
      BuildClusters(world.Input(), correction, {.max_common_images = 6});
  ASSERT_EQ(clusters.size(), 1u);
  EXPECT_EQ(clusters[0].parts, (std::vector<uint32_t>{0, 1, 2}));
  EXPECT_EQ(clusters[0].images, ImagesFromTo(0, 70));
}

TEST_F(ClusterTest, MatchesWithinPartsAreTrue) {
  const LookAlikeWorld look = MakeLookAlikeWorld({});
  const std::vector<ImageId> all = ImagesFromTo(0, look.world.cam_from_world.size());
  const TwoViews matches = MatchesWithinParts(look.world.Input(), Corrected(look), all, {});
  size_t kept = 0;
  for (const TwoView& view : matches.pairs) {
    for (const Match& match : view.inliers) {
      EXPECT_EQ(look.world.point_of_keypoint[view.pair.first.index()][match.first.index()],
                look.world.point_of_keypoint[view.pair.second.index()][match.second.index()]);
    }
    kept += view.inliers.size();
  }
  EXPECT_EQ(look.world.two_views.pairs.size() - look.crossed_pairs, matches.pairs.size());
  EXPECT_GT(kept, 5000u);
  // And only between images that are asked for.
  for (const TwoView& view :
       MatchesWithinParts(look.world.Input(), Corrected(look), ImagesFromTo(0, 6), {}).pairs) {
    EXPECT_LT(view.pair.second, ImageId(6));
  }
}

TEST_F(ClusterTest, EveryClusterGivesAModelThatIsNotFolded) {
  const LookAlikeWorld look = MakeLookAlikeWorld({});
  const Correction correction = Corrected(look);
  const std::vector<ImageCluster> clusters = BuildClusters(look.world.Input(), correction, {});
  ASSERT_EQ(clusters.size(), 3u);  // head, front, back
  const auto models = Build(look, correction, {});
  ASSERT_TRUE(models) << models.error().ToString();
  ASSERT_EQ(models->size(), 3u);
  for (size_t m = 0; m < models->size(); ++m) {
    EXPECT_EQ(RegisteredCount((*models)[m]), clusters[m].images.size());
    // The head is small: a hundred keypoints within 250 pixels.
    EXPECT_LT(ErrorsOf((*models)[m], look.world.cam_from_world).max_rotation_rad,
              RadFromDeg(m == 0 ? 1.0 : 0.5))
        << "model " << m;
  }
}

TEST_F(ClusterTest, LabelsHoldTheSidesApartInAMergedCluster) {
  const LookAlikeWorld look = MakeLookAlikeWorld({});
  const Correction correction = Corrected(look);
  const ClusterOptions options{.max_common_images = 8};
  EXPECT_EQ(BuildClusters(look.world.Input(), correction, options).at(0).parts,
            (std::vector<uint32_t>{0, 1, 2}));
  const auto models = Build(look, correction, options);
  ASSERT_TRUE(models) << models.error().ToString();
  ASSERT_EQ(models->size(), 1u);
  EXPECT_EQ(RegisteredCount(models->front()), look.world.cam_from_world.size());
  EXPECT_LT(ErrorsOf(models->front(), look.world.cam_from_world).max_rotation_rad, RadFromDeg(0.5));
  // The same images and matches without correction fold.
  const auto folded = BuildReconstructions(look.world.Input(), {}, context_);
  ASSERT_TRUE(folded) << folded.error().ToString();
  EXPECT_GT(ErrorsOf(folded->models[0], look.world.cam_from_world).max_rotation_rad,
            RadFromDeg(20.0));
}

TEST_F(ClusterTest, AMergeOfImagesThatContradictEachOtherIsUndone) {
  const LookAlikeWorld look = MakeLookAlikeWorld(test::FoldingOptions());
  Correction correction;
  // Two arcs of the ring without opposite cameras, whose union has some; matches of one part.
  correction.parts = {{kPrintSegment, {}}, {kPrintSegment, {}}};
  for (size_t i = 0; i < look.azimuth_rad.size(); ++i) {
    const double azimuth_deg = DegFromRad(look.azimuth_rad[i]);
    if (azimuth_deg > -85 && azimuth_deg < 65) correction.parts[0].images.emplace_back(i);
    if (azimuth_deg > 20 && azimuth_deg < 170) correction.parts[1].images.emplace_back(i);
    correction.part_of_keypoint.emplace_back(look.world.features.images[i].keypoints.size(), 0);
  }
  ClusterOptions options{.max_common_images = 3};
  EXPECT_EQ(BuildClusters(look.world.Input(), correction, options).size(), 1u);
  options.undo_inconsistent_merges = true;
  EXPECT_EQ(BuildClusters(look.world.Input(), correction, options).size(), 2u);
  options.trusted_margin = 0.1;
  EXPECT_EQ(BuildClusters(look.world.Input(), correction, options).size(), 1u);
}

TEST_F(ClusterTest, SaysWhyThereIsNoModel) {
  const LookAlikeWorld look = MakeLookAlikeWorld({.head_points = 0});
  Correction correction = Corrected(look);
  ASSERT_EQ(correction.parts.size(), 1u);  // the head, which no picture shows
  const auto none = Build(look, correction, {});
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::kFailed);
  EXPECT_EQ(none.error().message,
            "no cluster of pictures gives a model: no picture is related to any part of the scene");
  correction.parts = {{0, ImagesFromTo(0, 4)}};
  const auto failed = Build(look, correction, {});
  ASSERT_FALSE(failed);
  EXPECT_EQ(failed.error().message, "no cluster of pictures gives a model: no two pictures match");
}

TEST_F(ClusterTest, AClusterWithoutAModelDoesNotFailTheRest) {
  const LookAlikeWorld look = MakeLookAlikeWorld({});
  Correction correction = Corrected(look);
  // As many images as the largest, of which no keypoint is labelled with this part.
  correction.parts.push_back({0, ImagesFromTo(0, look.world.cam_from_world.size())});
  const ClusterOptions options{.max_common_images = look.world.cam_from_world.size()};
  ASSERT_EQ(BuildClusters(look.world.Input(), correction, options).size(), correction.parts.size());
  const auto models = Build(look, correction, options);
  ASSERT_TRUE(models) << models.error().ToString();
  EXPECT_GE(models->size(), 3u);
}

TEST_F(ClusterTest, GivesTheSameBytesOnAnyNumberOfThreads) {
  const LookAlikeWorld look = MakeLookAlikeWorld({});
  const Correction correction = Corrected(look);
  const auto two = Build(look, correction, {});
  ThreadPool single(1);
  RunContext alone{single};
  const auto one = BuildClusterReconstructions(look.world.Input(), correction, {}, {}, alone);
  ASSERT_TRUE(one && two);
  EXPECT_EQ(test::Difference(*one, *two), "");
}

TEST_F(ClusterTest, StopsWhenAskedToAndRefusesBadOptions) {
  const LookAlikeWorld look = MakeLookAlikeWorld({});
  const Correction correction = Corrected(look);
  std::stop_source stop;
  stop.request_stop();
  RunContext stopped{threads_, stop.get_token()};
  const auto cancelled =
      BuildClusterReconstructions(look.world.Input(), correction, {}, {}, stopped);
  ASSERT_FALSE(cancelled);
  EXPECT_EQ(cancelled.error().code, ErrorCode::kCancelled);
  const auto refused = Build(look, correction, {.min_pair_matches = 0});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().context, "min_pair_matches");
}

}  // namespace
}  // namespace rotunda::sfm
