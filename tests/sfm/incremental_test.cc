#include "sfm/incremental.h"

#include <gtest/gtest.h>

#include <cmath>

#include "sfm/covariance.h"
#include "tests/support/reconstruction_near.h"
#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

using test::Disconnect;
using test::ErrorsOf;
using test::MakeSyntheticWorld;
using test::NotNear;
using test::SyntheticOptions;
using test::SyntheticWorld;

/// Keypoints are stored as floats: half a unit in the last place at 1600 px.
constexpr double kKeypointRounding_px = 6.1e-5;
constexpr double kFocal_px = 1840.0;
constexpr double kDistance_m = 1.7;

class IncrementalTest : public ::testing::Test {
 protected:
  Result<IncrementalResult> Build(const SyntheticWorld& world, const IncrementalOptions& options) {
    return BuildReconstructions(world.Input(), options, context_);
  }
  ThreadPool threads_{2};
  RunContext context_{threads_};
};

std::vector<ImageId> ImagesBelow(size_t count) {
  std::vector<ImageId> images;
  for (size_t i = 0; i < count; ++i) images.push_back(ImageId(i));
  return images;
}

TEST_F(IncrementalTest, IsExactWithoutNoise) {
  SyntheticOptions options;
  options.noise_px = 0.0;
  const SyntheticWorld world = MakeSyntheticWorld(options);
  const auto result = Build(world, {});
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_EQ(result->models.size(), 1u);
  EXPECT_TRUE(result->unregistered.empty());
  const double angle_rad = kKeypointRounding_px / kFocal_px;
  EXPECT_EQ(NotNear(result->models[0], world.cam_from_world, 10 * angle_rad,
                    10 * kDistance_m * angle_rad),
            "");
}

TEST_F(IncrementalTest, ErrorIsWhatTheNoiseAllows) {
  constexpr int kSeeds = 8;
  double rotation = 0, position = 0;
  size_t cameras = 0;
  for (uint64_t seed = 1; seed <= kSeeds; ++seed) {
    SyntheticOptions options;
    options.seed = seed;
    const SyntheticWorld world = MakeSyntheticWorld(options);
    const auto result = Build(world, {});
    ASSERT_TRUE(result && result->models.size() == 1 && result->unregistered.empty());
    const Reconstruction& model = result->models[0];
    const auto covariances = BuildPoseCovariances(model, world.features, false, context_);
    ASSERT_TRUE(covariances) << covariances.error().ToString();
    const test::PoseErrors errors = ErrorsOf(model, world.cam_from_world);
    for (size_t k = 0; k < errors.images.size(); ++k) {
      const PoseSigma sigma = SigmaOf(*covariances->images[errors.images[k].index()]);
      const double position_mm = sigma.position_mm * errors.truth_from_model.scale;
      rotation += std::pow(DegFromRad(errors.rotation_rad[k]) / sigma.rotation_deg, 2);
      position += std::pow(1000.0 * errors.position[k] / position_mm, 2);
    }
    cameras += errors.images.size();
  }
  // Cameras of one ring err together, so that a seed is worth a few independent ones: the mean
  // square over 8 seeds has a standard deviation of about sqrt(2 / (8 * 6)) = 0.2.
  EXPECT_NEAR(rotation / cameras, 1.0, 0.5);
  EXPECT_NEAR(position / cameras, 1.0, 0.5);
}

TEST_F(IncrementalTest, BearsMismatchesInTracks) {
  SyntheticOptions options;
  options.wrong_match_share = 0.3;
  options.points = 1500;
  const SyntheticWorld world = MakeSyntheticWorld(options);
  const auto result = Build(world, {});
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_EQ(result->models.size(), 1u);
  // Tracks are shorter and fewer than without mismatches; the poses stay free of gross errors.
  EXPECT_EQ(NotNear(result->models[0], world.cam_from_world, RadFromDeg(0.3), 0.008), "");
}

TEST_F(IncrementalTest, GivesGroupsThatShareNothingAModelEach) {
  SyntheticWorld world = MakeSyntheticWorld({});
  Disconnect(world, ImagesBelow(10));
  const auto result = Build(world, {});
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_EQ(result->models.size(), 2u);
  EXPECT_TRUE(result->unregistered.empty());
  for (size_t i = 0; i < world.cam_from_world.size(); ++i) {
    EXPECT_EQ(result->models[0].Registered(ImageId(i)), i >= 10) << "image " << i;
    EXPECT_EQ(result->models[1].Registered(ImageId(i)), i < 10) << "image " << i;
  }
  for (const Reconstruction& model : result->models) {
    EXPECT_LT(ErrorsOf(model, world.cam_from_world).max_rotation_rad, RadFromDeg(0.3));
  }
}

TEST_F(IncrementalTest, SaysWhyAnImageIsNotRegistered) {
  SyntheticWorld world = MakeSyntheticWorld({});
  Disconnect(world, {ImageId(5)});
  world.features.images[7].keypoints.clear();
  world.point_of_keypoint[7].clear();
  std::erase_if(world.two_views.pairs, [](const TwoView& pair) {
    return pair.pair.first == ImageId(7) || pair.pair.second == ImageId(7);
  });
  Disconnect(world, {ImageId(7)});
  const auto result = Build(world, {});
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_EQ(result->unregistered.size(), 2u);
  EXPECT_EQ(result->unregistered[0].image, ImageId(5));
  EXPECT_EQ(result->unregistered[0].reason, "matches no other picture");
  EXPECT_EQ(result->unregistered[1].image, ImageId(7));
  EXPECT_EQ(result->unregistered[1].reason, "no keypoints");
}

