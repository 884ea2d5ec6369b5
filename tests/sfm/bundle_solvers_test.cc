// The two solvers of bundle adjustment on the same problems.
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <stop_token>
#include <string>
#include <utility>

#include "sfm/bundle_ceres.h"
#include "sfm/bundle_schur.h"
#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

using test::MakeSyntheticWorld;
using test::NormalRandom;
using test::SyntheticOptions;
using test::SyntheticWorld;

constexpr uint64_t kSeed = 7;
constexpr double kStartOff_m = 0.005;

Eigen::Vector3d Shift(NormalRandom& random, double sigma_m) {
  const double x = random.Normal(), y = random.Normal(), z = random.Normal();
  return sigma_m * Eigen::Vector3d(x, y, z);
}

/// The world's problem with every 20th keypoint off by 15 px. `held` images do not move; with one,
/// its farthest fellow keeps its distance.
BundleProblem MakeProblem(const SyntheticWorld& world, size_t held) {
  NormalRandom random(kSeed);
  BundleProblem problem;
  problem.lenses = world.intrinsics.lenses;
  for (size_t i = 0; i < world.cam_from_world.size(); ++i) {
    const Rigid3& pose = world.cam_from_world[i];
    const bool free = i >= held;
    problem.poses.push_back({pose.rotation,
                             pose.OriginInSource() + Shift(random, free ? kStartOff_m : 0.0),
                             world.intrinsics.lens_of_image[i], true, free});
  }
  problem.first_observation = {0};
  for (const Point3& point : test::TrueReconstruction(world).points) {
    problem.points.push_back(point.position + Shift(random, kStartOff_m));
    for (const Observation& o : point.observations) {
      const Keypoint& keypoint = world.features.image(o.image).keypoints[o.keypoint.index()];
      const double mismatch = problem.observations.size() % 20 == 0 ? 15.0 : 0.0;
      problem.observations.push_back({{keypoint.x_px + mismatch, keypoint.y_px},
                                      1.0 / KeypointSigma_px(keypoint),
                                      static_cast<uint32_t>(o.image.index())});
    }
    problem.first_observation.push_back(problem.observations.size());
  }
  if (held > 1) return problem;
  const Eigen::Vector3d from = problem.poses[0].center;
  const size_t other = problem.poses.size() / 2;
  const Eigen::Vector3d arm = problem.poses[other].center - from;
  problem.scale_gauge = {other, from, arm / arm.squaredNorm(), 1e4};
  return problem;
}

struct Case {
  const char* name;
  Loss loss;
  size_t held;
};

class BundleSolversTest : public ::testing::TestWithParam<Case> {
 protected:
  BundleAdjustmentOptions Options() const {
    BundleAdjustmentOptions options;
    options.loss = GetParam().loss;
    options.function_tolerance = 1e-15;
    options.max_iterations = 400;
    return options;
  }
  const SyntheticWorld world_ = MakeSyntheticWorld(SyntheticOptions{});
};

TEST_P(BundleSolversTest, FindTheSameMinimum) {
  BundleProblem ours = MakeProblem(world_, GetParam().held), theirs = ours;
  ThreadPool threads(2);
  RunContext context{threads};
  const auto by_elimination = SolveByPointElimination(ours, Options(), context);
  const auto by_ceres = SolveWithCeres(theirs, Options(), {});
  ASSERT_TRUE(by_elimination) << by_elimination.error().ToString();
  ASSERT_TRUE(by_ceres) << by_ceres.error().ToString();
  EXPECT_TRUE(by_elimination->converged);
  EXPECT_LT(by_elimination->final_cost, 0.9 * by_elimination->initial_cost);
  EXPECT_NEAR(by_elimination->initial_cost / by_ceres->initial_cost, 1.0, 1e-12);
  EXPECT_NEAR(by_elimination->final_cost / by_ceres->final_cost, 1.0, 1e-9);
  // The cost is flat at its minimum: 1e-9 of it is far below the noise of a pose.
  for (size_t i = 0; i < ours.poses.size(); ++i) {
    EXPECT_LT(ours.poses[i].rotation.angularDistance(theirs.poses[i].rotation), 1e-6) << i;
    EXPECT_LT((ours.poses[i].center - theirs.poses[i].center).norm(), 2e-6) << i;
  }
}

