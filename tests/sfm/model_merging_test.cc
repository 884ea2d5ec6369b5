#include "sfm/model_merging.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "tests/support/partial_models.h"
#include "tests/support/reconstruction_near.h"
#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

using test::AddLookAlikePair;
using test::Columns;
using test::ErrorsOf;
using test::EstimateTwoViews;
using test::KeepPairs;
using test::kRingImages;
using test::MakePartialModel;
using test::MakeSyntheticWorld;
using test::SyntheticOptions;
using test::SyntheticWorld;

constexpr uint64_t kSeed = 7;

class ModelMergingTest : public ::testing::Test {
 protected:
  void SetUp() override {
    SyntheticOptions options;
    options.points = 1000;
    options.seed = kSeed;
    RecordProperty("seed", static_cast<int>(kSeed));
    world_ = MakeSyntheticWorld(options);
    EstimateTwoViews(world_, context_);
  }

  Reconstruction Part(const std::vector<ImageId>& images, uint64_t seed) {
    return MakePartialModel(world_, images, seed, context_);
  }
  Result<MergeResult> Merge(const std::vector<Reconstruction>& models,
                            const MergeOptions& options = {}) {
    return MergeModels({world_.features, world_.two_views, world_.view_graph}, models, options,
                       context_);
  }

  /// One model with all cameras. Its errors are at most the sum of its parts': a bend of one part
  /// is carried across the seam into the next, and the seam itself adds less than that.
  void ExpectWhole(const Result<MergeResult>& result, const std::vector<Reconstruction>& parts) {
    ASSERT_TRUE(result) << result.error().ToString();
    for (const std::string& refusal : result->refusals) ADD_FAILURE() << refusal;
    ASSERT_EQ(result->models.size(), 1u);
    double rotation_rad = 0, position_m = 0;
    for (const Reconstruction& part : parts) {
      const test::PoseErrors errors = ErrorsOf(part, world_.cam_from_world);
      rotation_rad += errors.max_rotation_rad;
      position_m += errors.max_position;
    }
    EXPECT_EQ(test::NotNear(result->models[0], world_.cam_from_world, rotation_rad, position_m),
              "");
    ExpectSound(result->models[0]);
  }

  /// What every reconstruction promises, and that points are where their keypoints say.
  void ExpectSound(const Reconstruction& model) {
    std::set<Observation> taken;
    size_t observations = 0, near = 0, wrong = 0;
    for (const Point3& point : model.points) {
      ASSERT_GE(point.observations.size(), 2u);
      for (size_t k = 0; k < point.observations.size(); ++k) {
        const Observation& o = point.observations[k];
        EXPECT_TRUE(model.Registered(o.image));
        EXPECT_TRUE(taken.insert(o).second) << "a keypoint of two points";
        if (k > 0) {
          EXPECT_LT(point.observations[k - 1].image, o.image);
        }
        const auto error_px = ReprojectionError_px(model, world_.features, point, o);
        ++observations;
        near += error_px && *error_px < 4.0;
        wrong += TruePoint(o) != TruePoint(point.observations.front());
      }
    }
    EXPECT_EQ(wrong, 0u);
    EXPECT_GT(near, 0.99 * observations);
  }
  /// Look-alike pairs between the first six columns and the others, `most` of them at most: at half
  /// a turn, then a row or a column off. The number of them.
  size_t AddLookAlikes(size_t most) {
    size_t count = 0;
    for (const size_t step : {12, 13, 11, 14, 10}) {
      for (size_t i = 0; i < 12 && count < most; ++i) {
        if (i + step < 12 || i + step >= kRingImages) continue;
        count += AddLookAlikePair(world_, ImageId(i), ImageId(i + step));
      }
    }
    world_.view_graph = BuildViewGraph(world_.features, world_.two_views);
    return count;
  }
  size_t TruePoint(const Observation& o) const {
    return world_.point_of_keypoint[o.image.index()][o.keypoint.index()];
  }

  SyntheticWorld world_;
  ThreadPool threads_{2};
  RunContext context_{threads_, {}, nullptr, kSeed};
};

