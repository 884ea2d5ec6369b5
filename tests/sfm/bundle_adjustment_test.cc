#include "sfm/bundle_adjustment.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <limits>
#include <memory>
#include <vector>

#include "tests/support/reconstruction_near.h"
#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

using test::ErrorsOf;
using test::MakeSyntheticWorld;
using test::NormalRandom;
using test::SyntheticOptions;
using test::SyntheticWorld;
using test::TrueReconstruction;

/// Keypoints are stored as floats: half a unit in the last place at 1600 px.
constexpr double kKeypointRounding_px = 6.1e-5;
constexpr double kFocal_px = 1840.0;

std::vector<ImageId> AllImages(const SyntheticWorld& world) {
  std::vector<ImageId> images;
  for (size_t i = 0; i < world.cam_from_world.size(); ++i) images.push_back(ImageId(i));
  return images;
}

/// Every pose turned by about `angle_rad` and shifted by `shift_m`, every point shifted as well.
Reconstruction Perturbed(Reconstruction reconstruction, double angle_rad, double shift_m) {
  NormalRandom random(3);
  const auto draw = [&](double sigma) {
    const double x = random.Normal(), y = random.Normal(), z = random.Normal();
    return Eigen::Vector3d(sigma * x, sigma * y, sigma * z);
  };
  for (auto& pose : reconstruction.cam_from_model) {
    const Eigen::Vector3d turn = draw(angle_rad);
    pose->rotation = Eigen::AngleAxisd(turn.norm(), turn.normalized()) * pose->rotation;
    pose->translation += draw(shift_m);
  }
  for (Point3& point : reconstruction.points) point.position += draw(shift_m);
  return reconstruction;
}

class BundleAdjustmentTest : public ::testing::Test {
 protected:
  ThreadPool threads_{1};
  RunContext context_{threads_};
};

TEST_F(BundleAdjustmentTest, ConvergesToTheTruthWithoutNoise) {
  SyntheticOptions options;
  options.noise_px = 0.0;
  const SyntheticWorld world = MakeSyntheticWorld(options);
  Reconstruction model = Perturbed(TrueReconstruction(world), 0.02, 0.02);
  BundleAdjustmentOptions adjustment;
  adjustment.function_tolerance = 1e-14;
  const auto report = AdjustBundle(model, world.features, AllImages(world), adjustment, context_);
  ASSERT_TRUE(report) << report.error().ToString();
  EXPECT_TRUE(report->converged);
  // What rounding of the keypoints leaves: rounding / focal length, times the camera's distance.
  const double angle_rad = kKeypointRounding_px / kFocal_px;
  EXPECT_EQ(test::NotNear(model, world.cam_from_world, 10 * angle_rad, 10 * 1.7 * angle_rad), "");
}

TEST_F(BundleAdjustmentTest, HoldsTheFirstPoseAndOneDistance) {
  const SyntheticWorld world = MakeSyntheticWorld({});
  Reconstruction model = Perturbed(TrueReconstruction(world), 0.01, 0.01);
  const Reconstruction before = model;
  ASSERT_TRUE(AdjustBundle(model, world.features, AllImages(world), {}, context_));
  EXPECT_EQ(model.cam_from_model[0]->rotation.coeffs(),
            before.cam_from_model[0]->rotation.coeffs());
  EXPECT_EQ(model.cam_from_model[0]->translation, before.cam_from_model[0]->translation);
  const Eigen::Vector3d first = before.cam_from_model[0]->OriginInSource();
  double held = 1.0;
  double farthest = 0.0;
  for (size_t i = 1; i < before.cam_from_model.size(); ++i) {
    const Eigen::Vector3d arm = before.cam_from_model[i]->OriginInSource() - first;
    if (arm.norm() <= farthest) continue;
    farthest = arm.norm();
    held = arm.dot(model.cam_from_model[i]->OriginInSource() - first) / arm.squaredNorm();
  }
  EXPECT_NEAR(held, 1.0, 1e-6);
}

