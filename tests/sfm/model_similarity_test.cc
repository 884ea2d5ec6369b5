#include "sfm/model_similarity.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "sfm/bidirectional_consistency.h"
#include "tests/support/partial_models.h"
#include "tests/support/reconstruction_near.h"
#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

using test::AddLookAlikePair;
using test::Columns;
using test::ErrorsOf;
using test::EstimateTwoViews;
using test::kRingImages;
using test::MakePartialModel;
using test::MakeSyntheticWorld;
using test::SyntheticOptions;
using test::SyntheticWorld;

constexpr uint64_t kSeed = 7;

/// Two models of one world and their links.
struct Pair {
  SyntheticWorld world;
  Reconstruction source, target;

  std::vector<ModelLink> Links() const {
    const PointIndex source_index(world.features, source), target_index(world.features, target);
    return LinkModels({world.features, world.two_views, world.view_graph}, {source, source_index},
                      {target, target_index});
  }
  SimilarityVerdict Estimate(const std::vector<ModelLink>& links,
                             const SimilarityOptions& options = {}) const {
    return EstimateSimilarity(links, source, target, options, kSeed);
  }
  /// Where the similarity puts the source's cameras, against where the two models' own best fits
  /// to the truth say: the largest angle and distance.
  std::array<double, 2> Seam(const Sim3& target_from_source) const {
    const test::PoseErrors a = ErrorsOf(source, world.cam_from_world);
    const test::PoseErrors b = ErrorsOf(target, world.cam_from_world);
    std::array<double, 2> seam = {0, 0};
    for (const ImageId image : a.images) {
      const Rigid3& cam = *source.cam_from_model[image.index()];
      const Rigid3 direct = TransformPose(a.truth_from_model, cam);
      const Rigid3 across =
          TransformPose(b.truth_from_model, TransformPose(target_from_source, cam));
      seam[0] = std::max(seam[0], RotationAngle_rad(direct.rotation, across.rotation));
      seam[1] = std::max(seam[1], (direct.OriginInSource() - across.OriginInSource()).norm());
    }
    return seam;
  }
};

class ModelSimilarityTest : public ::testing::Test {
 protected:
  Pair Make(const std::vector<ImageId>& source, const std::vector<ImageId>& target,
            uint64_t seed = kSeed) {
    SyntheticOptions options;
    options.points = 1000;
    options.seed = seed;
    RecordProperty("seed", static_cast<int>(seed));
    Pair pair;
    pair.world = MakeSyntheticWorld(options);
    EstimateTwoViews(pair.world, context_);
    pair.source = MakePartialModel(pair.world, source, 2 * seed, context_);
    pair.target = MakePartialModel(pair.world, target, 2 * seed + 1, context_);
    return pair;
  }
  ThreadPool threads_{1};
  RunContext context_{threads_, {}, nullptr, kSeed};
};

/// What the parts' own errors leave open (their best fits to the truth are no better known), three
/// times the mean over seeds.
constexpr double kSeam_rad = RadFromDeg(0.15);
/// Where one or two cameras alone carry the rotation: the worst camera of each part is 0.1 deg off.
constexpr double kFewCamerasSeam_rad = RadFromDeg(0.2);
constexpr double kSeam_m = 0.004;
constexpr double kRadius_m = 1.7;

/// The rotation within `rad`, the cameras within what that and the scale's own uncertainty allow.
void ExpectNear(const Pair& pair, const SimilarityVerdict& verdict, double rad = kSeam_rad) {
  ASSERT_TRUE(verdict.target_from_source) << verdict.refusal;
  const auto seam = pair.Seam(*verdict.target_from_source);
  std::printf("  seam %.4f deg, %.3f mm; %zu/%zu cameras, %zu/%zu pairs, scale sigma %.5f\n",
              DegFromRad(seam[0]), 1e3 * seam[1], verdict.evidence.agreeing_cameras,
              verdict.evidence.common_cameras, verdict.evidence.agreeing_pairs,
              verdict.evidence.cross_pairs, verdict.evidence.scale_sigma);
  EXPECT_LT(seam[0], rad);
  EXPECT_LT(seam[1], kSeam_m + kRadius_m * (rad - kSeam_rad + 3.0 * verdict.evidence.scale_sigma));
}

TEST_F(ModelSimilarityTest, CrossPairsGiveTheSimilarity) {
  const Pair pair = Make(Columns(0, 6), Columns(6, 6));
  const auto verdict = pair.Estimate(pair.Links());
  ExpectNear(pair, verdict);
  EXPECT_EQ(verdict.evidence.common_cameras, 0u);
}

TEST_F(ModelSimilarityTest, BaselinesAloneGiveTheScale) {
  Pair pair = Make(Columns(0, 6), Columns(6, 6));
  pair.source.points.clear();
  pair.target.points.clear();
  const auto verdict = pair.Estimate(pair.Links());
  ExpectNear(pair, verdict);
}

