#include "sfm/epipolar.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>

#include "tests/support/two_view_scene.h"

namespace rotunda::sfm {
namespace {

using test::MakeTwoViewScene;
using test::SceneOptions;
using test::TwoViewScene;

std::vector<Correspondence> NormalizedData(const TwoViewScene& scene) {
  std::vector<Correspondence> data;
  for (const Match& match : scene.matches.pairs[0].matches) {
    const Keypoint& a = scene.features.images[0].keypoints[match.first.index()];
    const Keypoint& b = scene.features.images[1].keypoints[match.second.index()];
    data.push_back({*scene.intrinsics.lenses[0].NormalizedFromPixel({a.x_px, a.y_px}),
                    *scene.intrinsics.lenses[1].NormalizedFromPixel({b.x_px, b.y_px})});
  }
  return data;
}

double RotationError_deg(const Rigid3& a, const Rigid3& b) {
  return DegFromRad(RotationAngle_rad(a.rotation, b.rotation));
}
double DirectionError_deg(const Rigid3& a, const Rigid3& b) {
  return DegFromRad(
      std::atan2(a.translation.cross(b.translation).norm(), a.translation.dot(b.translation)));
}

TEST(Epipolar, PoseSurvivesTheEssentialMatrix) {
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const TwoViewScene scene = MakeTwoViewScene({.points = 30, .seed = seed});
    const std::vector<Correspondence> data = NormalizedData(scene);
    const Eigen::Matrix3d essential = EssentialFromPose(scene.second_from_first);
    for (double sign : {1.0, -1.0}) {
      const Rigid3 pose = PoseInFront(sign * essential, data, 1e-6);
      EXPECT_LT(RotationError_deg(pose, scene.second_from_first), 1e-6);
      EXPECT_LT(DirectionError_deg(pose, scene.second_from_first), 1e-6);
    }
  }
}

TEST(Epipolar, PoseSurvivesTheHomography) {
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const TwoViewScene scene =
        MakeTwoViewScene({.shape = test::SceneShape::kPlane, .points = 30, .seed = seed});
    const std::optional<Eigen::Matrix3d> homography = FitHomography(NormalizedData(scene));
    ASSERT_TRUE(homography.has_value());
    for (double sign : {1.0, -1.0}) {
      const std::vector<Rigid3> poses = PosesFromHomography(sign * *homography);
      ASSERT_EQ(poses.size(), 4U);
      // Keypoints are stored as float, so the homography is exact to some 1e-6.
      EXPECT_TRUE(std::any_of(poses.begin(), poses.end(),
                              [&](const Rigid3& pose) {
                                return RotationError_deg(pose, scene.second_from_first) < 1e-2 &&
                                       DirectionError_deg(pose, scene.second_from_first) < 1e-2;
                              }))
          << "seed " << seed;
    }
  }
  EXPECT_TRUE(PosesFromHomography(Eigen::Matrix3d::Identity()).empty());
}

// First order: a keypoint moved by e across its epipolar line, shared out between both pictures.
TEST(Epipolar, SampsonDistanceIsTheSmallestCorrectionToFirstOrder) {
  const TwoViewScene scene = MakeTwoViewScene({.points = 50, .seed = 3});
  const Eigen::Matrix3d essential = EssentialFromPose(scene.second_from_first);
  for (const Correspondence& exact : NormalizedData(scene)) {
    const Eigen::Vector2d normal_second = (essential * exact.first.homogeneous()).head<2>();
    const Eigen::Vector2d normal_first =
        (essential.transpose() * exact.second.homogeneous()).head<2>();
    // Moving both keypoints along (normal_first, normal_second) is the shortest way off.
    const double length = std::sqrt(normal_first.squaredNorm() + normal_second.squaredNorm());
    constexpr double kShift = 1e-4;
    Correspondence moved = exact;
    moved.first += kShift * normal_first / length;
    moved.second += kShift * normal_second / length;
    EXPECT_NEAR(std::sqrt(SquaredSampson(essential, moved)), kShift, 0.01 * kShift);
  }
}