TEST_F(BundleAdjustmentTest, LeavesOtherImagesAndWhatOnlyTheySeeAlone) {
  const SyntheticWorld world = MakeSyntheticWorld({});
  Reconstruction model = Perturbed(TrueReconstruction(world), 0.002, 0.002);
  const Reconstruction before = model;
  const std::vector<ImageId> free_images = {ImageId(3), ImageId(4)};
  ASSERT_TRUE(AdjustBundle(model, world.features, free_images, {}, context_));
  for (size_t i = 0; i < model.cam_from_model.size(); ++i) {
    const bool is_free = i == 3 || i == 4;
    EXPECT_EQ(model.cam_from_model[i]->translation != before.cam_from_model[i]->translation,
              is_free)
        << "image " << i;
  }
  for (size_t p = 0; p < model.points.size(); ++p) {
    bool seen = false;
    for (const Observation& o : model.points[p].observations) {
      seen = seen || o.image == free_images[0] || o.image == free_images[1];
    }
    EXPECT_EQ(model.points[p].position != before.points[p].position, seen) << "point " << p;
  }
}

TEST_F(BundleAdjustmentTest, RobustLossesBearMismatchesThatLeastSquaresDoesNot) {
  SyntheticOptions options;
  options.noise_px = 0.2;
  const SyntheticWorld world = MakeSyntheticWorld(options);
  const Reconstruction start = Perturbed(TrueReconstruction(world), 1e-4, 1e-4);
  Features mismatched = world.features;
  size_t n = 0;
  for (ImageFeatures& image : mismatched.images) {
    for (Keypoint& keypoint : image.keypoints) {
      if (n++ % 20 == 0) keypoint.x_px += 15.0f;
    }
  }
  const auto error = [&](const Features& features, Loss loss) {
    Reconstruction model = start;
    BundleAdjustmentOptions adjustment;
    adjustment.loss = loss;
    adjustment.loss_scale = 3.0;
    EXPECT_TRUE(AdjustBundle(model, features, AllImages(world), adjustment, context_));
    return ErrorsOf(model, world.cam_from_world).max_position;
  };
  const double clean = error(world.features, Loss::kNone);
  const double plain = error(mismatched, Loss::kNone);
  const double soft = error(mismatched, Loss::kSoftL1);
  const double cauchy = error(mismatched, Loss::kCauchy);
  EXPECT_GT(plain, 4.0 * clean);
  EXPECT_LT(soft, 2.0 * clean);
  EXPECT_LT(cauchy, 1.3 * clean);
}

TEST_F(BundleAdjustmentTest, RefinesFocalLengthAndDistortionAndNotThePrincipalPoint) {
  SyntheticOptions options;
  options.noise_px = 0.0;
  options.shared_lens = true;
  const SyntheticWorld world = MakeSyntheticWorld(options);
  Reconstruction model = Perturbed(TrueReconstruction(world), 0.002, 0.002);
  const std::vector<double> truth = world.intrinsics.lenses[0].params;
  std::vector<double>& params = model.intrinsics.lenses[0].params;
  params[0] *= 1.05;
  params[1] *= 0.97;
  params[4] = params[5] = params[6] = params[7] = 0.0;
  BundleAdjustmentOptions adjustment;
  adjustment.refine_intrinsics = true;
  adjustment.function_tolerance = 1e-14;
  ASSERT_TRUE(AdjustBundle(model, world.features, AllImages(world), adjustment, context_));
  EXPECT_EQ(params[2], truth[2]);
  EXPECT_EQ(params[3], truth[3]);
  EXPECT_NEAR(params[0], truth[0], 0.01);
  EXPECT_NEAR(params[1], truth[1], 0.01);
  for (size_t p = 4; p < 8; ++p) EXPECT_NEAR(params[p], truth[p], 1e-5) << "parameter " << p;
}

TEST_F(BundleAdjustmentTest, KeepsTheFocalLengthWithinBounds) {
  SyntheticOptions options;
  options.shared_lens = true;
  const SyntheticWorld world = MakeSyntheticWorld(options);
  Reconstruction model = TrueReconstruction(world);
  model.intrinsics.lenses[0].params[0] = 100.0;  // 0.06 of the larger side
  BundleAdjustmentOptions adjustment;
  adjustment.refine_intrinsics = true;
  adjustment.max_iterations = 1;
  ASSERT_TRUE(AdjustBundle(model, world.features, AllImages(world), adjustment, context_));
  EXPECT_GE(model.intrinsics.lenses[0].params[0], 0.3 * 1600);
}

TEST_F(BundleAdjustmentTest, GivesTheSameBytesTwice) {
  const SyntheticWorld world = MakeSyntheticWorld({});
  const Reconstruction start = Perturbed(TrueReconstruction(world), 0.01, 0.01);
  Reconstruction once = start, twice = start;
  ASSERT_TRUE(AdjustBundle(once, world.features, AllImages(world), {}, context_));
  ASSERT_TRUE(AdjustBundle(twice, world.features, AllImages(world), {}, context_));
  for (size_t i = 0; i < once.cam_from_model.size(); ++i) {
    EXPECT_EQ(once.cam_from_model[i]->Matrix(), twice.cam_from_model[i]->Matrix());
  }
  for (size_t p = 0; p < once.points.size(); ++p) {
    EXPECT_EQ(once.points[p].position, twice.points[p].position);
  }
}

