#include "sfm/tc_sfm.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "sfm/agreeing_matches.h"
#include "sfm/disjoint_sets.h"
#include "tests/support/look_alike_world.h"
#include "tests/support/reconstruction_near.h"
#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

using test::ErrorsOf;
using test::FoldingOptions;
using test::IsCrossed;
using test::LookAlikeOptions;
using test::LookAlikeWorld;
using test::MakeLookAlikeWorld;
using test::MakeSyntheticWorld;
using test::NormalRandom;
using test::NotNear;
using test::SyntheticOptions;
using test::SyntheticWorld;

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kFolded_rad = RadFromDeg(10.0);
/// What 0.5 px at 200 keypoints an image allow, with room for the worst of 30 cameras.
constexpr double kNear_rad = RadFromDeg(0.3), kNear_m = 0.008;

class TcSfmTest : public ::testing::Test {
 protected:
  Result<TcSfmResult> Run(const SyntheticWorld& world, const TcSfmOptions& options = {},
                          const CalibratedPoses& calibrated = {}) {
    return RunTcSfm(
        {world.features, world.intrinsics, world.two_views, world.view_graph, calibrated}, options,
        {}, context_);
  }
  /// Largest rotation error of the first plain model.
  double PlainError_rad(const SyntheticWorld& world) {
    const auto plain = BuildReconstructions(world.Input(), {}, context_);
    EXPECT_TRUE(plain);
    return plain ? ErrorsOf(plain->models[0], world.cam_from_world).max_rotation_rad : 0;
  }
  ThreadPool threads_{2};
  RunContext context_{threads_};
};

/// The tree of the strongest links joins front and back.
bool TreeFolds(const SyntheticWorld& world) {
  DisjointSets sets(world.view_graph.images);
  for (const size_t e : EdgesByWeight(world.view_graph)) {
    const ViewGraphEdge& edge = world.view_graph.edges[e];
    if (!sets.Unite(edge.pair.first.index(), edge.pair.second.index())) continue;
    if (IsCrossed(world, world.two_views.pairs[edge.two_view])) return true;
  }
  return false;
}

/// Only then is an image's group less than certain.
bool FoundAFoldedDraft(const TcSfmResult& result) {
  return std::any_of(result.certainty.begin(), result.certainty.end(),
                     [](double certainty) { return certainty < kInfinite; });
}

TEST_F(TcSfmTest, UnfoldsWhatPlainReconstructionFolds) {
  for (uint64_t seed = 1; seed <= 2; ++seed) {
    LookAlikeOptions options = FoldingOptions();
    options.seed = seed;
    const SyntheticWorld world = MakeLookAlikeWorld(options).world;
    ASSERT_TRUE(TreeFolds(world)) << "seed " << seed;
    ASSERT_GT(PlainError_rad(world), kFolded_rad) << "seed " << seed;
    const auto result = Run(world);
    ASSERT_TRUE(result) << result.error().ToString();
    ASSERT_EQ(result->models.models.size(), 1u) << "seed " << seed;
    EXPECT_EQ(NotNear(result->models.models[0], world.cam_from_world, kNear_rad, kNear_m), "")
        << "seed " << seed;
    EXPECT_EQ(result->verdict, Verdict::kSure) << "seed " << seed;
    EXPECT_TRUE(FoundAFoldedDraft(*result)) << "seed " << seed;
    EXPECT_EQ(result->reason, "what looks alike was told apart");
    EXPECT_GT(result->evidence, 10 * TcSfmOptions().min_evidence) << "seed " << seed;
    EXPECT_LT(result->evidence, kInfinite) << "seed " << seed;
  }
}

TEST_F(TcSfmTest, JudgesEveryEdge) {
  const SyntheticWorld world = MakeLookAlikeWorld(FoldingOptions()).world;
  const auto result = Run(world);
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_EQ(result->verdicts.size(), world.view_graph.edges.size());
  size_t kept = 0;
  for (size_t e = 0; e < result->verdicts.size(); ++e) {
    const TwoView& view = world.two_views.pairs[world.view_graph.edges[e].two_view];
    EXPECT_EQ(result->verdicts[e],
              IsCrossed(world, view) ? EdgeVerdict::kRejected : EdgeVerdict::kAgrees)
        << view.pair.first.index() << "-" << view.pair.second.index();
    kept += result->verdicts[e] == EdgeVerdict::kAgrees;
  }
  EXPECT_EQ(result->two_views.pairs.size(), kept);
  EXPECT_EQ(result->view_graph.edges.size(), kept);
  for (const double certainty : result->certainty) EXPECT_GT(certainty, 0);
}

