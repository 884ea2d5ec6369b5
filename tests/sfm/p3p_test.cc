#include "sfm/p3p.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

using test::NormalRandom;

constexpr uint64_t kSeed = 20;

struct Problem {
  Rigid3 cam_from_world;
  std::array<Eigen::Vector3d, 3> rays, points;
};

Eigen::Vector3d NormalVector(NormalRandom& random) {
  const double x = random.Normal(), y = random.Normal(), z = random.Normal();
  return {x, y, z};
}

Rigid3 RandomPose(NormalRandom& random) {
  const Eigen::Vector3d axis = NormalVector(random).normalized();
  return {Eigen::Quaterniond(Eigen::AngleAxisd(kPi * random.Uniform(), axis)),
          NormalVector(random)};
}

/// Points given in the camera frame.
Problem ProblemOf(const Rigid3& pose, const std::array<Eigen::Vector3d, 3>& points_in_cam) {
  Problem problem;
  problem.cam_from_world = pose;
  for (size_t i = 0; i < 3; ++i) {
    problem.rays[i] = points_in_cam[i].normalized();
    problem.points[i] = pose.Inverse() * points_in_cam[i];
  }
  return problem;
}

double DistanceToTruth(const Problem& problem, const std::vector<Rigid3>& poses) {
  double least = std::numeric_limits<double>::infinity();
  for (const Rigid3& pose : poses) {
    const double off = RotationAngle_rad(pose.rotation, problem.cam_from_world.rotation) +
                       (pose.translation - problem.cam_from_world.translation).norm();
    least = std::min(least, off);
  }
  return least;
}

/// Largest angle between a ray and the point it should hit.
double WorstMiss(const Problem& problem, const Rigid3& pose) {
  double worst = 0;
  for (size_t i = 0; i < 3; ++i) {
    const Eigen::Vector3d x = (pose * problem.points[i]).normalized();
    worst = std::max(worst, (x - problem.rays[i]).norm());
  }
  return worst;
}

TEST(P3p, FindsTheTruePoseAmongRandomProblems) {
  NormalRandom random(kSeed);
  constexpr int kTrials = 5000;
  std::vector<double> distances;
  for (int trial = 0; trial < kTrials; ++trial) {
    std::array<Eigen::Vector3d, 3> points;
    for (Eigen::Vector3d& point : points) {
      const double x = 2.0 * random.Uniform() - 1.0, y = 2.0 * random.Uniform() - 1.0;
      point = (1.0 + 4.0 * random.Uniform()) * Eigen::Vector3d(x, y, 1.0);
    }
    const Problem problem = ProblemOf(RandomPose(random), points);
    std::vector<Rigid3> poses;
    SolveP3p(problem.rays, problem.points, poses);
    EXPECT_LE(poses.size(), 4u);
    for (const Rigid3& pose : poses) {
      EXPECT_LT(WorstMiss(problem, pose), 1e-6) << "seed " << kSeed << " trial " << trial;
    }
    distances.push_back(DistanceToTruth(problem, poses));
  }
  // Random triples include ones arbitrarily close to a double root, where the pose is determined to
  // the square root of the precision only.
  const auto within = [&](double limit) {
    return std::count_if(distances.begin(), distances.end(), [&](double d) { return d < limit; });
  };
  EXPECT_EQ(within(1e-5), kTrials);
  EXPECT_GE(within(1e-8), kTrials * 995 / 1000);
}

TEST(P3p, SolvesSymmetricTriangles) {
  NormalRandom random(kSeed);
  const std::vector<std::array<Eigen::Vector3d, 3>> cases = {
      // Facing the camera, equilateral: all depths equal, the danger of equal coefficients.
      {Eigen::Vector3d(1, 0, 4), Eigen::Vector3d(-0.5, std::sqrt(0.75), 4),
       Eigen::Vector3d(-0.5, -std::sqrt(0.75), 4)},
      // Isosceles, two depths equal.
      {Eigen::Vector3d(0, 0.3, 3), Eigen::Vector3d(-0.5, 0, 4), Eigen::Vector3d(0.5, 0, 4)},
      // One point on the optical axis, right angle.
      {Eigen::Vector3d(0, 0, 2), Eigen::Vector3d(1, 0, 2), Eigen::Vector3d(0, 1, 2)}};
  for (const auto& points : cases) {
    for (int turn = 0; turn < 3; ++turn) {
      std::array<Eigen::Vector3d, 3> turned = points;
      std::rotate(turned.begin(), turned.begin() + turn, turned.end());
      const Problem problem = ProblemOf(RandomPose(random), turned);
      std::vector<Rigid3> poses;
      SolveP3p(problem.rays, problem.points, poses);
      EXPECT_LT(DistanceToTruth(problem, poses), 1e-6) << "turn " << turn;
    }
  }
}

TEST(P3p, GivesNoPoseForPointsOnALine) {
  const Problem problem = ProblemOf(
      {}, {Eigen::Vector3d(0, 0, 2), Eigen::Vector3d(0.5, 0.25, 3), Eigen::Vector3d(1.0, 0.5, 4)});
  std::vector<Rigid3> poses = {Rigid3{}};
  SolveP3p(problem.rays, problem.points, poses);
  EXPECT_TRUE(poses.empty());
}

TEST(P3p, GivesOnlyFinitePosesForEqualPointsOrRays) {
  const Eigen::Vector3d a(0, 0, 2), b(0.5, 0.25, 3), c(1.0, -0.5, 4);
  for (Problem problem : {ProblemOf({}, {a, a, b}), ProblemOf({}, {a, b, b})}) {
    std::vector<Rigid3> poses;
    SolveP3p(problem.rays, problem.points, poses);
    EXPECT_TRUE(poses.empty());
  }
  Problem same_ray = ProblemOf({}, {a, b, c});
  same_ray.rays[1] = same_ray.rays[0];
  std::vector<Rigid3> poses;
  SolveP3p(same_ray.rays, same_ray.points, poses);
  for (const Rigid3& pose : poses) EXPECT_TRUE(pose.Matrix().allFinite());
}

}  // namespace
}  // namespace rotunda::sfm