/// Holes of all sizes in the heap, so that what is allocated next lies in another order each time.
std::vector<std::unique_ptr<char[]>> Holes(uint64_t seed) {
  NormalRandom random(seed);
  std::vector<std::unique_ptr<char[]>> blocks;
  for (int i = 0; i < 2000; ++i)
    blocks.push_back(std::make_unique<char[]>(16 + random.Index(4000)));
  for (auto& block : blocks) {
    if (random.Index(2) == 0) block.reset();
  }
  return blocks;
}

TEST_F(BundleAdjustmentTest, GivesTheSameBytesWhereverItsMemoryLies) {
  SyntheticOptions options;
  options.shared_lens = false;
  const SyntheticWorld world = MakeSyntheticWorld(options);
  const Reconstruction start = Perturbed(TrueReconstruction(world), 0.01, 0.01);
  BundleAdjustmentOptions adjustment;
  adjustment.refine_intrinsics = true;
  adjustment.max_iterations = 5;
  Reconstruction first = start;
  ASSERT_TRUE(AdjustBundle(first, world.features, AllImages(world), adjustment, context_));
  for (uint64_t seed = 1; seed <= 10; ++seed) {
    const auto holes = Holes(seed);
    Reconstruction model = start;
    ASSERT_TRUE(AdjustBundle(model, world.features, AllImages(world), adjustment, context_));
    for (size_t i = 0; i < model.cam_from_model.size(); ++i) {
      ASSERT_EQ(first.cam_from_model[i]->Matrix(), model.cam_from_model[i]->Matrix())
          << "image " << i << ", seed " << seed;
      ASSERT_EQ(first.intrinsics.lenses[i].params, model.intrinsics.lenses[i].params);
    }
  }
}

TEST_F(BundleAdjustmentTest, RefusesNothingToDoAndBadOptions) {
  const SyntheticWorld world = MakeSyntheticWorld({});
  Reconstruction model = TrueReconstruction(world);
  BundleAdjustmentOptions bad;
  bad.loss_scale = 0;
  const auto refused = AdjustBundle(model, world.features, AllImages(world), bad, context_);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kInvalidArgument);
  EXPECT_EQ(refused.error().context, "loss_scale");
  model.points.clear();
  EXPECT_FALSE(AdjustBundle(model, world.features, AllImages(world), {}, context_));
}

TEST_F(BundleAdjustmentTest, SaysWhenTheSolverFailsAndLeavesTheModelAsItWas) {
  SyntheticWorld world = MakeSyntheticWorld({});
  Reconstruction model = Perturbed(TrueReconstruction(world), 0.01, 0.01);
  const Reconstruction before = model;
  const Observation& seen = model.points[0].observations[0];
  world.features.images[seen.image.index()].keypoints[seen.keypoint.index()].x_px =
      std::numeric_limits<float>::quiet_NaN();
  const auto failed = AdjustBundle(model, world.features, AllImages(world), {}, context_);
  ASSERT_FALSE(failed);
  EXPECT_EQ(failed.error().code, ErrorCode::kFailed);
  EXPECT_EQ(failed.error().context, "bundle adjustment");
  EXPECT_FALSE(failed.error().message.empty());
  for (size_t i = 0; i < model.cam_from_model.size(); ++i) {
    EXPECT_EQ(model.cam_from_model[i]->Matrix(), before.cam_from_model[i]->Matrix());
  }
  for (size_t p = 0; p < model.points.size(); ++p) {
    EXPECT_EQ(model.points[p].position, before.points[p].position) << "point " << p;
  }
}

TEST_F(BundleAdjustmentTest, StopsWhenAskedTo) {
  const SyntheticWorld world = MakeSyntheticWorld({});
  Reconstruction model = TrueReconstruction(world);
  std::stop_source stop;
  stop.request_stop();
  RunContext stopped{threads_, stop.get_token()};
  const auto report = AdjustBundle(model, world.features, AllImages(world), {}, stopped);
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().code, ErrorCode::kCancelled);
}

}  // namespace
}  // namespace rotunda::sfm
