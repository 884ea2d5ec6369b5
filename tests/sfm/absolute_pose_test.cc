#include "sfm/absolute_pose.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

using test::NormalRandom;

constexpr uint64_t kSeed = 7;
constexpr double kFocal_px = 1840.0;

const Rigid3 kTruth = {
    Eigen::Quaterniond(Eigen::AngleAxisd(0.7, Eigen::Vector3d(0.3, -0.8, 0.5).normalized())),
    Eigen::Vector3d(0.1, -0.2, 1.7)};

struct Scene {
  AbsolutePoseInput input;
  std::vector<bool> right;
};

/// Points within 0.5 of the origin, seen from kTruth with noise; a share of them somewhere else.
Scene MakeScene(size_t count, double noise_px, double wrong_share, double assumed_over_true_focal) {
  NormalRandom random(kSeed);
  Scene scene;
  scene.input.focal_px = assumed_over_true_focal * kFocal_px;
  for (size_t i = 0; i < count; ++i) {
    const double x = random.Uniform() - 0.5, y = random.Uniform() - 0.5, z = random.Uniform() - 0.5;
    const double dx = noise_px / kFocal_px * random.Normal();
    const double dy = noise_px / kFocal_px * random.Normal();
    const double wrong_x = 0.6 * (random.Uniform() - 0.5), wrong_y = 0.8 * (random.Uniform() - 0.5);
    scene.right.push_back(random.Uniform() >= wrong_share);
    Eigen::Vector2d ray = (kTruth * Eigen::Vector3d(x, y, z)).hnormalized();
    ray += Eigen::Vector2d(dx, dy);
    if (!scene.right.back()) ray = {wrong_x, wrong_y};
    scene.input.points.push_back({x, y, z});
    scene.input.normalized.push_back(ray / assumed_over_true_focal);
  }
  return scene;
}

double RotationError_rad(const AbsolutePose& pose) {
  return RotationAngle_rad(pose.cam_from_model.rotation, kTruth.rotation);
}
double CenterError(const AbsolutePose& pose) {
  return (pose.cam_from_model.OriginInSource() - kTruth.OriginInSource()).norm();
}

TEST(AbsolutePose, IsExactOnExactPointsWithSeventyPercentMismatches) {
  const Scene scene = MakeScene(200, 0.0, 0.7, 1.0);
  const auto pose = EstimateAbsolutePose(scene.input, {});
  ASSERT_TRUE(pose);
  EXPECT_LT(RotationError_rad(*pose), 1e-3);  // a mismatch may lie within the threshold by chance
  AbsolutePose clean = *pose;
  clean.inliers.clear();
  for (size_t i = 0; i < scene.right.size(); ++i) {
    if (scene.right[i]) clean.inliers.push_back(i);
  }
  clean = RefineAbsolutePose(scene.input, clean, 1.0, false);
  EXPECT_LT(RotationError_rad(clean), 1e-10);
  EXPECT_LT(CenterError(clean), 1e-10);
  std::vector<bool> inlier(scene.right.size(), false);
  for (const size_t i : pose->inliers) inlier[i] = true;
  for (size_t i = 0; i < scene.right.size(); ++i) {
    EXPECT_TRUE(!scene.right[i] || inlier[i]) << "point " << i;
  }
}

TEST(AbsolutePose, FindsTheFocalLengthWhenAskedTo) {
  const Scene scene = MakeScene(200, 0.0, 0.3, 1.5);
  AbsolutePoseOptions options;
  options.focal_factors = {1.0, 0.5, 0.63, 0.79, 1.26};
  options.seed = kSeed;
  const auto pose = EstimateAbsolutePose(scene.input, options);
  ASSERT_TRUE(pose);
  EXPECT_NEAR(pose->focal_factor, 1.0 / 1.5, 1e-3);
  EXPECT_LT(RotationError_rad(*pose), 1e-3);
}

TEST(AbsolutePose, RefinementIsUnbiasedByAHandfulOfMismatches) {
  const Scene scene = MakeScene(300, 0.5, 0.05, 1.0);
  AbsolutePose start = {kTruth, 1.0, {}};
  for (size_t i = 0; i < scene.right.size(); ++i) start.inliers.push_back(i);
  const AbsolutePose refined = RefineAbsolutePose(scene.input, start, 1.0, false);
  // 0.5 px over 300 points: about 0.5 / 1840 / sqrt(300) rad across, a few times that along the
  // directions in which turning and shifting look alike.
  EXPECT_LT(RotationError_rad(refined), 3e-4);
  EXPECT_LT(CenterError(refined), 5e-4);
}

TEST(AbsolutePose, SaysWhenThereIsNoPose) {
  AbsolutePoseInput input;
  input.focal_px = kFocal_px;
  const auto none = EstimateAbsolutePose(input, {});
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::kFailed);
  for (int i = 0; i < 10; ++i) {  // all on a line
    input.points.push_back({0.1 * i, 0.0, 0.0});
    input.normalized.push_back({0.01 * i, 0.0});
  }
  EXPECT_FALSE(EstimateAbsolutePose(input, {}));
}

}  // namespace
}  // namespace rotunda::sfm
