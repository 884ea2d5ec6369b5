#include "sfm/two_view.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "tests/support/two_view_scene.h"

namespace rotunda::sfm {
namespace {

using test::MakeTwoViewScene;
using test::SceneOptions;
using test::SceneShape;
using test::TwoViewScene;

TwoViews Build(const TwoViewScene& scene, int threads = 1, const TwoViewOptions& options = {}) {
  ThreadPool pool(threads);
  RunContext context{pool, {}, nullptr, 17};
  auto views = BuildTwoViews(scene.features, scene.intrinsics, scene.matches, options, context);
  EXPECT_TRUE(views.ok());
  return std::move(views).value();
}

double RotationError_deg(const TwoView& view, const TwoViewScene& scene) {
  return DegFromRad(
      RotationAngle_rad(view.second_from_first.rotation, scene.second_from_first.rotation));
}
double DirectionError_deg(const TwoView& view, const TwoViewScene& scene) {
  const Eigen::Vector3d &a = view.second_from_first.translation,
                        &b = scene.second_from_first.translation;
  return DegFromRad(std::atan2(a.cross(b).norm(), a.dot(b)));
}

size_t WrongInliers(const TwoView& view, const TwoViewScene& scene) {
  return static_cast<size_t>(
      std::count_if(view.inliers.begin(), view.inliers.end(),
                    [&](const Match& match) { return scene.is_outlier[match.first.index()]; }));
}

TEST(BuildTwoViews, FindsThePoseAmongSixtyPercentOutliers) {
  for (uint64_t seed = 0; seed < 30; ++seed) {
    const TwoViewScene scene =
        MakeTwoViewScene({.points = 300, .noise_px = 0.5, .outlier_share = 0.6, .seed = seed});
    const TwoViews views = Build(scene);
    ASSERT_EQ(views.pairs.size(), 1U) << "seed " << seed;
    const TwoView& view = views.pairs[0];
    EXPECT_EQ(view.kind, TwoViewKind::kCalibrated);
    // 120 inliers of 0.5 px / 1500 px = 0.02 deg each.
    EXPECT_LT(RotationError_deg(view, scene), 0.15) << "seed " << seed;
    EXPECT_LT(DirectionError_deg(view, scene), 0.7) << "seed " << seed;
    const size_t wrong = WrongInliers(view, scene);
    const auto truth =
        static_cast<size_t>(std::count(scene.is_outlier.begin(), scene.is_outlier.end(), false));
    EXPECT_EQ(view.inliers.size() - wrong, truth) << "seed " << seed;
    EXPECT_LE(wrong, 5U) << "seed " << seed;  // 180 outliers, 8 px of 1600: one by chance
  }
}

TEST(BuildTwoViews, KnowsTheTriangulationAngle) {
  const TwoViewScene scene = MakeTwoViewScene({.points = 200, .noise_px = 0.3, .seed = 5});
  const TwoView view = Build(scene).pairs.at(0);
  // The camera was turned by 15-35 degrees about a point in the scene's middle.
  const double turn_deg = DegFromRad(Eigen::AngleAxisd(scene.second_from_first.rotation).angle());
  EXPECT_NEAR(DegFromRad(view.median_angle_rad), turn_deg, 0.2 * turn_deg);
}

TEST(BuildTwoViews, PlanarScenesAreMarkedAndHaveTheRightPose) {
  int near_truth = 0;
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const TwoViewScene scene = MakeTwoViewScene({.shape = SceneShape::kPlane,
                                                 .points = 200,
                                                 .noise_px = 0.3,
                                                 .outlier_share = 0.2,
                                                 .seed = seed});
    const TwoViews views = Build(scene);
    ASSERT_EQ(views.pairs.size(), 1U);
    EXPECT_EQ(views.pairs[0].kind, TwoViewKind::kPlanar) << "seed " << seed;
    near_truth += RotationError_deg(views.pairs[0], scene) < 0.5;
  }
  // A plane allows two poses; the points tell them apart unless all are in front for both
  // (Faugeras & Lustman 1988).
  EXPECT_GE(near_truth, 18);
}

TEST(BuildTwoViews, RotationAloneIsPanoramic) {
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const TwoViewScene scene = MakeTwoViewScene({.shape = SceneShape::kRotationOnly,
                                                 .points = 200,
                                                 .noise_px = 0.3,
                                                 .outlier_share = 0.2,
                                                 .seed = seed});
    const TwoViews views = Build(scene);
    ASSERT_EQ(views.pairs.size(), 1U) << "seed " << seed;
    const TwoView& view = views.pairs[0];
    EXPECT_EQ(view.kind, TwoViewKind::kPanoramic) << "seed " << seed;
    EXPECT_EQ(view.second_from_first.translation, Eigen::Vector3d::Zero());
    EXPECT_LT(RotationError_deg(view, scene), 0.03);
  }
}

// A volume seen from one step aside: parallax of many pixels, so neither homography nor rotation
// explain it, but under an angle that is asked to be larger.
TEST(BuildTwoViews, SmallAnglesArePanoramic) {
  const TwoViewScene scene = MakeTwoViewScene({.points = 200, .noise_px = 0.3, .seed = 5});
  const TwoView apart = Build(scene).pairs.at(0);
  ASSERT_EQ(apart.kind, TwoViewKind::kCalibrated);
  const auto with_angle = [&](double angle_rad) {
    return Build(scene, 1, {.min_angle_rad = angle_rad}).pairs.at(0);
  };
  EXPECT_EQ(with_angle(0.9 * apart.median_angle_rad).kind, TwoViewKind::kCalibrated);
  const TwoView near = with_angle(1.1 * apart.median_angle_rad);
  EXPECT_EQ(near.kind, TwoViewKind::kPanoramic);
  EXPECT_EQ(near.second_from_first.translation, Eigen::Vector3d::Zero());
  EXPECT_EQ(near.median_angle_rad, 0);
  EXPECT_LT(RotationError_deg(near, scene), 0.1);
}

