#include "sfm/focal_estimation.h"

#include <gtest/gtest.h>

#include "sfm/incremental.h"
#include "tests/support/reconstruction_near.h"
#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

using test::MakeSyntheticWorld;
using test::SyntheticOptions;
using test::SyntheticWorld;

/// A ring of which only a guess of the focal length is known, `guess_over_truth` times the truth.
SyntheticWorld GuessedWorld(double guess_over_truth, CameraModel model) {
  SyntheticOptions options;
  options.model = model;
  options.points = 1200;
  SyntheticWorld world = MakeSyntheticWorld(options);
  for (CameraIntrinsics& lens : world.intrinsics.lenses) {
    lens.params[0] = guess_over_truth * options.focal_px;
    lens.params[1] = 0.5 * lens.width_px;
    lens.params[2] = 0.5 * lens.height_px;
    if (model == CameraModel::kSimpleRadial) lens.params[3] = 0.0;
  }
  world.intrinsics.known = false;
  for (TwoView& pair : world.two_views.pairs) pair.kind = TwoViewKind::kUncalibrated;
  return world;
}

class FocalEstimationTest : public ::testing::Test {
 protected:
  ThreadPool threads_{2};
  RunContext context_{threads_};
};

TEST_F(FocalEstimationTest, FindsTheFocalLengthFromGuessesFarOff) {
  for (const double guess : {0.6, 0.8, 1.35, 1.8}) {
    const SyntheticWorld world = GuessedWorld(guess, CameraModel::kSimplePinhole);
    const SelfCalibration found =
        EstimateFocalLengths(world.features, world.intrinsics, world.two_views, context_);
    // The lenses differ by 1 % among each other and their principal points by 5 px.
    EXPECT_NEAR(found.focal_factor * guess, 1.0, 0.04) << "guess " << guess;
    EXPECT_NEAR(found.intrinsics.lenses[3].params[0],
                found.focal_factor * world.intrinsics.lenses[3].params[0], 1e-9);
  }
}

TEST_F(FocalEstimationTest, LeavesAGuessAloneThatNothingBeats) {
  const SyntheticWorld world = GuessedWorld(1.0, CameraModel::kSimplePinhole);
  const SelfCalibration found =
      EstimateFocalLengths(world.features, world.intrinsics, world.two_views, context_);
  EXPECT_NEAR(found.focal_factor, 1.0, 0.04);
  SyntheticWorld none = world;
  none.two_views.pairs.clear();
  EXPECT_EQ(
      EstimateFocalLengths(none.features, none.intrinsics, none.two_views, context_).focal_factor,
      1.0);
}

TEST_F(FocalEstimationTest, LetsARingWithALensEachBeReconstructed) {
  const SyntheticWorld world = GuessedWorld(1.4, CameraModel::kSimpleRadial);
  IncrementalOptions options;
  options.refine_intrinsics = true;
  const auto result = BuildReconstructions(world.Input(), options, context_);
  ASSERT_TRUE(result) << result.error().ToString();
  // The principal points are held in the middle of the pictures and are off by 5 px an axis: at
  // four standard deviations 28 px, which turns a camera by 28 / 1840 rad or shifts it by that
  // times 1.7 m.
  const double limit_rad = 28.0 / 1840.0;
  EXPECT_EQ(test::NotNear(result->models[0], world.cam_from_world, limit_rad, 1.7 * limit_rad), "");
}

}  // namespace
}  // namespace rotunda::sfm