TEST_F(TcSfmTest, WithoutUnfoldingTheFoldIsFoundAndSaid) {
  const SyntheticWorld world = MakeLookAlikeWorld(FoldingOptions()).world;
  TcSfmOptions options;
  options.unfolding = false;
  const auto result = Run(world, options);
  ASSERT_TRUE(result) << result.error().ToString();
  EXPECT_GT(ErrorsOf(result->models.models[0], world.cam_from_world).max_rotation_rad, kFolded_rad);
  EXPECT_EQ(result->verdict, Verdict::kFolded);
  EXPECT_LT(result->evidence, options.min_evidence);
  EXPECT_FALSE(FoundAFoldedDraft(*result));
  options.unfolding = true;
  options.max_unfoldings = 0;
  const auto none_allowed = Run(world, options);
  ASSERT_TRUE(none_allowed);
  EXPECT_EQ(none_allowed->verdict, Verdict::kFolded);
}

TEST_F(TcSfmTest, UnfoldsWithoutTheConsistentViewGraph) {
  const SyntheticWorld world = MakeLookAlikeWorld(FoldingOptions()).world;
  TcSfmOptions options;
  options.consistent_view_graph = false;
  const auto result = Run(world, options);
  ASSERT_TRUE(result) << result.error().ToString();
  EXPECT_EQ(NotNear(result->models.models[0], world.cam_from_world, kNear_rad, kNear_m), "");
  EXPECT_EQ(result->verdict, Verdict::kSure);
}

TEST_F(TcSfmTest, IsNotSureWhereNothingDistinguishesTheSides) {
  for (uint64_t seed = 1; seed <= 3; ++seed) {
    LookAlikeOptions options = FoldingOptions();
    options.head_points = 0;
    options.seed = seed;
    const auto result = Run(MakeLookAlikeWorld(options).world);
    ASSERT_TRUE(result) << result.error().ToString();
    EXPECT_EQ(result->verdict, Verdict::kUnsure) << "seed " << seed;
    EXPECT_LT(result->evidence, TcSfmOptions().min_evidence) << "seed " << seed;
  }
}

/// Worlds of every difficulty: prints that leave the sides bare, so that nothing contradicts a
/// whole fold, few or no points that exist once, few or many crossed matches, long and short
/// ranges.
LookAlikeOptions DrawnWorld(uint64_t seed) {
  NormalRandom random(seed);
  const auto one_of = [&](const std::vector<double>& values) {
    return values[random.Index(values.size())];
  };
  LookAlikeOptions options;
  options.seed = seed;
  options.columns = 13 + random.Index(5);
  options.head_points = static_cast<size_t>(one_of({0, 20, 40, 60, 80, 120, 200}));
  options.crossed_share = one_of({0.3, 0.5, 0.7, 1.0});
  options.print_half_width_deg = one_of({25, 40, 60, 90});
  options.match_range_deg = one_of({15, 20, 30});
  return options;
}

/// The result may be right, folded, right but for a few images or in pieces.
TEST_F(TcSfmTest, WhatIsSureIsRight) {
  size_t sure = 0, wrong = 0;
  for (uint64_t seed = 1; seed <= 16; ++seed) {
    const SyntheticWorld world = MakeLookAlikeWorld(DrawnWorld(seed)).world;
    const auto result = Run(world);
    ASSERT_TRUE(result) << result.error().ToString();
    const double error_rad =
        ErrorsOf(result->models.models[0], world.cam_from_world).max_rotation_rad;
    EXPECT_FALSE(result->verdict == Verdict::kSure && error_rad > kFolded_rad)
        << "seed " << seed << ", error " << DegFromRad(error_rad) << " deg, evidence "
        << result->evidence << ": " << result->reason;
    sure += result->verdict == Verdict::kSure;
    wrong += error_rad > kFolded_rad;
  }
  EXPECT_GT(sure, 2u);
  EXPECT_GT(wrong, 2u) << "the worlds are too easy to prove anything";
}