TEST_F(IncrementalTest, RefusesAnImageWhoseMatchesAreAllWrong) {
  SyntheticWorld world = MakeSyntheticWorld({});
  const ImageId wrong(4);
  test::NormalRandom random(9);
  for (Keypoint& keypoint : world.features.images[wrong.index()].keypoints) {
    keypoint.x_px = static_cast<float>(1200 * random.Uniform());
    keypoint.y_px = static_cast<float>(1600 * random.Uniform());
  }
  const auto result = Build(world, {});
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_EQ(result->unregistered.size(), 1u);
  EXPECT_EQ(result->unregistered[0].image, wrong);
  EXPECT_NE(result->unregistered[0].reason.find("its best pose fits"), std::string::npos)
      << result->unregistered[0].reason;
  EXPECT_LT(ErrorsOf(result->models[0], world.cam_from_world).max_rotation_rad, RadFromDeg(0.3));
}

TEST_F(IncrementalTest, RefinesLensesThatStartWrong) {
  SyntheticOptions options;
  options.model = CameraModel::kSimpleRadial;
  options.shared_lens = true;
  options.points = 1200;
  SyntheticWorld world = MakeSyntheticWorld(options);
  const std::vector<double> truth = world.intrinsics.lenses[0].params;
  CameraIntrinsics& lens = world.intrinsics.lenses[0];
  lens.params[0] *= 1.06;
  lens.params[3] = 0.0;
  world.intrinsics.known = false;
  IncrementalOptions incremental;
  incremental.refine_intrinsics = true;
  const auto result = Build(world, incremental);
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_TRUE(result->models.size() == 1 && result->unregistered.empty());
  const Reconstruction& model = result->models[0];
  const auto covariances = BuildPoseCovariances(model, world.features, true, context_);
  ASSERT_TRUE(covariances && covariances->focal_sigma_px[0]);
  EXPECT_NEAR(model.intrinsics.lenses[0].params[0], truth[0], 4 * *covariances->focal_sigma_px[0]);
  EXPECT_LT(*covariances->focal_sigma_px[0], 5.0);
  EXPECT_LT(ErrorsOf(model, world.cam_from_world).max_rotation_rad, RadFromDeg(0.3));
}

TEST_F(IncrementalTest, GivesTheSameBytesOnAnyNumberOfThreads) {
  SyntheticOptions options;
  options.wrong_match_share = 0.05;
  const SyntheticWorld world = MakeSyntheticWorld(options);
  const auto two = Build(world, {});
  ThreadPool single(1);
  RunContext alone{single};
  const auto one = BuildReconstructions(world.Input(), {}, alone);
  ASSERT_TRUE(one && two);
  ASSERT_EQ(one->models.size(), two->models.size());
  const Reconstruction& a = one->models[0];
  const Reconstruction& b = two->models[0];
  for (size_t i = 0; i < a.cam_from_model.size(); ++i) {
    ASSERT_EQ(a.Registered(ImageId(i)), b.Registered(ImageId(i)));
    if (a.Registered(ImageId(i))) {
      EXPECT_EQ(a.cam_from_model[i]->Matrix(), b.cam_from_model[i]->Matrix()) << "image " << i;
    }
  }
  ASSERT_EQ(a.points.size(), b.points.size());
  for (size_t p = 0; p < a.points.size(); ++p) {
    EXPECT_EQ(a.points[p].position, b.points[p].position);
    EXPECT_EQ(a.points[p].observations, b.points[p].observations);
  }
}

TEST_F(IncrementalTest, SaysWhatTheBestPairLackedWhenNoneStarts) {
  SyntheticWorld world = MakeSyntheticWorld({});
  for (TwoView& pair : world.two_views.pairs) pair.median_angle_rad = RadFromDeg(1.0);
  const auto result = Build(world, {});
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, ErrorCode::kFailed);
  EXPECT_NE(result.error().message.find("1.0"), std::string::npos) << result.error().message;
  world.two_views.pairs.clear();
  Disconnect(world, {});
  const auto none = Build(world, {});
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().message, "no two pictures match");
}

TEST_F(IncrementalTest, StopsWhenAskedToAndRefusesBadOptions) {
  const SyntheticWorld world = MakeSyntheticWorld({});
  std::stop_source stop;
  stop.request_stop();
  RunContext stopped{threads_, stop.get_token()};
  const auto cancelled = BuildReconstructions(world.Input(), {}, stopped);
  ASSERT_FALSE(cancelled);
  EXPECT_EQ(cancelled.error().code, ErrorCode::kCancelled);
  IncrementalOptions bad;
  bad.global_ba_growth = 1.0;
  const auto refused = Build(world, bad);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().context, "global_ba_growth");
}

}  // namespace
}  // namespace rotunda::sfm