TEST(BuildTwoViews, AssumedFocalLengthsAreUsedWhenTheyExplainTheMatches) {
  for (uint64_t seed = 0; seed < 10; ++seed) {
    TwoViewScene scene =
        MakeTwoViewScene({.points = 300, .noise_px = 0.5, .outlier_share = 0.3, .seed = seed});
    scene.intrinsics.known = false;
    const TwoView right = Build(scene).pairs.at(0);
    EXPECT_EQ(right.kind, TwoViewKind::kCalibrated) << "seed " << seed;
    EXPECT_LT(RotationError_deg(right, scene), 0.2) << "seed " << seed;

    for (CameraIntrinsics& lens : scene.intrinsics.lenses) {
      lens = DefaultIntrinsics(lens.width_px, lens.height_px, 1.4 * lens.fx_px());
    }
    // A focal length 1.4 times too long makes all angles smaller by up to that factor; which
    // matches are right does not depend on it.
    const TwoView guessed = Build(scene).pairs.at(0);
    const double turn_deg = DegFromRad(Eigen::AngleAxisd(scene.second_from_first.rotation).angle());
    EXPECT_LT(RotationError_deg(guessed, scene), (1 - 1 / 1.4) * turn_deg + 3) << "seed " << seed;
    EXPECT_LE(WrongInliers(guessed, scene), 3U);
    EXPECT_GE(guessed.inliers.size(), right.inliers.size() * 9 / 10);
  }
}

TEST(BuildTwoViews, NoiseIsNoPair) {
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const TwoViewScene scene = MakeTwoViewScene({.points = 60, .outlier_share = 1.0, .seed = seed});
    EXPECT_TRUE(Build(scene).pairs.empty()) << "seed " << seed;
  }
}

TEST(BuildTwoViews, TooFewMatchesAreNoPair) {
  const TwoViewScene scene = MakeTwoViewScene({.points = 14, .seed = 1});
  EXPECT_TRUE(Build(scene).pairs.empty());
  EXPECT_EQ(Build(scene, 1, {.min_inliers = 14}).pairs.size(), 1U);
}

TEST(BuildTwoViews, SameBytesOnAnyNumberOfThreadsAndInAnyCompany) {
  TwoViewScene scene =
      MakeTwoViewScene({.points = 200, .noise_px = 0.5, .outlier_share = 0.6, .seed = 3});
  // Six pictures, every pair of which shows one of three scenes.
  TwoViewScene many = scene;
  many.features.images.clear();
  many.matches.pairs.clear();
  many.intrinsics = {{test::SceneLens()}, {0, 0, 0, 0, 0, 0}, true};
  for (size_t i = 0; i < 3; ++i) {
    const TwoViewScene one =
        MakeTwoViewScene({.points = 200, .noise_px = 0.5, .outlier_share = 0.5, .seed = i});
    for (const ImageFeatures& image : one.features.images) many.features.images.push_back(image);
    many.matches.pairs.push_back(
        {{ImageId(2 * i), ImageId(2 * i + 1)}, one.matches.pairs[0].matches});
  }
  const TwoViews serial = Build(many, 1), parallel = Build(many, 4);
  ASSERT_EQ(serial.pairs.size(), 3U);
  ASSERT_EQ(parallel.pairs.size(), 3U);
  const auto same = [](const TwoView& a, const TwoView& b) {
    return a.pair == b.pair && a.kind == b.kind && a.inliers == b.inliers &&
           a.second_from_first.rotation.coeffs() == b.second_from_first.rotation.coeffs() &&
           a.second_from_first.translation == b.second_from_first.translation;
  };
  for (size_t i = 0; i < 3; ++i) EXPECT_TRUE(same(serial.pairs[i], parallel.pairs[i]));
  many.matches.pairs.erase(many.matches.pairs.begin());
  EXPECT_TRUE(same(Build(many).pairs.at(0), serial.pairs[1]));
}

TEST(BuildTwoViews, NamesTheOptionThatIsWrong) {
  const TwoViewScene scene = MakeTwoViewScene({.points = 20, .seed = 1});
  ThreadPool pool(1);
  RunContext context{pool};
  const auto views =
      BuildTwoViews(scene.features, scene.intrinsics, scene.matches, {.max_error_px = -1}, context);
  ASSERT_FALSE(views.ok());
  EXPECT_EQ(views.error().code, ErrorCode::kInvalidArgument);
  EXPECT_NE(views.error().message.find("max_error_px"), std::string::npos);
}

TEST(BuildTwoViews, StopsWhenAsked) {
  const TwoViewScene scene = MakeTwoViewScene({.points = 20, .seed = 1});
  ThreadPool pool(1);
  std::stop_source source;
  source.request_stop();
  RunContext context{pool, source.get_token()};
  const auto views = BuildTwoViews(scene.features, scene.intrinsics, scene.matches, {}, context);
  ASSERT_FALSE(views.ok());
  EXPECT_EQ(views.error().code, ErrorCode::kCancelled);
}

}  // namespace
}  // namespace rotunda::sfm
