#include "sfm/core/statistics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace rotunda {
namespace {

TEST(Median, IsTheMiddleValueInOrder) {
  EXPECT_EQ(Median({}), 0.0);
  EXPECT_EQ(Median({-2.0}), -2.0);
  EXPECT_EQ(Median({3.0, 1.0}), 3.0);  // the upper one
  EXPECT_EQ(Median({5.0, 1.0, 3.0}), 3.0);
  EXPECT_EQ(Median({4.0, 1.0, 3.0, 2.0}), 3.0);
  EXPECT_EQ(Median({1.0, INFINITY, INFINITY}), INFINITY);
}

TEST(ChiSquareLimit, IsThatOfTheTables) {
  // Abramowitz and Stegun, table 26.8.
  EXPECT_NEAR(ChiSquareLimit(1, 0.05), 3.84146, 5e-6);
  EXPECT_NEAR(ChiSquareLimit(2, 0.01), 9.21034, 5e-6);
  EXPECT_NEAR(ChiSquareLimit(6, 0.5), 5.34812, 5e-6);
  EXPECT_NEAR(ChiSquareLimit(10, 0.001), 29.5883, 5e-5);
}

TEST(SigmaFromMedian, FindsTheSpreadOfNormalErrorsAmongOutliers) {
  constexpr int kSeed = 3;
  RecordProperty("seed", kSeed);
  std::mt19937_64 random(kSeed);
  std::normal_distribution<double> normal(0.0, 0.2);
  std::vector<double> sizes;
  for (int i = 0; i < 100000; ++i) sizes.push_back(std::abs(normal(random)));
  // Of n values the median's own relative error is 1.17 / sqrt(n): 0.4 %.
  EXPECT_NEAR(kSigmaFromMedian * Median(sizes), 0.2, 3 * 0.004 * 0.2);
  for (int i = 0; i < 1000; ++i) sizes.push_back(1e6);
  EXPECT_NEAR(kSigmaFromMedian * Median(sizes), 0.2, 0.02 * 0.2);
}

}  // namespace
}  // namespace rotunda