TEST_F(TcSfmTest, ASingleImageInDoubtCanBeLeftOutOfTheVerdict) {
  // The heaviest edge of two images has matches that disagree with their poses.
  SyntheticWorld world = MakeSyntheticWorld({});
  ViewGraphEdge& edge = world.view_graph.edges[0];
  edge.weight = 0.99;
  std::vector<Match>& matches = world.two_views.pairs[edge.two_view].inliers;
  ASSERT_GE(matches.size(), 20u);
  matches.resize(20);
  const KeypointId first = matches[0].second;
  for (size_t k = 0; k + 1 < matches.size(); ++k) matches[k].second = matches[k + 1].second;
  matches.back().second = first;
  const auto in_doubt = Run(world);
  ASSERT_TRUE(in_doubt) << in_doubt.error().ToString();
  EXPECT_EQ(in_doubt->doubtful, (std::vector<ImageId>{edge.pair.first, edge.pair.second}));
  EXPECT_EQ(in_doubt->verdict, Verdict::kUnsure);
  TcSfmOptions without;
  without.single_image_doubt = false;
  const auto result = Run(world, without);
  ASSERT_TRUE(result) << result.error().ToString();
  EXPECT_TRUE(result->doubtful.empty());
  EXPECT_EQ(result->verdict, Verdict::kSure) << result->reason;
  EXPECT_EQ(test::Difference(result->models.models, in_doubt->models.models), "");
}

size_t ObservationsOf(const Reconstruction& model) {
  size_t observations = 0;
  for (const Point3& point : model.points) observations += point.observations.size();
  return observations;
}

TEST_F(TcSfmTest, MatchesThatTheDraftDidWithoutAreBroughtBack) {
  // All pairs of the first image but its heaviest have right matches and wrong rotations, each
  // another one, so that the consistent view graph leaves them out.
  SyntheticWorld world = MakeSyntheticWorld({});
  bool is_heaviest = true;
  double off_deg = 20;
  for (const size_t e : EdgesByWeight(world.view_graph)) {
    const ViewGraphEdge& edge = world.view_graph.edges[e];
    if (edge.pair.first != ImageId(0)) continue;
    if (!is_heaviest) {
      Eigen::Quaterniond& rotation =
          world.two_views.pairs[edge.two_view].second_from_first.rotation;
      rotation = Eigen::AngleAxisd(RadFromDeg(off_deg += 20), Eigen::Vector3d::UnitZ()) * rotation;
    }
    is_heaviest = false;
  }
  TcSfmOptions without;
  without.matches_brought_back = false;
  const auto all = Run(world), drafted = Run(world, without);
  ASSERT_TRUE(all && drafted);
  ASSERT_TRUE(all->models.unregistered.empty() && drafted->models.unregistered.empty());
  EXPECT_GT(ObservationsOf(all->models.models[0]), ObservationsOf(drafted->models.models[0]));
}

/// The same folded model, told where the cameras of a rig stand and not told.
TEST_F(TcSfmTest, AWholeFoldThatNothingContradictsLeavesHalfTheRingEmpty) {
  LookAlikeOptions world_options;
  world_options.columns = 15;
  world_options.head_points = 0;
  world_options.crossed_share = 1.0;
  world_options.print_half_width_deg = 25;
  world_options.match_range_deg = 20;
  const SyntheticWorld world = MakeLookAlikeWorld(world_options).world;
  const auto on_rig = Run(world);
  ASSERT_TRUE(on_rig) << on_rig.error().ToString();
  ASSERT_GT(ErrorsOf(on_rig->models.models[0], world.cam_from_world).max_rotation_rad, kFolded_rad);
  EXPECT_EQ(on_rig->verdict, Verdict::kUnsure);
  EXPECT_NE(on_rig->reason.find("of the 360 deg around the subject, as in a folded"),
            std::string::npos)
      << on_rig->reason;
  TcSfmOptions anywhere;
  anywhere.max_gap_deg.reset();
  const auto unknown = Run(world, anywhere);
  ASSERT_TRUE(unknown) << unknown.error().ToString();
  EXPECT_EQ(unknown->verdict, Verdict::kSure) << unknown->reason;
}