TEST_F(ModelSimilarityTest, CommonCamerasGiveTheSimilarity) {
  Pair pair = Make(Columns(0, 7), Columns(6, 7));
  pair.world.view_graph.edges.clear();
  const auto verdict = pair.Estimate(pair.Links());
  ExpectNear(pair, verdict);
  EXPECT_EQ(verdict.evidence.agreeing_cameras, 4u);  // columns 0 and 6
}

TEST_F(ModelSimilarityTest, TwoCommonCamerasDoWithoutSharedPoints) {
  Pair pair = Make(Columns(0, 7), Columns(6, 6));
  pair.world.view_graph.edges.clear();
  std::vector<ModelLink> links = pair.Links();
  ASSERT_EQ(links.size(), 2u);
  for (ModelLink& link : links) {
    std::erase_if(link.points, [](const LinkedPoint& p) { return p.source_point.has_value(); });
  }
  const auto verdict = pair.Estimate(links);
  // One baseline of 0.6 m whose ends are known to a millimetre.
  EXPECT_LT(verdict.evidence.scale_sigma, 3 * 0.001 * std::sqrt(2.0) / 0.6);
  ExpectNear(pair, verdict, kFewCamerasSeam_rad);
}

TEST_F(ModelSimilarityTest, PairsFromOnePictureNeedSharedPointsForTheScale) {
  Pair pair = Make(Columns(0, 6), Columns(6, 6));
  std::erase_if(pair.world.view_graph.edges, [](const ViewGraphEdge& edge) {
    return edge.pair.first != ImageId(10) && edge.pair.second != ImageId(10);
  });
  const auto with_points = pair.Estimate(pair.Links());
  EXPECT_GE(with_points.evidence.cross_pairs, 3u);
  // All rests on one camera's pose and a few relative rotations.
  ExpectNear(pair, with_points, RadFromDeg(0.3));
  pair.source.points.clear();
  pair.target.points.clear();
  const auto without = pair.Estimate(pair.Links());
  EXPECT_FALSE(without.target_from_source);
  EXPECT_EQ(without.refusal.rfind("open scale", 0), 0u) << without.refusal;
}

TEST_F(ModelSimilarityTest, OneCommonCameraIsTooLittleUnlessAllowed) {
  Pair pair = Make(Columns(0, 7), Columns(6, 6));
  pair.world.view_graph.edges.clear();
  std::vector<ModelLink> links = pair.Links();
  links.pop_back();
  const auto refused = pair.Estimate(links);
  EXPECT_FALSE(refused.target_from_source);
  EXPECT_EQ(refused.refusal.rfind("too little support: 1 of 1 common", 0), 0u) << refused.refusal;
  SimilarityOptions options;
  options.min_support = 2;
  ExpectNear(pair, pair.Estimate(links, options), kFewCamerasSeam_rad);
}

/// Weight of the links across whose rotation the truth contradicts, and of the others.
std::array<double, 2> WrongAndRight(const Pair& pair) {
  std::array<double, 2> weights = {0, 0};
  for (const ModelLink& link : pair.Links()) {
    const Eigen::Quaterniond truth =
        pair.world.cam_from_world[link.target.index()].rotation *
        pair.world.cam_from_world[link.source.index()].rotation.conjugate();
    const double error_rad = RotationAngle_rad(truth, link.target_cam_from_source_cam.rotation);
    weights[error_rad < RadFromDeg(30.0)] += link.weight;
  }
  return weights;
}

/// Adds look-alike pairs across until `enough`; the number of them.
template <typename Enough>
size_t AddLookAlikes(Pair& pair, const Enough& enough) {
  size_t count = 0;
  for (size_t step = 0; step < kRingImages * kRingImages && !enough(count); ++step) {
    const size_t a = step % kRingImages, b = step / kRingImages;
    // Where the first camera stands after half a turn the second is within two columns.
    const size_t distance = (b / 2 + 18 - a / 2) % 12;
    if (a >= b || std::min(distance, 12 - distance) > 2) continue;
    if (pair.source.Registered(ImageId(a)) == pair.source.Registered(ImageId(b))) continue;
    if (!AddLookAlikePair(pair.world, ImageId(a), ImageId(b))) continue;
    pair.world.view_graph = BuildViewGraph(pair.world.features, pair.world.two_views);
    ++count;
  }
  return count;
}

