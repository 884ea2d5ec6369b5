#include "sfm/agreeing_matches.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "tests/support/look_alike_world.h"
#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

using test::FoldingOptions;
using test::IsCrossed;
using test::LookAlikeWorld;
using test::MakeLookAlikeWorld;
using test::MakeSyntheticWorld;
using test::SyntheticOptions;
using test::SyntheticWorld;
using test::TrueReconstruction;

const TwoView* Find(const TwoViews& views, const ImagePair& pair) {
  for (const TwoView& view : views.pairs) {
    if (view.pair == pair) return &view;
  }
  return nullptr;
}

TwoViews AgreeingWith(const Reconstruction& model, const SyntheticWorld& world, int threads = 2) {
  ThreadPool pool(threads);
  RunContext context{pool};
  return AgreeingMatches(model, world.features, world.two_views, {}, context);
}

TEST(AgreeingMatches, CrossedPairsAreLeftOutAndTrueOnesKept) {
  const LookAlikeWorld look_alike = MakeLookAlikeWorld(FoldingOptions());
  const SyntheticWorld& world = look_alike.world;
  ASSERT_GT(look_alike.crossed_pairs, 50u);
  const TwoViews agreeing = AgreeingWith(TrueReconstruction(world), world);
  EXPECT_TRUE(std::is_sorted(agreeing.pairs.begin(), agreeing.pairs.end(),
                             [](const TwoView& a, const TwoView& b) { return a.pair < b.pair; }));
  for (const TwoView& view : world.two_views.pairs) {
    const TwoView* kept = Find(agreeing, view.pair);
    ASSERT_EQ(kept == nullptr, IsCrossed(world, view))
        << view.pair.first.index() << "-" << view.pair.second.index();
    // Keypoints are off by 0.5 px, the limit is 4 px.
    if (kept) {
      EXPECT_EQ(kept->inliers, view.inliers);
    }
  }
}

TEST(AgreeingMatches, WrongMatchesOfATruePairGo) {
  SyntheticOptions options;
  options.wrong_match_share = 0.3;
  const SyntheticWorld world = MakeSyntheticWorld(options);
  const TwoViews agreeing = AgreeingWith(TrueReconstruction(world), world);
  double wrong = 0, wrong_kept = 0;
  for (const TwoView& all : world.two_views.pairs) {
    if (all.inliers.size() < 30) continue;  // may be left with fewer than 15
    const TwoView* found = Find(agreeing, all.pair);
    ASSERT_TRUE(found) << all.pair.first.index() << "-" << all.pair.second.index();
    const TwoView& kept = *found;
    for (const Match& match : all.inliers) {
      const bool in =
          std::find(kept.inliers.begin(), kept.inliers.end(), match) != kept.inliers.end();
      const bool right = world.point_of_keypoint[all.pair.first.index()][match.first.index()] ==
                         world.point_of_keypoint[all.pair.second.index()][match.second.index()];
      if (right) {
        EXPECT_TRUE(in);
      } else {
        ++wrong;
        wrong_kept += in;
      }
    }
  }
  // A band of 8 px along the epipolar line, over a body about 800 px high.
  ASSERT_GT(wrong, 500);
  EXPECT_LT(wrong_kept / wrong, 0.03);
}

TEST(AgreeingMatches, TheModelsRelativePoseReplacesTheEstimatedOne) {
  SyntheticWorld world = MakeSyntheticWorld({});
  TwoView& estimated = world.two_views.pairs[3];
  const Rigid3 truth = estimated.second_from_first;
  estimated.second_from_first.rotation =
      Eigen::AngleAxisd(RadFromDeg(20), Eigen::Vector3d::UnitY()) * truth.rotation;
  const TwoViews agreeing = AgreeingWith(TrueReconstruction(world), world);
  const TwoView* kept = Find(agreeing, estimated.pair);
  ASSERT_TRUE(kept);
  EXPECT_LT(RotationAngle_rad(kept->second_from_first.rotation, truth.rotation), 1e-7);
  EXPECT_NEAR((kept->second_from_first.translation - truth.translation).norm(), 0, 1e-9);
  EXPECT_NEAR(kept->second_from_first.translation.norm(), 1, 1e-12);
}

TEST(AgreeingMatches, PairsThatDoNotCountAreLeftOut) {
  SyntheticWorld world = MakeSyntheticWorld({});
  Reconstruction model = TrueReconstruction(world);
  const ImageId outside(5);
  model.cam_from_model[outside.index()].reset();
  const auto inside = [&](const TwoView& view) {
    return view.pair.first != outside && view.pair.second != outside;
  };
  std::vector<size_t> usable;
  for (size_t v = 0; v < world.two_views.pairs.size(); ++v) {
    if (inside(world.two_views.pairs[v])) usable.push_back(v);
  }
  ASSERT_GT(usable.size(), 4u);
  const auto pair = [&](size_t k) -> TwoView& { return world.two_views.pairs[usable[k]]; };
  pair(0).kind = TwoViewKind::kPanoramic;
  pair(1).inliers.resize(14);  // one less than enough
  pair(2).inliers.resize(15);
  const TwoViews agreeing = AgreeingWith(model, world);
  EXPECT_EQ(agreeing.pairs.size(), usable.size() - 2);
  EXPECT_FALSE(Find(agreeing, pair(0).pair));
  EXPECT_FALSE(Find(agreeing, pair(1).pair));
  EXPECT_TRUE(Find(agreeing, pair(2).pair));
  EXPECT_TRUE(std::all_of(agreeing.pairs.begin(), agreeing.pairs.end(), inside));
}

TEST(AgreeingMatches, APairOfWhichMostMatchesDisagreeIsLeftOut) {
  for (const double wrong_share : {0.4, 0.6}) {
    SyntheticWorld world = MakeSyntheticWorld({});
    TwoView& view = world.two_views.pairs.front();
    const auto wrong = static_cast<size_t>(wrong_share * static_cast<double>(view.inliers.size()));
    // The second keypoint is put aside by 100 px in both directions, off any epipolar line.
    for (size_t m = 0; m < wrong; ++m) {
      Keypoint& k =
          world.features.images[view.pair.second.index()].keypoints[view.inliers[m].second.index()];
      k.x_px += 100;
      k.y_px += 100;
    }
    const TwoViews agreeing = AgreeingWith(TrueReconstruction(world), world);
    const TwoView* kept = Find(agreeing, view.pair);
    EXPECT_EQ(kept != nullptr, wrong_share < 0.5) << wrong_share;
    if (kept) {
      EXPECT_EQ(kept->inliers.size(), view.inliers.size() - wrong);
    }
  }
}

TEST(AgreeingMatches, IsTheSameOnAnyNumberOfThreads) {
  SyntheticOptions options;
  options.wrong_match_share = 0.3;
  const SyntheticWorld world = MakeSyntheticWorld(options);
  const Reconstruction model = TrueReconstruction(world);
  const TwoViews one = AgreeingWith(model, world, 1), three = AgreeingWith(model, world, 3);
  ASSERT_EQ(one.pairs.size(), three.pairs.size());
  for (size_t v = 0; v < one.pairs.size(); ++v) {
    EXPECT_EQ(one.pairs[v].pair, three.pairs[v].pair);
    EXPECT_EQ(one.pairs[v].inliers, three.pairs[v].inliers);
    EXPECT_EQ(one.pairs[v].second_from_first.Matrix(), three.pairs[v].second_from_first.Matrix());
  }
}

}  // namespace
}  // namespace rotunda::sfm