TEST_P(BundleSolversTest, EliminationGivesTheSameBitsOnAnyNumberOfThreads) {
  const BundleProblem start = MakeProblem(world_, GetParam().held);
  std::vector<BundleProblem> solved;
  for (const int count : {1, 2, 5}) {
    ThreadPool threads(count);
    RunContext context{threads};
    solved.push_back(start);
    ASSERT_TRUE(SolveByPointElimination(solved.back(), Options(), context));
    for (size_t i = 0; i < start.poses.size(); ++i) {
      EXPECT_EQ(solved.back().poses[i].center, solved[0].poses[i].center);
      EXPECT_EQ(solved.back().poses[i].rotation.coeffs(), solved[0].poses[i].rotation.coeffs());
    }
    EXPECT_EQ(solved.back().points, solved[0].points);
  }
  EXPECT_NE(solved[0].points, start.points);
}

INSTANTIATE_TEST_SUITE_P(Losses, BundleSolversTest,
                         ::testing::Values(Case{"LeastSquares", Loss::kNone, 1},
                                           Case{"SoftL1", Loss::kSoftL1, 1},
                                           Case{"Cauchy", Loss::kCauchy, 1},
                                           Case{"SomeHeld", Loss::kSoftL1, 5}),
                         [](const auto& info) { return std::string(info.param.name); });

Error ErrorOfElimination(BundleProblem problem, std::stop_token stop = {}) {
  ThreadPool threads(1);
  RunContext context{threads, std::move(stop)};
  const auto report = SolveByPointElimination(problem, BundleAdjustmentOptions{}, context);
  EXPECT_FALSE(report);
  return report ? Error{} : report.error();
}

/// A point almost in the centre of a camera that moves, on its axis: no residual, but derivatives
/// whose squares overflow.
TEST(PointEliminationTest, DoesNotCallItConvergedWhenNoStepCanBeSolved) {
  BundleProblem problem = MakeProblem(MakeSyntheticWorld(SyntheticOptions{}), 1);
  const CameraIntrinsics& lens = problem.lenses[problem.poses[1].lens];
  problem.poses[1].rotation = Eigen::Quaterniond::Identity();
  problem.poses[1].center.setZero();
  problem.points.push_back({0, 0, 1e-160});
  Eigen::Vector2d axis;
  DistortToPixel(lens.model, lens.params.data(), 0.0, 0.0, &axis.x(), &axis.y());
  problem.observations.push_back({axis, 1.0, 1});
  problem.first_observation.push_back(problem.observations.size());
  const Error error = ErrorOfElimination(problem);
  EXPECT_EQ(error.code, ErrorCode::kFailed);
  EXPECT_NE(error.message.find("cannot be solved"), std::string::npos) << error.message;
}

TEST(PointEliminationTest, RefusesAStartThatIsNotFinite) {
  BundleProblem problem = MakeProblem(MakeSyntheticWorld(SyntheticOptions{}), 1);
  problem.points[3].z() = std::numeric_limits<double>::quiet_NaN();
  const Error error = ErrorOfElimination(problem);
  EXPECT_EQ(error.code, ErrorCode::kFailed);
  EXPECT_NE(error.message.find("not finite"), std::string::npos) << error.message;
}

TEST(PointEliminationTest, CanBeCancelled) {
  std::stop_source stop;
  stop.request_stop();
  const BundleProblem problem = MakeProblem(MakeSyntheticWorld(SyntheticOptions{}), 1);
  EXPECT_EQ(ErrorOfElimination(problem, stop.get_token()).code, ErrorCode::kCancelled);
}

}  // namespace
}  // namespace rotunda::sfm