TEST_F(ModelMergingTest, JoinsByCrossPairsAlone) {
  const std::vector<Reconstruction> parts = {Part(Columns(0, 5), 1), Part(Columns(5, 7), 2)};
  const auto result = Merge(parts);
  ExpectWhole(result, parts);
  // The larger one stays where it is.
  const size_t kept = Columns(5, 7)[0].index();
  EXPECT_EQ(result->models[0].cam_from_model[kept]->Matrix(),
            parts[1].cam_from_model[kept]->Matrix());
  // Points that both had are one: fewer than before, and some seen from both sides.
  const Reconstruction& model = result->models[0];
  EXPECT_LT(model.points.size(), parts[0].points.size() + parts[1].points.size());
  std::set<size_t> true_points;
  size_t twice = 0;
  for (const Point3& point : model.points) {
    twice += !true_points.insert(TruePoint(point.observations.front())).second;
  }
  // The rest are poorly intersected points whose two copies lie more than 4 px apart, or whose
  // pictures do not match across.
  EXPECT_LT(twice, 0.2 * model.points.size());
}

TEST_F(ModelMergingTest, JoinsByCommonCamerasAlone) {
  KeepPairs(world_, [](const ImagePair&) { return false; });
  const std::vector<Reconstruction> parts = {Part(Columns(0, 7), 1), Part(Columns(6, 7), 2)};
  const auto result = Merge(parts);
  ExpectWhole(result, parts);
}

TEST_F(ModelMergingTest, LookAlikePairsInTheMinorityDoNotFoldIt) {
  const std::vector<Reconstruction> parts = {Part(Columns(0, 6), 1), Part(Columns(6, 6), 2)};
  const auto pairs = static_cast<size_t>(std::count_if(
      world_.two_views.pairs.begin(), world_.two_views.pairs.end(), [](const TwoView& view) {
        return (view.pair.first.index() < 12) != (view.pair.second.index() < 12);
      }));
  ASSERT_EQ(AddLookAlikes(pairs / 4), pairs / 4);  // a fifth of all
  ExpectWhole(Merge(parts), parts);
}

TEST_F(ModelMergingTest, JoinsAChainOfThree) {
  const auto part_of = [](ImageId image) { return image.index() / 8; };
  KeepPairs(world_,
            [&](const ImagePair& pair) { return part_of(pair.second) - part_of(pair.first) <= 1; });
  const std::vector<Reconstruction> parts = {Part(Columns(0, 4), 1), Part(Columns(8, 4), 2),
                                             Part(Columns(4, 4), 3)};
  ExpectWhole(Merge(parts), parts);
}

TEST_F(ModelMergingTest, JoinsWhatOnlyTogetherHasTheSupport) {
  // The third part has two pairs with each of the others, and three are needed.
  size_t to_first = 0, to_second = 0;
  KeepPairs(world_, [&](const ImagePair& pair) {
    const bool first_in_third = pair.first.index() >= 16,
               second_in_third = pair.second.index() >= 16;
    if (first_in_third || !second_in_third) return true;
    size_t& count = pair.first.index() < 8 ? to_first : to_second;
    return ++count <= 2;
  });
  const std::vector<Reconstruction> parts = {Part(Columns(0, 4), 1), Part(Columns(4, 4), 2),
                                             Part(Columns(8, 4), 3)};
  const auto apart = Merge({parts[0], parts[2]});
  ASSERT_TRUE(apart);
  ASSERT_EQ(apart->refusals.size(), 1u);
  EXPECT_EQ(apart->refusals[0].rfind("too little support", 0), 0u) << apart->refusals[0];
  ExpectWhole(Merge(parts), parts);
}

TEST_F(ModelMergingTest, LeavesApartWhatNothingConnects) {
  Disconnect(world_, Columns(0, 6));
  const std::vector<Reconstruction> parts = {Part(Columns(0, 6), 1), Part(Columns(6, 6), 2)};
  const auto result = Merge(parts);
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_EQ(result->models.size(), 2u);
  EXPECT_TRUE(result->refusals.empty());
  const size_t first = result->models[0].Registered(ImageId(0)) ? 0 : 1;
  EXPECT_EQ(test::Difference(result->models[first], parts[0]), "");
  EXPECT_EQ(test::Difference(result->models[1 - first], parts[1]), "");
}

