#include "sfm/correction.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "tests/support/look_alike_world.h"

namespace rotunda::sfm {
namespace {

using test::kHeadSegment;
using test::kPrintSegment;
using test::LookAlikeOptions;
using test::LookAlikeWorld;
using test::MakeLookAlikeWorld;

/// The paper's readings.
CorrectionOptions Literal() {
  CorrectionOptions options;
  options.next = NextImage::kMostPrimaryPoints;
  options.place_distance = PlaceDistance::kTranslationAngle;
  options.undecided_is_consistent = true;
  options.labels_by_track = false;
  options.max_sigma_share = std::numeric_limits<double>::infinity();
  return options;
}

class CorrectionTest : public ::testing::Test {
 protected:
  Result<Correction> Build(const LookAlikeWorld& look, const CorrectionOptions& options) {
    return BuildCorrection(look.world.Input(), look.segments, options, context_);
  }
  ThreadPool threads_{2};
  RunContext context_{threads_};
};

/// Sides of the images, as a set.
std::set<bool> SidesOf(const LookAlikeWorld& look, const std::vector<ImageId>& images) {
  std::set<bool> sides;
  for (const ImageId image : images) sides.insert(look.SeesFront(image));
  return sides;
}

size_t CountOf(const SegmentCorrection& segment, ImageVerdict verdict) {
  return static_cast<size_t>(
      std::count_if(segment.judgements.begin(), segment.judgements.end(),
                    [&](const Judgement& j) { return j.verdict == verdict; }));
}

TEST_F(CorrectionTest, TakesTheSidesOfALookAlikeApart) {
  for (uint64_t seed = 1; seed <= 3; ++seed) {
    const LookAlikeWorld look = MakeLookAlikeWorld({.seed = seed});
    ASSERT_GT(look.crossed_pairs, 20u);
    const auto result = Build(look, {});
    ASSERT_TRUE(result) << result.error().ToString();
    ASSERT_EQ(result->segments.size(), 1u);
    const SegmentCorrection& print = result->segments[0];
    EXPECT_EQ(print.segment, kPrintSegment);
    ASSERT_EQ(print.subsets.size(), 2u) << "seed " << seed;
    EXPECT_TRUE(print.left_out.empty());
    for (const auto& subset : print.subsets) {
      EXPECT_EQ(subset.size(), 10u);
      EXPECT_EQ(SidesOf(look, subset).size(), 1u);
    }
    EXPECT_GT(CountOf(print, ImageVerdict::kInconsistent), 0u);
  }
}

TEST_F(CorrectionTest, GivesTheEvidenceOfEveryVerdict) {
  const LookAlikeWorld look = MakeLookAlikeWorld({});
  const CorrectionOptions options;
  const auto result = Build(look, options);
  ASSERT_TRUE(result) << result.error().ToString();
  const SegmentCorrection& print = result->segments[0];
  const bool first_is_front = look.SeesFront(print.subsets[0].front());
  // Every image in the first pass, those of the second subset in the second.
  EXPECT_EQ(print.judgements.size(), 30u);
  EXPECT_EQ(CountOf(print, ImageVerdict::kInitial), 4u);
  for (const Judgement& j : print.judgements) {
    const bool own_side = look.SeesFront(j.image) == (first_is_front == (j.pass == 0));
    switch (j.verdict) {
      case ImageVerdict::kConsistent:
        EXPECT_TRUE(own_side);
        EXPECT_LT(*j.rotation_rad, RadFromDeg(3.0));
        EXPECT_LT(*j.place_rad, RadFromDeg(6.0));
        EXPECT_GE(j.auxiliary_inliers, options.min_auxiliary_inliers);
        break;
      case ImageVerdict::kInconsistent:
        EXPECT_FALSE(own_side);
        EXPECT_NEAR(DegFromRad(*j.rotation_rad), 180.0, 6.0);
        // Half a turn, seen from a point 0.25 m off the axis and up to 0.4 m below the camera, at
        // 1.7 m: short of 180 degrees by up to 8 and twice 13 degrees, and noise.
        EXPECT_GT(DegFromRad(*j.place_rad), 140.0);
        EXPECT_GE(j.primary_inliers, options.min_primary_inliers);
        break;
      case ImageVerdict::kUndecided:
        EXPECT_FALSE(own_side);
        EXPECT_FALSE(j.rotation_rad && j.rotation_sigma_rad < 0.05 && j.place_sigma_rad < 0.11);
        break;
      default:
        EXPECT_TRUE(own_side || j.verdict == ImageVerdict::kUnplaced);
    }
  }
}

TEST_F(CorrectionTest, IsUndecidedWithoutAuxiliaryPoints) {
  const LookAlikeWorld look = MakeLookAlikeWorld({.head_points = 0});
  const auto result = Build(look, {});
  ASSERT_TRUE(result) << result.error().ToString();
  const SegmentCorrection& print = result->segments[0];
  EXPECT_TRUE(print.subsets.empty());
  EXPECT_EQ(print.left_out, look.segments.segments[kPrintSegment].images);
  ASSERT_EQ(print.judgements.size(), print.left_out.size());
  EXPECT_EQ(CountOf(print, ImageVerdict::kUndecided), print.left_out.size());
  for (const auto& image : result->part_of_keypoint) {
    for (const auto& part : image) EXPECT_FALSE(part);
  }
}

TEST_F(CorrectionTest, TakingTheUndecidedForConsistentFolds) {
  const LookAlikeWorld look = MakeLookAlikeWorld({.head_points = 0});
  const auto result = Build(look, Literal());
  ASSERT_TRUE(result) << result.error().ToString();
  const SegmentCorrection& print = result->segments[0];
  ASSERT_FALSE(print.subsets.empty());
  EXPECT_EQ(SidesOf(look, print.subsets[0]).size(), 2u);
  EXPECT_EQ(CountOf(print, ImageVerdict::kUndecided), 0u);
}

TEST_F(CorrectionTest, WhatAnUndecidedImageFailsToSeeRefusesIt) {
  for (uint64_t seed = 1; seed <= 2; ++seed) {
    const LookAlikeWorld look = MakeLookAlikeWorld({.head_points = 1500, .seed = seed});
    CorrectionOptions options = Literal();
    const auto folded = Build(look, options);
    ASSERT_TRUE(folded) << folded.error().ToString();
    EXPECT_EQ(SidesOf(look, folded->segments[0].subsets.at(0)).size(), 2u) << "seed " << seed;
    options.missing_observations = true;
    const auto result = Build(look, options);
    ASSERT_TRUE(result) << result.error().ToString();
    const SegmentCorrection& print = result->segments[0];
    ASSERT_EQ(print.subsets.size(), 2u) << "seed " << seed;
    for (const auto& subset : print.subsets) EXPECT_EQ(SidesOf(look, subset).size(), 1u);
    EXPECT_GT(CountOf(print, ImageVerdict::kRefused), 0u) << "seed " << seed;
    for (const Judgement& j : print.judgements) {
      if (j.verdict != ImageVerdict::kRefused) continue;
      EXPECT_LT(j.expected.met, j.expected.all / 2) << "seed " << seed;
    }
  }
}

TEST_F(CorrectionTest, AShareOfAllPointsDoesNotTellWhereFewAreDistinct) {
  const LookAlikeWorld look = MakeLookAlikeWorld({.head_points = 100});
  CorrectionOptions options;
  options.missing_observations = true;
  const auto result = Build(look, options);
  ASSERT_TRUE(result) << result.error().ToString();
  EXPECT_EQ(SidesOf(look, result->segments[0].subsets.at(0)).size(), 2u)
      << "most of what the wrong side must see looks alike and is met";
}

TEST_F(CorrectionTest, PairsThatTheViewGraphRejectsRefuseAnImage) {
  // One side of the print; the pairs of one image are rejected, which lets loops not be asked.
  const LookAlikeWorld look = MakeLookAlikeWorld({.head_points = 0, .crossed_share = 0});
  const ImageId rejected = look.segments.segments[kPrintSegment].images.front();
  std::set<ImagePair> pairs;
  for (const TwoView& view : look.world.two_views.pairs) {
    if (view.pair.first == rejected || view.pair.second == rejected) pairs.insert(view.pair);
  }
  CorrectionOptions options;
  options.graph_support = options.rotation_loops = true;
  const auto result = BuildCorrection(look.world.Input(), look.segments, options, context_, pairs);
  ASSERT_TRUE(result) << result.error().ToString();
  const SegmentCorrection& print = result->segments[0];
  EXPECT_EQ(print.left_out, std::vector<ImageId>{rejected});
  for (const Judgement& j : print.judgements) {
    EXPECT_FALSE(j.loop_share) << "the view graph told";
    if (j.verdict == ImageVerdict::kRefused) {
      EXPECT_EQ(j.image, rejected);
      EXPECT_EQ(j.graph_share, 0.0);
    } else if (j.verdict == ImageVerdict::kConsistent) {
      EXPECT_GE(*j.graph_share, 0.5);
    }
  }
}

TEST_F(CorrectionTest, LoopsAreAskedWhereNoSharesTell) {
  const LookAlikeWorld look = MakeLookAlikeWorld({.head_points = 40, .crossed_share = 0});
  CorrectionOptions options;
  options.missing_observations = options.rotation_loops = true;
  const auto result = Build(look, options);
  ASSERT_TRUE(result) << result.error().ToString();
  size_t by_share = 0, by_loops = 0;
  for (const Judgement& j : result->segments[0].judgements) {
    by_share += j.expected.all > 0 && !j.loop_share;
    by_loops += j.loop_share.has_value();
    if (j.images == 2) {
      EXPECT_TRUE(j.loop_share) << "no image has a share before the third";
    }
  }
  EXPECT_GT(by_share, 0u);
  EXPECT_GT(by_loops, 0u);
}

TEST_F(CorrectionTest, PairsThatContradictAPoseRefuseIt) {
  LookAlikeWorld look = MakeLookAlikeWorld({.head_points = 0, .crossed_share = 0});
  const ImageId turned = look.segments.segments[kPrintSegment].images.front();
  for (TwoView& view : look.world.two_views.pairs) {
    if (view.pair.first != turned && view.pair.second != turned) continue;
    view.second_from_first.rotation =
        Eigen::AngleAxisd(1.0, Eigen::Vector3d::UnitZ()) * view.second_from_first.rotation;
  }
  CorrectionOptions options;
  options.rotation_loops = true;
  const auto result = Build(look, options);
  ASSERT_TRUE(result) << result.error().ToString();
  const SegmentCorrection& print = result->segments[0];
  EXPECT_EQ(print.left_out, std::vector<ImageId>{turned});
  ASSERT_EQ(print.subsets.size(), 2u) << "the sides, whose prints no pair joins";
  const auto refused =
      std::find_if(print.judgements.begin(), print.judgements.end(),
                   [](const Judgement& j) { return j.verdict == ImageVerdict::kRefused; });
  ASSERT_NE(refused, print.judgements.end());
  EXPECT_EQ(refused->image, turned);
  EXPECT_EQ(refused->loop_share, 0.0);
}

TEST_F(CorrectionTest, KeypointsOfOnePartAreOfOneThing) {
  const LookAlikeWorld look = MakeLookAlikeWorld({});
  const auto result = Build(look, {});
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_EQ(result->parts.size(), 3u);
  const size_t print_points = LookAlikeOptions().print_points;
  std::vector<std::set<size_t>> things(result->parts.size());
  for (size_t i = 0; i < result->part_of_keypoint.size(); ++i) {
    ASSERT_EQ(result->part_of_keypoint[i].size(), look.world.point_of_keypoint[i].size());
    for (size_t k = 0; k < result->part_of_keypoint[i].size(); ++k) {
      const auto part = result->part_of_keypoint[i][k];
      const size_t thing = std::min<size_t>(look.world.point_of_keypoint[i][k] / print_points, 2);
      // Pictures with hardly anything of the print are in no subset of it.
      if (part) things[*part].insert(thing);
      EXPECT_TRUE(part || thing < 2);
    }
  }
  for (size_t part = 0; part < things.size(); ++part) {
    EXPECT_EQ(things[part].size(), 1u) << "part " << part;
    EXPECT_EQ(*things[part].begin() == 2, result->parts[part].segment == kHeadSegment);
  }
}

TEST_F(CorrectionTest, LabelsOfTracksMakeUpForBorders) {
  LookAlikeWorld look = MakeLookAlikeWorld({});
  // Superpixels cut a track here and there: one keypoint in ten has its neighbour's label.
  for (auto& image : look.segments.of_keypoint) {
    for (size_t k = 0; k < image.size(); k += 10) image[k] = 1 - *image[k];
  }
  const auto by_track = Build(look, {});
  CorrectionOptions own;
  own.labels_by_track = false;
  const auto by_keypoint = Build(look, own);
  ASSERT_TRUE(by_track && by_keypoint);
  const auto wrong = [&](const Correction& correction) {
    size_t count = 0;
    for (size_t i = 0; i < correction.part_of_keypoint.size(); ++i) {
      for (size_t k = 0; k < correction.part_of_keypoint[i].size(); ++k) {
        const auto part = correction.part_of_keypoint[i][k];
        const bool head = look.world.point_of_keypoint[i][k] >= 2 * LookAlikeOptions().print_points;
        count += part && (correction.parts[*part].segment == kHeadSegment) != head;
      }
    }
    return count;
  };
  EXPECT_GT(wrong(*by_keypoint), 100u);
  EXPECT_LT(wrong(*by_track), wrong(*by_keypoint) / 10);
}

TEST_F(CorrectionTest, DistinctSegmentsStayAsTheyAre) {
  LookAlikeWorld look = MakeLookAlikeWorld({});
  look.segments.segments[kPrintSegment].ambiguous = false;
  const auto result = Build(look, {});
  ASSERT_TRUE(result) << result.error().ToString();
  EXPECT_TRUE(result->segments.empty());
  ASSERT_EQ(result->parts.size(), 2u);
  for (uint32_t s = 0; s < 2; ++s) {
    EXPECT_EQ(result->parts[s].segment, s);
    EXPECT_EQ(result->parts[s].images, look.segments.segments[s].images);
  }
  EXPECT_EQ(result->part_of_keypoint, look.segments.of_keypoint);
}

TEST(PoseDistance, TranslationsAreBlindInABodyCentredFrame) {
  // Two cameras of a ring that look at the axis from opposite sides.
  const auto camera = [](double azimuth_rad) {
    const Eigen::Vector3d out(std::cos(azimuth_rad), std::sin(azimuth_rad), 0.0);
    Eigen::Matrix3d world_from_cam;
    world_from_cam << Eigen::Vector3d::UnitZ().cross(out), -Eigen::Vector3d::UnitZ(), -out;
    const Eigen::Quaterniond rotation(Eigen::Matrix3d(world_from_cam.transpose()));
    return Rigid3{rotation, -(rotation * (1.7 * out))};
  };
  const Rigid3 front = camera(0.0), back = camera(kPi);
  const Eigen::Vector3d on_the_axis = Eigen::Vector3d::Zero();
  EXPECT_NEAR(RotationAngle_rad(front.rotation, back.rotation), kPi, 1e-9);
  EXPECT_NEAR(TranslationAngle_rad(front, back), 0.0, 1e-9);
  EXPECT_NEAR(CenterAngle_rad(front, back, on_the_axis), kPi, 1e-9);
  // Another frame for the same poses: the one angle changes, the other does not.
  const Sim3 moved = {2.0, Eigen::Quaterniond(Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitX())),
                      Eigen::Vector3d(3.0, 1.0, -2.0)};
  const Rigid3 a = TransformPose(moved, front), b = TransformPose(moved, back);
  EXPECT_GT(TranslationAngle_rad(a, b), RadFromDeg(30.0));
  EXPECT_NEAR(CenterAngle_rad(a, b, moved * on_the_axis), kPi, 1e-9);
}

bool Same(const Judgement& a, const Judgement& b) {
  return a.image == b.image && a.pass == b.pass && a.verdict == b.verdict &&
         a.primary_inliers == b.primary_inliers && a.auxiliary_inliers == b.auxiliary_inliers &&
         a.rotation_rad == b.rotation_rad && a.place_rad == b.place_rad;
}

TEST_F(CorrectionTest, GivesTheSameOnAnyNumberOfThreads) {
  const LookAlikeWorld look = MakeLookAlikeWorld({});
  const auto two = Build(look, {});
  ThreadPool single(1);
  RunContext alone{single};
  const auto one = BuildCorrection(look.world.Input(), look.segments, {}, alone);
  ASSERT_TRUE(one && two);
  EXPECT_EQ(one->part_of_keypoint, two->part_of_keypoint);
  const auto &a = one->segments[0].judgements, &b = two->segments[0].judgements;
  ASSERT_EQ(a.size(), b.size());
  for (size_t i = 0; i < a.size(); ++i) EXPECT_TRUE(Same(a[i], b[i])) << "judgement " << i;
}

TEST_F(CorrectionTest, StopsWhenAskedToAndRefusesBadOptions) {
  const LookAlikeWorld look = MakeLookAlikeWorld({});
  std::stop_source stop;
  stop.request_stop();
  RunContext stopped{threads_, stop.get_token()};
  const auto cancelled = BuildCorrection(look.world.Input(), look.segments, {}, stopped);
  ASSERT_FALSE(cancelled);
  EXPECT_EQ(cancelled.error().code, ErrorCode::kCancelled);
  CorrectionOptions options;
  options.min_auxiliary_inliers = 3;
  const auto refused = Build(look, options);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kInvalidArgument);
  EXPECT_EQ(refused.error().context, "min_auxiliary_inliers");
}

}  // namespace
}  // namespace rotunda::sfm