TEST_F(TcSfmTest, AGapOfCamerasWithoutAPoseIsSaidToBeThat) {
  SyntheticWorld world = MakeSyntheticWorld({});
  constexpr size_t kLost = 10;  // five columns of twelve, two rows each
  std::erase_if(world.two_views.pairs, [](const TwoView& view) {
    return view.pair.first.index() < kLost || view.pair.second.index() < kLost;
  });
  world.view_graph = BuildViewGraph(world.features, world.two_views);
  const auto result = Run(world);
  ASSERT_TRUE(result) << result.error().ToString();
  EXPECT_EQ(result->verdict, Verdict::kUnsure);
  EXPECT_NE(result->reason.find("and 10 cameras have no pose"), std::string::npos)
      << result->reason;
}

/// No point tells the sides of the body apart, and its print goes round it or is on two of them.
LookAlikeOptions UndistinguishedOptions(double print_half_width_deg) {
  LookAlikeOptions options = FoldingOptions();
  options.head_points = 0;
  options.crossed_share = 1.0;
  options.print_half_width_deg = print_half_width_deg;
  options.match_range_deg = 20;
  return options;
}

/// The truth but for what cameras have moved since it was measured, by a degree or so.
CalibratedPoses CalibrationOf(const SyntheticWorld& world, uint64_t seed) {
  NormalRandom random(seed);
  CalibratedPoses poses;
  for (const Rigid3& truth : world.cam_from_world) {
    const Eigen::Vector3d turn_rad =
        RadFromDeg(0.7) * Eigen::Vector3d(random.Normal(), random.Normal(), random.Normal());
    poses.emplace_back(
        Rigid3{Eigen::Quaterniond(Eigen::AngleAxisd(turn_rad.norm(), turn_rad.normalized())) *
                   truth.rotation,
               truth.translation});
  }
  return poses;
}

TEST_F(TcSfmTest, TheCalibrationAsAPriorDecidesWhatThePicturesDoNot) {
  for (const double half_width_deg : {60.0, 90.0}) {
    const SyntheticWorld world = MakeLookAlikeWorld(UndistinguishedOptions(half_width_deg)).world;
    const auto without = Run(world);
    ASSERT_TRUE(without) << without.error().ToString();
    ASSERT_NE(without->verdict, Verdict::kSure) << half_width_deg;
    const auto with = Run(world, {}, CalibrationOf(world, 1));
    ASSERT_TRUE(with) << with.error().ToString();
    EXPECT_EQ(NotNear(with->models.models[0], world.cam_from_world, kNear_rad, kNear_m), "")
        << half_width_deg;
    EXPECT_EQ(with->verdict, Verdict::kSure) << half_width_deg << ": " << with->reason;
    EXPECT_EQ(with->reason, "what looks alike was told apart by the calibration");
    EXPECT_LT(with->evidence, TcSfmOptions().min_evidence) << "that of the pictures stays";
    EXPECT_TRUE(with->not_as_calibrated.empty());
  }
}

TEST_F(TcSfmTest, ThePriorIsNotUsedForCamerasThatChangedPlaces) {
  const SyntheticWorld world = MakeLookAlikeWorld(FoldingOptions()).world;
  CalibratedPoses calibrated = CalibrationOf(world, 2);
  const size_t other = world.cam_from_world.size() / 3;
  std::swap(calibrated[0], calibrated[other]);
  const auto result = Run(world, {}, calibrated);
  ASSERT_TRUE(result) << result.error().ToString();
  EXPECT_EQ(result->not_as_calibrated, (std::vector<ImageId>{ImageId(0), ImageId(other)}));
  EXPECT_EQ(NotNear(result->models.models[0], world.cam_from_world, kNear_rad, kNear_m), "");
  EXPECT_EQ(result->verdict, Verdict::kSure) << result->reason;
}