TEST_F(ModelMergingTest, RefusesWhenTheSupportContradictsItself) {
  const std::vector<Reconstruction> parts = {Part(Columns(0, 6), 1), Part(Columns(6, 6), 2)};
  ASSERT_GE(AddLookAlikes(36), 36u);
  const auto result = Merge(parts);
  ASSERT_TRUE(result) << result.error().ToString();
  EXPECT_EQ(result->models.size(), 2u);
  ASSERT_EQ(result->refusals.size(), 1u);
  EXPECT_EQ(result->refusals[0].rfind("contradictory support", 0), 0u) << result->refusals[0];
}

TEST_F(ModelMergingTest, ACameraWronglyPlacedInOneModelKeepsItsRightPose) {
  std::vector<Reconstruction> parts = {Part(Columns(0, 7), 1), Part(Columns(6, 7), 2)};
  const ImageId common(12);
  ASSERT_TRUE(parts[0].Registered(common) && parts[1].Registered(common));
  const std::vector<Reconstruction> right = parts;
  // Half a turn about its own axis of view keeps its centre: the rotation gives it away.
  const Rigid3 turn = {Eigen::Quaterniond(Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitZ())),
                       Eigen::Vector3d::Zero()};
  parts[0].cam_from_model[common.index()] = turn * *parts[0].cam_from_model[common.index()];
  ExpectWhole(Merge(parts), right);
}

TEST_F(ModelMergingTest, EveryReadingOfThePaperJoins) {
  const std::vector<Reconstruction> parts = {Part(Columns(0, 6), 1), Part(Columns(6, 6), 2)};
  MergeOptions closed_form;
  closed_form.bidirectional = false;
  ExpectWhole(Merge(parts, closed_form), parts);
  MergeOptions literal;
  literal.reprojection_weight = 0.0;
  literal.mean_cost = false;
  ExpectWhole(Merge(parts, literal), parts);
}

TEST_F(ModelMergingTest, IsTheSameOnAnyNumberOfThreads) {
  const std::vector<Reconstruction> parts = {Part(Columns(0, 5), 1), Part(Columns(4, 5), 2),
                                             Part(Columns(8, 4), 3)};
  const auto two = Merge(parts);
  ThreadPool one_thread(1);
  RunContext serial{one_thread, {}, nullptr, kSeed};
  const auto one =
      MergeModels({world_.features, world_.two_views, world_.view_graph}, parts, {}, serial);
  ASSERT_TRUE(one && two);
  EXPECT_EQ(test::Difference(one->models, two->models), "");
}

TEST_F(ModelMergingTest, RefusesBadInputAndStops) {
  MergeOptions bad;
  bad.max_duplicate_px = 0;
  EXPECT_EQ(bad.Validate().error().context, "max_duplicate_px");
  bad = {};
  bad.reprojection_weight = -1;
  EXPECT_EQ(Merge({}, bad).error().context, "reprojection_weight");
  bad = {};
  bad.similarity.min_rival_ratio = 0.5;
  EXPECT_EQ(Merge({}, bad).error().context, "min_rival_ratio");
  Reconstruction foreign;
  foreign.cam_from_model.resize(3);
  EXPECT_EQ(Merge({foreign}).error().context, "model 0");
  const auto none = Merge({});
  ASSERT_TRUE(none);
  EXPECT_TRUE(none->models.empty());
  std::stop_source stop;
  stop.request_stop();
  RunContext stopped{threads_, stop.get_token()};
  const auto cancelled = MergeModels({world_.features, world_.two_views, world_.view_graph},
                                     {Part(Columns(0, 6), 1), Part(Columns(6, 6), 2)}, {}, stopped);
  ASSERT_FALSE(cancelled);
  EXPECT_EQ(cancelled.error().code, ErrorCode::kCancelled);
}

}  // namespace
}  // namespace rotunda::sfm
