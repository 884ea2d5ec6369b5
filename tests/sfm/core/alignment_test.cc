#include "sfm/core/alignment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace rotunda {
namespace {

constexpr uint64_t kSeed = 11;

double Uniform(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
}

/// Standard normal (Box-Muller).
double Normal(std::mt19937_64& random) {
  const double radius = std::sqrt(-2.0 * std::log(1.0 - Uniform(random, 0, 1)));
  return radius * std::cos(2.0 * kPi * Uniform(random, 0, 1));
}

std::vector<Eigen::Vector3d> RandomPoints(std::mt19937_64& random, size_t count) {
  std::vector<Eigen::Vector3d> points;
  for (size_t i = 0; i < count; ++i) {
    points.push_back({Uniform(random, -2, 2), Uniform(random, -2, 2), Uniform(random, 0, 2)});
  }
  return points;
}

Sim3 RandomSim3(std::mt19937_64& random, double scale) {
  const Eigen::Vector3d axis =
      Eigen::Vector3d(Normal(random), Normal(random), Normal(random)).normalized();
  return {scale,
          Eigen::Quaterniond(Eigen::AngleAxisd(Uniform(random, -kPi, kPi), axis)),
          {Normal(random), Normal(random), Normal(random)}};
}

std::vector<Eigen::Vector3d> Moved(const Sim3& b_from_a, const std::vector<Eigen::Vector3d>& a) {
  std::vector<Eigen::Vector3d> b;
  for (const Eigen::Vector3d& point : a) b.push_back(b_from_a * point);
  return b;
}

void ExpectNear(const Sim3& a, const Sim3& b, double tolerance) {
  EXPECT_NEAR(a.scale / b.scale, 1.0, tolerance);
  EXPECT_LT(RotationAngle_rad(a.rotation, b.rotation), tolerance);
  EXPECT_LT((a.translation - b.translation).norm(), tolerance * (1.0 + b.scale));
}

double SquaredError(const Sim3& fit, const std::vector<Eigen::Vector3d>& source,
                    const std::vector<Eigen::Vector3d>& target) {
  double sum = 0;
  for (size_t i = 0; i < source.size(); ++i) sum += (fit * source[i] - target[i]).squaredNorm();
  return sum;
}

TEST(FitSim3, FindsTheTruthFromExactPoints) {
  std::mt19937_64 random(kSeed);
  for (const size_t count : {3, 4, 90}) {
    for (const double scale : {0.01, 1.0, 250.0}) {
      const auto source = RandomPoints(random, count);
      const Sim3 truth = RandomSim3(random, scale);
      const auto fit = FitSim3(source, Moved(truth, source), true);
      ASSERT_TRUE(fit.ok()) << fit.error().ToString();
      ExpectNear(*fit, truth, 1e-12);
    }
  }
}

TEST(FitSim3, FlatPointsDoNotMirror) {
  std::mt19937_64 random(kSeed);
  auto source = RandomPoints(random, 12);
  for (Eigen::Vector3d& point : source) point.z() = 0.7;
  const Sim3 truth = RandomSim3(random, 3.0);
  const auto fit = FitSim3(source, Moved(truth, source), true);
  ASSERT_TRUE(fit.ok());
  ExpectNear(*fit, truth, 1e-12);
}

TEST(FitSim3, WithoutScaleItIsARigidMotion) {
  std::mt19937_64 random(kSeed);
  const auto source = RandomPoints(random, 20);
  const Sim3 truth = RandomSim3(random, 1.02);
  const auto fit = FitSim3(source, Moved(truth, source), false);
  ASSERT_TRUE(fit.ok());
  EXPECT_EQ(fit->scale, 1.0);
  EXPECT_LT(RotationAngle_rad(fit->rotation, truth.rotation), 1e-12);
}

TEST(FitSim3, IsTheLeastSquaresOptimum) {
  std::mt19937_64 random(kSeed);
  const auto source = RandomPoints(random, 15);
  auto target = Moved(RandomSim3(random, 2.0), source);
  for (Eigen::Vector3d& point : target) {
    point += 0.1 * Eigen::Vector3d(Normal(random), Normal(random), Normal(random));
  }
  const Sim3 fit = *FitSim3(source, target, true);
  const double least = SquaredError(fit, source, target);
  for (int parameter = 0; parameter < 7; ++parameter) {
    for (const double step : {-1e-4, 1e-4}) {
      Sim3 other = fit;
      if (parameter < 3) {
        const Eigen::Vector3d axis = Eigen::Vector3d::Unit(parameter);
        other.rotation = Eigen::Quaterniond(Eigen::AngleAxisd(step, axis)) * fit.rotation;
      } else if (parameter < 6) {
        other.translation[parameter - 3] += step;
      } else {
        other.scale += step;
      }
      EXPECT_GT(SquaredError(other, source, target), least) << "parameter " << parameter;
    }
  }
}

TEST(FitSim3, RefusesWhatDeterminesNothing) {
  const auto code = [](const std::vector<Eigen::Vector3d>& a,
                       const std::vector<Eigen::Vector3d>& b) {
    const auto fit = FitSim3(a, b, true);
    return fit.ok() ? "ok" : fit.error().message;
  };
  const std::vector<Eigen::Vector3d> triangle = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  const std::vector<Eigen::Vector3d> line = {{0, 0, 0}, {1, 2, 3}, {2, 4, 6}};
  const std::vector<Eigen::Vector3d> point(3, Eigen::Vector3d(1, 1, 1));
  const std::vector<Eigen::Vector3d> infinite = {{0, 0, 0}, {1, 0, 0}, {0, INFINITY, 0}};
  EXPECT_EQ(code(triangle, triangle), "ok");
  EXPECT_EQ(code({{0, 0, 0}, {1, 0, 0}}, {{0, 0, 0}, {1, 0, 0}}),
            "expected at least 3 pairs of points, found 2 and 2");
  EXPECT_EQ(code(triangle, {{0, 0, 0}}), "expected at least 3 pairs of points, found 3 and 1");
  EXPECT_EQ(code(line, triangle), "the points lie on one line");
  EXPECT_EQ(code(triangle, line), "the points lie on one line");
  EXPECT_EQ(code(point, triangle), "the points lie on one line");
  EXPECT_EQ(code(triangle, infinite), "a point's coordinates are not finite numbers");
}

struct Moves {
  size_t points;
  size_t moved;
};

class FitSim3RobustTest : public testing::TestWithParam<Moves> {};

TEST_P(FitSim3RobustTest, MovedPointsStandOutAndDoNotBend) {
  constexpr double kNoise = 0.001;
  std::mt19937_64 random(kSeed);
  const auto [count, moved] = GetParam();
  const auto source = RandomPoints(random, count);
  const Sim3 truth = RandomSim3(random, 0.4);
  auto target = Moved(truth, source);
  std::vector<Eigen::Vector3d> kept_source, kept_target;
  for (size_t i = 0; i < count; ++i) {
    target[i] += kNoise * Eigen::Vector3d(Normal(random), Normal(random), Normal(random));
    if (i < moved) {
      target[i] += Eigen::Vector3d(0.05 + 0.01 * static_cast<double>(i), 0, 0);
    } else {
      kept_source.push_back(source[i]);
      kept_target.push_back(target[i]);
    }
  }
  const auto fit = FitSim3Robust(source, target, kSeed);
  ASSERT_TRUE(fit.ok()) << fit.error().ToString();
  for (size_t i = 0; i < count; ++i) EXPECT_EQ(fit->inliers[i], i >= moved) << "point " << i;
  ExpectNear(fit->target_from_source, *FitSim3(kept_source, kept_target, true), 1e-12);
  EXPECT_GT(fit->sigma, 0.5 * kNoise);
  EXPECT_LT(fit->sigma, 4.0 * kNoise);
}

INSTANTIATE_TEST_SUITE_P(Sizes, FitSim3RobustTest,
                         testing::Values(Moves{8, 1}, Moves{12, 3}, Moves{90, 0}, Moves{90, 30}),
                         [](const auto& info) {
                           return std::to_string(info.param.points) + "points" +
                                  std::to_string(info.param.moved) + "moved";
                         });

TEST(FitSim3Robust, ExactPointsAreAllInliers) {
  std::mt19937_64 random(kSeed);
  const auto source = RandomPoints(random, 10);
  const Sim3 truth = RandomSim3(random, 2.0);
  const auto fit = FitSim3Robust(source, Moved(truth, source), kSeed);
  ASSERT_TRUE(fit.ok());
  EXPECT_EQ(std::count(fit->inliers.begin(), fit->inliers.end(), true), 10);
  ExpectNear(fit->target_from_source, truth, 1e-12);
}

TEST(FitSim3Robust, SameSeedSameBits) {
  std::mt19937_64 random(kSeed);
  const auto source = RandomPoints(random, 40);
  auto target = Moved(RandomSim3(random, 2.0), source);
  for (Eigen::Vector3d& point : target) point.x() += 0.01 * Normal(random);
  const auto a = FitSim3Robust(source, target, 5);
  const auto b = FitSim3Robust(source, target, 5);
  EXPECT_EQ(a->target_from_source.scale, b->target_from_source.scale);
  EXPECT_EQ(a->target_from_source.translation, b->target_from_source.translation);
  EXPECT_EQ(a->inliers, b->inliers);
}

TEST(FitSim3Robust, RefusesPointsOnALine) {
  std::vector<Eigen::Vector3d> line;
  for (int i = 0; i < 9; ++i) line.push_back({1.0 * i, 2.0 * i, 3.0});
  EXPECT_EQ(FitSim3Robust(line, line, 1).error().code, ErrorCode::kInvalidArgument);
}

}  // namespace
}  // namespace rotunda