TEST_F(TcSfmTest, ChangesNothingWhereNothingLooksAlike) {
  for (uint64_t seed = 1; seed <= 2; ++seed) {
    SyntheticOptions options;
    options.seed = seed;
    options.wrong_match_share = 0.05;
    const SyntheticWorld world = MakeSyntheticWorld(options);
    const auto plain = BuildReconstructions(world.Input(), {}, context_);
    const auto result = Run(world);
    ASSERT_TRUE(plain && result);
    EXPECT_EQ(result->verdict, Verdict::kSure);
    EXPECT_EQ(result->reason, "nothing looks alike");
    EXPECT_FALSE(FoundAFoldedDraft(*result));
    EXPECT_EQ(result->evidence, kInfinite);
    for (size_t e = 0; e < result->verdicts.size(); ++e) {
      if (result->verdicts[e] == EdgeVerdict::kAgrees) continue;
      // Only a pair that its wrong matches bring below the least number of agreeing ones.
      const TwoView& view = world.two_views.pairs[world.view_graph.edges[e].two_view];
      EXPECT_LT(view.inliers.size(), 1.2 * AgreeingMatchesOptions().min_matches);
    }
    EXPECT_TRUE(result->models.unregistered.empty());
    EXPECT_TRUE(result->notes.empty());
    const test::PoseErrors expected = ErrorsOf(plain->models[0], world.cam_from_world);
    EXPECT_EQ(NotNear(result->models.models[0], world.cam_from_world,
                      1.2 * expected.max_rotation_rad, 1.2 * expected.max_position),
              "")
        << "seed " << seed;
  }
}

TEST_F(TcSfmTest, GivesTheSameBytesOnAnyNumberOfThreads) {
  const SyntheticWorld world = MakeLookAlikeWorld(FoldingOptions()).world;
  const auto two = Run(world);
  ThreadPool single(1);
  RunContext alone{single};
  const auto one = RunTcSfm({world.features, world.intrinsics, world.two_views, world.view_graph},
                            {}, {}, alone);
  ASSERT_TRUE(one && two);
  EXPECT_EQ(test::Difference(one->models.models, two->models.models), "");
  EXPECT_EQ(one->verdicts, two->verdicts);
  EXPECT_EQ(one->evidence, two->evidence);
  EXPECT_EQ(one->certainty, two->certainty);
}

TEST_F(TcSfmTest, StopsWhenAskedToAndRefusesBadOptions) {
  const SyntheticWorld world = MakeSyntheticWorld({});
  std::stop_source stop;
  stop.request_stop();
  RunContext stopped{threads_, stop.get_token()};
  const auto cancelled = RunTcSfm(
      {world.features, world.intrinsics, world.two_views, world.view_graph}, {}, {}, stopped);
  ASSERT_FALSE(cancelled);
  EXPECT_EQ(cancelled.error().code, ErrorCode::kCancelled);
  const auto field_of = [&](const TcSfmOptions& options) {
    const auto refused = Run(world, options);
    if (refused) return std::string("accepted");
    EXPECT_EQ(refused.error().code, ErrorCode::kInvalidArgument);
    return refused.error().context;
  };
  TcSfmOptions options;
  options.max_unfoldings = -1;
  EXPECT_EQ(field_of(options), "max_unfoldings");
  options = {};
  options.min_gain = 0;
  EXPECT_EQ(field_of(options), "min_gain");
  options = {};
  options.consistency.agree_rad = 0;
  EXPECT_EQ(field_of(options), "agree_rad");
  options = {};
  options.covisibility.enclosure = 0;
  EXPECT_EQ(field_of(options), "enclosure");
  options = {};
  options.prior.min_agreeing_share = 0;
  EXPECT_EQ(field_of(options), "min_agreeing_share");
}

TEST(Verdict, HasAName) {
  EXPECT_STREQ(VerdictName(Verdict::kSure), "sure");
  EXPECT_STREQ(VerdictName(Verdict::kUnsure), "unsure");
  EXPECT_STREQ(VerdictName(Verdict::kFolded), "folded");
}

}  // namespace
}  // namespace rotunda::sfm