TEST_F(ModelSimilarityTest, LookAlikePairsInTheMinorityAreOutvoted) {
  Pair pair = Make(Columns(0, 6), Columns(6, 6));
  const auto clean = pair.Estimate(pair.Links());
  const size_t wanted = clean.evidence.cross_pairs / 4;  // a fifth of all
  const size_t wrong = AddLookAlikes(pair, [&](size_t count) { return count == wanted; });
  ASSERT_EQ(wrong, wanted);
  const auto verdict = pair.Estimate(pair.Links());
  ExpectNear(pair, verdict);
  EXPECT_EQ(verdict.evidence.cross_pairs, clean.evidence.cross_pairs + wrong);
  EXPECT_EQ(verdict.evidence.agreeing_pairs, clean.evidence.agreeing_pairs);
  // They are of one mind, and told so.
  EXPECT_NEAR(verdict.evidence.rival_weight, WrongAndRight(pair)[0], 1e-9);
}

TEST_F(ModelSimilarityTest, LookAlikePairsAsHeavyAsTheRightOnesAreAContradiction) {
  Pair pair = Make(Columns(0, 6), Columns(6, 6));
  EXPECT_TRUE(pair.Estimate(pair.Links()).target_from_source);
  AddLookAlikes(pair, [&](size_t) {
    const auto [wrong, right] = WrongAndRight(pair);
    return wrong > 0.7 * right;
  });
  const auto [wrong, right] = WrongAndRight(pair);
  ASSERT_GT(wrong, 0.7 * right);
  ASSERT_LT(wrong, 1.3 * right);
  const auto verdict = pair.Estimate(pair.Links());
  EXPECT_FALSE(verdict.target_from_source);
  EXPECT_EQ(verdict.refusal.rfind("contradictory support", 0), 0u) << verdict.refusal;
}

TEST_F(ModelSimilarityTest, NoLinkIsNoSimilarity) {
  const Pair pair = Make(Columns(0, 6), Columns(6, 6));
  const auto verdict = pair.Estimate({});
  EXPECT_FALSE(verdict.target_from_source);
  EXPECT_EQ(verdict.refusal, "no common camera and no pair across");
}

/// Root mean square errors of all cameras, rotation in radians and position, the source's brought
/// over.
std::array<double, 2> MergedErrors(const Pair& pair, const Sim3& target_from_source) {
  Reconstruction merged = pair.target;
  for (size_t i = 0; i < kRingImages; ++i) {
    auto& pose = merged.cam_from_model[i];
    if (!pose) pose = TransformPose(target_from_source, *pair.source.cam_from_model[i]);
  }
  const test::PoseErrors errors = ErrorsOf(merged, pair.world.cam_from_world);
  std::array<double, 2> squares = {0, 0};
  for (size_t k = 0; k < errors.images.size(); ++k) {
    squares[0] += std::pow(errors.rotation_rad[k], 2) / kRingImages;
    squares[1] += std::pow(errors.position[k], 2) / kRingImages;
  }
  return {std::sqrt(squares[0]), std::sqrt(squares[1])};
}

/// The paper's ablation: with and without the bidirectional consistency cost.
TEST_F(ModelSimilarityTest, BidirectionalConsistencyImprovesOnTheClosedForm) {
  constexpr int kSeeds = 6;
  for (const size_t overlap : {size_t{0}, size_t{1}}) {
    std::array<std::array<double, 2>, 3> sums = {};
    for (uint64_t seed = 1; seed <= kSeeds; ++seed) {
      const Pair pair = Make(Columns(0, 6 + overlap), Columns(6, 6 + overlap), seed);
      const std::vector<ModelLink> links = pair.Links();
      const auto verdict = pair.Estimate(links);
      ASSERT_TRUE(verdict.target_from_source) << verdict.refusal;
      const ConsistencyInput input = {pair.world.features, pair.source, pair.target, links};
      const Sim3& closed = *verdict.target_from_source;
      const std::array<Consistency, 3> results = {
          MinimiseInconsistency(input, closed, {1.0, false}),
          MinimiseInconsistency(input, closed, {0.0, true}),
          MinimiseInconsistency(input, closed, {1.0, true})};
      EXPECT_LT(results[2].cost_px2, results[0].cost_px2);
      for (size_t k = 0; k < results.size(); ++k) {
        const auto errors = MergedErrors(pair, results[k].target_from_source);
        for (size_t c = 0; c < 2; ++c) sums[k][c] += errors[c] / kSeeds;
      }
    }
    std::printf("%zu common cameras, rms error over the cameras, mean of %d seeds:\n", 4 * overlap,
                kSeeds);
    constexpr std::array<const char*, 3> kNames = {"closed form", "the paper's cost",
                                                   "with reprojection"};
    for (size_t k = 0; k < kNames.size(); ++k) {
      std::printf("  %-18s %.4f deg, %.3f mm\n", kNames[k], DegFromRad(sums[k][0]),
                  1e3 * sums[k][1]);
    }
    EXPECT_LT(sums[2][0], sums[0][0]);
    EXPECT_LT(sums[2][1], sums[0][1]);
  }
}

}  // namespace
}  // namespace rotunda::sfm
