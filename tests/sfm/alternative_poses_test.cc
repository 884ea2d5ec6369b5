#include "sfm/alternative_poses.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "sfm/agreeing_matches.h"
#include "tests/support/look_alike_world.h"
#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

using test::FoldingOptions;
using test::LookAlikeOptions;
using test::LookAlikeWorld;
using test::MakeLookAlikeWorld;
using test::TrueReconstruction;

/// Of the right model.
Alternatives Find(const LookAlikeWorld& look_alike, int threads = 2,
                  const AlternativeOptions& options = {}) {
  ThreadPool pool(threads);
  RunContext context{pool};
  const test::SyntheticWorld& world = look_alike.world;
  const Reconstruction truth = TrueReconstruction(world);
  const TwoViews agreeing = AgreeingMatches(truth, world.features, world.two_views, {}, context);
  return FindAlternatives(truth, world.features, world.two_views, agreeing, {}, options, context);
}

TEST(AlternativePoses, CrossedMatchesWouldTurnEveryImageByHalfATurn) {
  const LookAlikeWorld look_alike = MakeLookAlikeWorld(FoldingOptions());
  const Alternatives alternatives = Find(look_alike);
  ASSERT_EQ(alternatives.poses.size(), look_alike.world.cam_from_world.size());
  const Rigid3 half_turn{Eigen::Quaterniond(Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitZ())),
                         Eigen::Vector3d::Zero()};
  for (size_t i = 0; i < alternatives.poses.size(); ++i) {
    const AlternativePose& pose = alternatives.poses[i];
    EXPECT_EQ(pose.image, ImageId(i));
    const Rigid3 expected = look_alike.world.cam_from_world[i] * half_turn;
    EXPECT_LT(RotationAngle_rad(pose.cam_from_model.rotation, expected.rotation), RadFromDeg(0.5));
    EXPECT_LT((pose.cam_from_model.OriginInSource() - expected.OriginInSource()).norm(), 0.015);
  }
}

TEST(AlternativePoses, WhatExistsOnceSpeaksAgainstThem) {
  double last = 0;
  for (const size_t head_points : {100, 200, 400}) {
    LookAlikeOptions options = FoldingOptions();
    options.head_points = head_points;
    const Alternatives alternatives = Find(MakeLookAlikeWorld(options));
    EXPECT_EQ(alternatives.poses.size(), 30u);
    EXPECT_GT(alternatives.evidence_against, 200) << head_points << " head points";
    EXPECT_GT(alternatives.evidence_against, 1.5 * last) << head_points << " head points";
    last = alternatives.evidence_against;
  }
}

TEST(AlternativePoses, NothingSpeaksAgainstThemWhereBothSidesAreAlike) {
  for (uint64_t seed = 1; seed <= 5; ++seed) {
    LookAlikeOptions options = FoldingOptions();
    options.head_points = 0;
    options.seed = seed;
    const Alternatives alternatives = Find(MakeLookAlikeWorld(options));
    EXPECT_EQ(alternatives.poses.size(), 30u) << "seed " << seed;
    EXPECT_LT(alternatives.evidence_against, 1.0) << "seed " << seed;
  }
}

TEST(AlternativePoses, NoneWhereNothingLooksAlike) {
  LookAlikeOptions options = FoldingOptions();
  options.crossed_share = 0;
  const Alternatives alternatives = Find(MakeLookAlikeWorld(options));
  EXPECT_TRUE(alternatives.poses.empty());
  EXPECT_EQ(alternatives.evidence_against, 0);
}

/// Matches of two neighbours that would have image 0 turned about the body by `turn_rad`: each of
/// its keypoints with that of the point which, from there, is seen nearest to it.
TwoView TurningMatches(const test::SyntheticWorld& world, ImageId other, double turn_rad) {
  constexpr double kNear_px = 4.0;
  const ImageId image(0);
  const Rigid3 turned =
      world.cam_from_world[0] *
      Rigid3{Eigen::Quaterniond(Eigen::AngleAxisd(turn_rad, Eigen::Vector3d::UnitZ())),
             Eigen::Vector3d::Zero()};
  TwoView view;
  view.pair = {image, other};
  const std::vector<Keypoint>& keypoints = world.features.image(image).keypoints;
  const std::vector<size_t>& seen = world.point_of_keypoint[other.index()];
  for (size_t k = 0; k < keypoints.size(); ++k) {
    for (size_t l = 0; l < seen.size(); ++l) {
      const auto pixel = world.intrinsics.of(image).Project(turned * world.points[seen[l]]);
      if (!pixel) continue;
      const Eigen::Vector2d off = *pixel - Eigen::Vector2d(keypoints[k].x_px, keypoints[k].y_px);
      if (off.norm() > kNear_px) continue;
      view.inliers.push_back({KeypointId(k), KeypointId(l)});
      break;
    }
  }
  return view;
}

/// Of `model` when the matches of image 0 with `other` would turn it about the body.
Alternatives FindTurned(const test::SyntheticWorld& world, const Reconstruction& model,
                        TwoViews two_views, ImageId other, double turn_rad) {
  const auto turning =
      std::find_if(two_views.pairs.begin(), two_views.pairs.end(), [&](const TwoView& view) {
        return view.pair == ImagePair{ImageId(0), other};
      });
  if (turning == two_views.pairs.end()) return {};
  TwoViews agreeing = two_views;
  agreeing.pairs.erase(agreeing.pairs.begin() + (turning - two_views.pairs.begin()));
  *turning = TurningMatches(world, other, turn_rad);
  ThreadPool pool(2);
  RunContext context{pool};
  return FindAlternatives(model, world.features, two_views, agreeing, {}, {}, context);
}

