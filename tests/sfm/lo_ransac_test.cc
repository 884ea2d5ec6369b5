#include "sfm/lo_ransac.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "tests/support/two_view_scene.h"

namespace rotunda::sfm {
namespace {

/// A line y = a x + b through points.
struct LineEstimator {
  using Model = Eigen::Vector2d;
  static constexpr size_t kSampleSize = 2;
  std::vector<Eigen::Vector2d> points;
  double max_error = 0.1;
  bool refine = true;

  size_t size() const { return points.size(); }
  void Solve(std::span<const size_t, 2> sample, std::vector<Model>& models) const {
    const Eigen::Vector2d a = points[sample[0]], b = points[sample[1]];
    if (a.x() == b.x()) return;
    const double slope = (b.y() - a.y()) / (b.x() - a.x());
    models.emplace_back(slope, a.y() - slope * a.x());
  }
  double Residual(const Model& m, const Eigen::Vector2d& p) const {
    return std::abs(m[0] * p.x() + m[1] - p.y());
  }
  RansacScore Score(const Model& m, double) const {
    RansacScore score{0, 0};
    for (const Eigen::Vector2d& p : points) {
      const double r = std::min(Residual(m, p), max_error);
      score.cost += r * r;
      score.inliers += r < max_error;
    }
    return score;
  }
  Model Refine(const Model& m) const {
    if (!refine) return m;
    Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    for (const Eigen::Vector2d& p : points) {
      if (Residual(m, p) >= max_error) continue;
      const Eigen::Vector2d row(p.x(), 1);
      normal += row * row.transpose();
      right += row * p.y();
    }
    return normal.ldlt().solve(right);
  }
};

LineEstimator MakeLine(uint64_t seed, size_t inliers, size_t outliers) {
  std::mt19937_64 random(seed);
  LineEstimator line;
  for (size_t i = 0; i < inliers; ++i) {
    const double x = test::Uniform(random, -1, 1);
    line.points.emplace_back(x, 0.7 * x - 0.2 + 0.02 * test::Normal(random));
  }
  for (size_t i = 0; i < outliers; ++i) {
    line.points.emplace_back(test::Uniform(random, -1, 1), test::Uniform(random, -3, 3));
  }
  return line;
}

TEST(LoRansac, FindsTheLineAmongSixtyPercentOutliers) {
  for (uint64_t seed = 0; seed < 50; ++seed) {
    const LineEstimator line = MakeLine(seed, 80, 120);
    const auto result = LoRansac(line, {.seed = seed});
    ASSERT_TRUE(result.has_value());
    EXPECT_NEAR(result->model[0], 0.7, 0.03) << "seed " << seed;
    EXPECT_NEAR(result->model[1], -0.2, 0.02) << "seed " << seed;
    EXPECT_GE(result->score.inliers, 78U);
    EXPECT_EQ(result->score.cost, line.Score(result->model, 1e9).cost);
  }
}

TEST(LoRansac, LocalOptimisationLowersTheCost) {
  double with = 0, without = 0;
  for (uint64_t seed = 0; seed < 30; ++seed) {
    LineEstimator line = MakeLine(seed, 80, 120);
    with += LoRansac(line, {.seed = seed})->score.cost;
    line.refine = false;
    without += LoRansac(line, {.seed = seed})->score.cost;
  }
  EXPECT_LT(with, without);
}

TEST(LoRansac, SameSeedSameResult) {
  const LineEstimator line = MakeLine(1, 50, 50);
  const auto a = LoRansac(line, {.seed = 9}), b = LoRansac(line, {.seed = 9});
  EXPECT_EQ(a->model, b->model);
  EXPECT_EQ(a->iterations, b->iterations);
}

TEST(LoRansac, StopsEarlyOnCleanDataAndAtTheWantedRatioOnNoise) {
  EXPECT_EQ(LoRansac(MakeLine(2, 100, 0), {.min_iterations = 3, .seed = 1})->iterations, 3);
  // 0.5 of inliers with samples of two: log(0.001) / log(1 - 0.25) = 24.01.
  const auto noise = LoRansac(MakeLine(3, 0, 200), {.min_inlier_ratio = 0.5, .seed = 1});
  EXPECT_EQ(noise->iterations, 25);
}

TEST(LoRansac, NeedsAWholeSample) {
  EXPECT_FALSE(LoRansac(MakeLine(4, 1, 0), {}).has_value());
  LineEstimator vertical;
  vertical.points = {{1, 0}, {1, 1}, {1, 2}};
  EXPECT_FALSE(LoRansac(vertical, {.max_iterations = 20}).has_value());
}

TEST(RequiredIterations, FollowsFischlerAndBolles) {
  EXPECT_EQ(RequiredIterations(1.0, 5, 0.999, 1000), 1);
  EXPECT_EQ(RequiredIterations(0.0, 5, 0.999, 1000), 1000);
  EXPECT_EQ(RequiredIterations(0.5, 5, 0.999, 1000), 218);  // log(0.001) / log(1 - 1/32) = 217.6
}

TEST(DrawSample, IsDistinctAndEven) {
  std::mt19937_64 random(12);
  std::array<size_t, 3> sample;
  std::array<int, 6> drawn{};
  constexpr int kDraws = 20000;
  for (int i = 0; i < kDraws; ++i) {
    DrawSample(random, 6, sample);
    ASSERT_TRUE(sample[0] != sample[1] && sample[0] != sample[2] && sample[1] != sample[2]);
    for (size_t index : sample) ++drawn.at(index);
  }
  // Binomial with p = 1/2: five standard deviations are 354.
  for (int count : drawn) EXPECT_NEAR(count, kDraws / 2, 354);
}

}  // namespace
}  // namespace rotunda::sfm