TEST(Epipolar, ScoreIsTheTruncatedSumAndMayStopEarly) {
  const TwoViewScene scene =
      MakeTwoViewScene({.points = 300, .noise_px = 1.0, .outlier_share = 0.4, .seed = 4});
  const std::vector<Correspondence> data = NormalizedData(scene);
  const Eigen::Matrix3d essential = EssentialFromPose(scene.second_from_first);
  const double max_error = 3.0 / 1500;
  double cost = 0;
  size_t inliers = 0;
  for (const Correspondence& c : data) {
    const double squared = SquaredSampson(essential, c);
    cost += std::min(squared, max_error * max_error);
    inliers += squared < max_error * max_error;
  }
  const RansacScore score = ScoreEpipolar(essential, data, max_error, 1e9);
  EXPECT_DOUBLE_EQ(score.cost, cost);
  EXPECT_EQ(score.inliers, inliers);
  EXPECT_EQ(EpipolarInliers(essential, data, max_error).size(), inliers);
  EXPECT_GT(ScoreEpipolar(essential, data, max_error, 0.1 * cost).cost, 0.1 * cost);
}

TEST(Epipolar, InFrontTellsSidesAndForgivesPointsFarAway) {
  const Rigid3 pose{Eigen::Quaterniond::Identity(), Eigen::Vector3d(-1, 0, 0)};
  const Correspondence in_front{{0, 0}, {-0.2, 0}};
  const Correspondence behind{{0, 0}, {0.2, 0}};
  const Correspondence far{{0, 0}, {1e-4, 0}};
  EXPECT_TRUE(InFront(pose, in_front, 1e-3));
  EXPECT_FALSE(InFront(pose, behind, 1e-3));
  EXPECT_TRUE(InFront(pose, far, 1e-3));
  EXPECT_NEAR(RayAngle_rad(pose, in_front), std::atan(0.2), 1e-12);
}

TEST(RefinePose, ReachesTheMinimum) {
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const TwoViewScene scene = MakeTwoViewScene({.points = 200, .noise_px = 0.5, .seed = seed});
    const std::vector<Correspondence> data = NormalizedData(scene);
    const auto cost = [&](const Rigid3& pose) {
      return ScoreEpipolar(EssentialFromPose(pose), data, 1.0, 1e9).cost;
    };
    Rigid3 start = scene.second_from_first;
    start.rotation = start.rotation * Eigen::Quaterniond(1, 0.01, -0.01, 0.005).normalized();
    start.translation = (start.translation + Eigen::Vector3d(0.05, 0.05, -0.05)).normalized();
    const Rigid3 refined = RefinePose(start, data, 50);
    EXPECT_LT(cost(refined), cost(start));
    EXPECT_LE(cost(refined), cost(scene.second_from_first));
    EXPECT_NEAR(refined.translation.norm(), 1.0, 1e-12);
    // No step in any of the five directions lowers the cost: the gradient vanishes there.
    for (int axis = 0; axis < 3; ++axis) {
      for (double step : {1e-5, -1e-5}) {
        Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();
        turn.vec()[axis] = step;
        const Rigid3 turned{refined.rotation * turn.normalized(), refined.translation};
        EXPECT_GE(cost(turned), cost(refined)) << "seed " << seed;
        Rigid3 moved = refined;
        moved.translation[axis] += step;
        moved.translation.normalize();
        EXPECT_GE(cost(moved), cost(refined) * (1 - 1e-12)) << "seed " << seed;
      }
    }
  }
}

TEST(RefinePose, IsExactOnExactData) {
  for (uint64_t seed = 0; seed < 10; ++seed) {
    const TwoViewScene scene = MakeTwoViewScene({.points = 100, .seed = seed});
    Rigid3 start = scene.second_from_first;
    start.rotation = start.rotation * Eigen::Quaterniond(1, 0.02, -0.01, 0.01).normalized();
    const Rigid3 refined = RefinePose(start, NormalizedData(scene), 50);
    // Keypoints are stored as float: 6e-5 px at 1000 px.
    EXPECT_LT(RotationError_deg(refined, scene.second_from_first), 1e-5);
    EXPECT_LT(DirectionError_deg(refined, scene.second_from_first), 1e-4);
  }
}

}  // namespace
}  // namespace rotunda::sfm