TEST(AlternativePoses, NothingSpeaksForOneThatSeesTheSameThingsInOtherPlaces) {
  test::SyntheticOptions options;
  options.columns = 20;
  options.points = 4000;
  const test::SyntheticWorld world = test::MakeSyntheticWorld(options);
  const Alternatives alternatives =
      FindTurned(world, TrueReconstruction(world), world.two_views, ImageId(1), RadFromDeg(15));
  ASSERT_GE(alternatives.poses.size(), 1u);
  const AlternativePose& pose = alternatives.poses.front();
  ASSERT_EQ(pose.image, ImageId(0));
  EXPECT_NEAR(DegFromRad(pose.rotation_rad), 15, 1);
  EXPECT_LT(pose.evidence_for, -50);
  EXPECT_GT(-pose.evidence_against, pose.evidence_for + 50)
      << "met anywhere in the picture, the same things would speak for it";
}

/// Image 0 no longer matches what lies within `radius_m` of the first point that it sees.
void MakeBlindTo(const test::SyntheticWorld& world, double radius_m, TwoViews& two_views) {
  const std::vector<size_t>& seen = world.point_of_keypoint[0];
  const Eigen::Vector3d centre = world.points[seen.front()];
  for (TwoView& view : two_views.pairs) {
    if (view.pair.first != ImageId(0)) continue;
    std::erase_if(view.inliers, [&](const Match& match) {
      return (world.points[seen[match.first.index()]] - centre).norm() < radius_m;
    });
  }
}

/// Takes images out of a model.
void Unregister(const std::vector<ImageId>& images, Reconstruction& model) {
  const auto gone = [&](ImageId image) {
    return std::find(images.begin(), images.end(), image) != images.end();
  };
  for (const ImageId image : images) model.cam_from_model[image.index()].reset();
  for (Point3& point : model.points) {
    std::erase_if(point.observations, [&](const Observation& o) { return gone(o.image); });
  }
}

TEST(AlternativePoses, NothingSpeaksForOneThatShouldMeetNothing) {
  test::SyntheticOptions options;
  options.columns = 20;
  options.rows = 1;
  options.points = 6000;
  const test::SyntheticWorld world = test::MakeSyntheticWorld(options);
  TwoViews two_views = world.two_views;
  MakeBlindTo(world, 0.15, two_views);
  // Image 0 would stand a quarter of the ring farther, where no camera is within 30 degrees.
  Reconstruction model = TrueReconstruction(world);
  Unregister({ImageId(3), ImageId(4), ImageId(5), ImageId(6), ImageId(7)}, model);
  const Alternatives alternatives =
      FindTurned(world, model, two_views, ImageId(2), RadFromDeg(-90));
  ASSERT_GE(alternatives.poses.size(), 1u);
  const AlternativePose& pose = alternatives.poses.front();
  ASSERT_EQ(pose.image, ImageId(0));
  EXPECT_NEAR(DegFromRad(pose.rotation_rad), 90, 1);
  EXPECT_LT(pose.evidence_against, -3) << "the image misses something, the alternative nothing";
  EXPECT_LE(pose.evidence_for, 0);
}

TEST(AlternativePoses, EvidenceForOneOfAnImageOnTheWrongSide) {
  // Image 0 is where its crossed matches would have it: the alternative is its true place.
  const LookAlikeWorld look_alike = MakeLookAlikeWorld(FoldingOptions());
  const test::SyntheticWorld& world = look_alike.world;
  Reconstruction model = TrueReconstruction(world);
  const Rigid3 half_turn{Eigen::Quaterniond(Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitZ())),
                         Eigen::Vector3d::Zero()};
  model.cam_from_model[0] = world.cam_from_world[0] * half_turn;
  ThreadPool pool(2);
  RunContext context{pool};
  const TwoViews agreeing = AgreeingMatches(model, world.features, world.two_views, {}, context);
  const Alternatives alternatives =
      FindAlternatives(model, world.features, world.two_views, agreeing, {}, {}, context);
  ASSERT_GE(alternatives.poses.size(), 1u);
  const AlternativePose& pose = alternatives.poses.front();
  ASSERT_EQ(pose.image, ImageId(0));
  EXPECT_LT(RotationAngle_rad(pose.cam_from_model.rotation, world.cam_from_world[0].rotation),
            RadFromDeg(0.5));
  EXPECT_GT(pose.evidence_for, 3);
  EXPECT_LT(pose.evidence_against, -3);
}

TEST(AlternativePoses, OptionsSayWhatCountsAsOne) {
  const LookAlikeWorld look_alike = MakeLookAlikeWorld(FoldingOptions());
  EXPECT_TRUE(Find(look_alike, 2, {.min_inliers = 100000}).poses.empty());
  // More than half a turn off there is nothing.
  EXPECT_TRUE(Find(look_alike, 2, {.min_rotation_rad = RadFromDeg(181)}).poses.empty());
}

TEST(AlternativePoses, GivesTheSameOnAnyNumberOfThreads) {
  const LookAlikeWorld look_alike = MakeLookAlikeWorld(FoldingOptions());
  const Alternatives one = Find(look_alike, 1), two = Find(look_alike, 2);
  EXPECT_EQ(one.evidence_against, two.evidence_against);
  ASSERT_EQ(one.poses.size(), two.poses.size());
  for (size_t i = 0; i < one.poses.size(); ++i) {
    EXPECT_EQ(one.poses[i].image, two.poses[i].image);
    EXPECT_EQ(one.poses[i].cam_from_model.Matrix(), two.poses[i].cam_from_model.Matrix());
  }
}

}  // namespace
}  // namespace rotunda::sfm
