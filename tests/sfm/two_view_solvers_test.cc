#include "sfm/two_view_solvers.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>

#include "sfm/epipolar.h"
#include "sfm/polynomial_roots.h"
#include "tests/support/two_view_scene.h"

namespace rotunda::sfm {
namespace {

using test::Uniform;

/// Exact correspondences of a random pair of cameras, with the truth.
struct Problem {
  Rigid3 second_from_first;
  std::vector<Correspondence> data;

  Eigen::Matrix3d Essential() const { return EssentialFromPose(second_from_first).normalized(); }
};

/// `depth_spread` 0: all points on one plane.
Problem MakeProblem(std::mt19937_64& random, size_t points, double depth_spread) {
  const auto symmetric = [&](double bound) { return Uniform(random, -bound, bound); };
  Problem problem;
  problem.second_from_first.rotation =
      Eigen::Quaterniond(1, symmetric(0.4), symmetric(0.4), symmetric(0.4)).normalized();
  problem.second_from_first.translation =
      Eigen::Vector3d(symmetric(1), symmetric(1), symmetric(1)).normalized();
  const Eigen::Vector2d slope(symmetric(0.3), symmetric(0.3));
  while (problem.data.size() < points) {
    Eigen::Vector3d x(symmetric(2), symmetric(2), 5);
    x.z() += slope.dot(x.head<2>()) + symmetric(1) * depth_spread;
    const Eigen::Vector3d y = problem.second_from_first * x;
    if (y.z() > 0.5) problem.data.push_back({x.hnormalized(), y.hnormalized()});
  }
  return problem;
}

/// Distance of the nearest solution; a matrix's sign means nothing.
double NearestSolution(const std::vector<Eigen::Matrix3d>& solutions,
                       const Eigen::Matrix3d& truth) {
  double nearest = 2;
  for (const Eigen::Matrix3d& s : solutions) {
    nearest = std::min({nearest, (s - truth).norm(), (s + truth).norm()});
  }
  return nearest;
}

double Quantile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values[static_cast<size_t>(share * static_cast<double>(values.size() - 1))];
}

TEST(SturmSolver, FindsTheRootsThatThePolynomialWasMadeOf) {
  std::mt19937_64 random(11);
  for (int trial = 0; trial < 200; ++trial) {
    // Four real roots at least 0.05 apart and three pairs of complex ones.
    std::vector<double> truth;
    while (truth.size() < 4) {
      const double root = Uniform(random, -3, 3);
      const bool apart = std::all_of(truth.begin(), truth.end(),
                                     [&](double other) { return std::abs(other - root) > 0.05; });
      if (apart) truth.push_back(root);
    }
    std::sort(truth.begin(), truth.end());
    std::vector<double> coefficients = {2.5};
    const auto multiply = [&](const std::vector<double>& factor) {
      std::vector<double> product(coefficients.size() + factor.size() - 1, 0.0);
      for (size_t i = 0; i < coefficients.size(); ++i) {
        for (size_t j = 0; j < factor.size(); ++j) product[i + j] += coefficients[i] * factor[j];
      }
      coefficients = product;
    };
    for (double root : truth) multiply({-root, 1});
    for (int pair = 0; pair < 3; ++pair) {
      const double re = Uniform(random, -2, 2), im = Uniform(random, 0.3, 2);
      multiply({re * re + im * im, -2 * re, 1});
    }
    SturmSolver<10>::Coefficients fixed;
    std::copy(coefficients.begin(), coefficients.end(), fixed.begin());
    std::vector<double> roots;
    SturmSolver<10>::Solve(fixed, roots);
    ASSERT_EQ(roots.size(), truth.size()) << "trial " << trial;
    for (size_t i = 0; i < 4; ++i) EXPECT_NEAR(roots[i], truth[i], 1e-7) << "trial " << trial;
  }
}

TEST(SturmSolver, GivesNothingWithoutRealRootsOrLeadingCoefficient) {
  std::vector<double> roots;
  SturmSolver<2>::Solve({1, 0, 1}, roots);
  EXPECT_TRUE(roots.empty());
  SturmSolver<2>::Solve({1, 1, 0}, roots);
  EXPECT_TRUE(roots.empty());
  SturmSolver<2>::Solve({1, std::nan(""), 1}, roots);
  EXPECT_TRUE(roots.empty());
}

class FivePoint : public testing::TestWithParam<double> {};

// The polynomial of degree ten is badly conditioned for a few samples in a thousand (two solutions
// near to each other): there the truth is met less exactly or missed, which RANSAC does not mind.
TEST_P(FivePoint, FindsTheTrueEssentialMatrix) {
  std::mt19937_64 random(5);
  std::vector<double> errors;
  std::vector<Eigen::Matrix3d> solutions;
  for (int trial = 0; trial < 1000; ++trial) {
    const Problem problem = MakeProblem(random, 5, GetParam());
    std::array<Correspondence, 5> sample;
    std::copy_n(problem.data.begin(), 5, sample.begin());
    SolveFivePoint(sample, solutions);
    EXPECT_LE(solutions.size(), 10U);
    errors.push_back(NearestSolution(solutions, problem.Essential()));
  }
  EXPECT_LT(Quantile(errors, 0.5), 1e-12);
  EXPECT_LT(Quantile(errors, 0.99), 1e-6);
}
INSTANTIATE_TEST_SUITE_P(DepthSpread, FivePoint, testing::Values(2.0, 0.02, 0.0));

TEST(FivePoint, SolutionsAreEssentialMatricesThroughTheSample) {
  std::mt19937_64 random(6);
  std::vector<double> epipolar, determinants, traces;
  std::vector<Eigen::Matrix3d> solutions;
  for (int trial = 0; trial < 300; ++trial) {
    const Problem problem = MakeProblem(random, 5, 2.0);
    std::array<Correspondence, 5> sample;
    std::copy_n(problem.data.begin(), 5, sample.begin());
    SolveFivePoint(sample, solutions);
    for (const Eigen::Matrix3d& e : solutions) {
      EXPECT_NEAR(e.norm(), 1.0, 1e-12);
      for (const Correspondence& c : sample) {
        epipolar.push_back(std::abs(c.second.homogeneous().dot(e * c.first.homogeneous())));
      }
      determinants.push_back(std::abs(e.determinant()));
      const Eigen::Matrix3d gram = e * e.transpose();
      traces.push_back((2 * gram * e - gram.trace() * e).norm());
    }
  }
  EXPECT_LT(Quantile(epipolar, 1.0), 1e-10);  // exact by construction: E lies in the null space
  EXPECT_LT(Quantile(determinants, 0.99), 1e-6);
  EXPECT_LT(Quantile(traces, 0.99), 1e-6);
}

TEST(SevenPoint, FindsTheTrueFundamentalMatrix) {
  std::mt19937_64 random(7);
  std::vector<double> errors;
  std::vector<Eigen::Matrix3d> solutions;
  for (int trial = 0; trial < 1000; ++trial) {
    const Problem problem = MakeProblem(random, 7, 2.0);
    std::array<Correspondence, 7> sample;
    std::copy_n(problem.data.begin(), 7, sample.begin());
    SolveSevenPoint(sample, solutions);
    ASSERT_LE(solutions.size(), 3U);
    errors.push_back(NearestSolution(solutions, problem.Essential()));
    for (const Eigen::Matrix3d& f : solutions) EXPECT_NEAR(f.determinant(), 0.0, 1e-9);
  }
  EXPECT_LT(Quantile(errors, 0.5), 1e-11);
  EXPECT_LT(Quantile(errors, 0.99), 1e-6);
}

TEST(FitFundamental, IsExactOnExactDataAndNeedsEight) {
  std::mt19937_64 random(8);
  const Problem problem = MakeProblem(random, 30, 2.0);
  const std::vector<double> weights(30, 1.0);
  const auto fitted = FitFundamental(problem.data, weights);
  ASSERT_TRUE(fitted.has_value());
  EXPECT_LT(NearestSolution({*fitted}, problem.Essential()), 1e-8);
  EXPECT_NEAR(fitted->determinant(), 0.0, 1e-12);
  EXPECT_FALSE(FitFundamental(std::span(problem.data).first(7), weights).has_value());
}

TEST(FitFundamental, HeedsWeights) {
  std::mt19937_64 random(9);
  Problem problem = MakeProblem(random, 40, 2.0);
  std::vector<double> weights(40, 1.0);
  for (size_t i = 0; i < 10; ++i) {
    problem.data[i].second.x() += Uniform(random, 0.1, 0.2);
    weights[i] = 0.0;
  }
  EXPECT_LT(NearestSolution({*FitFundamental(problem.data, weights)}, problem.Essential()), 1e-8);
}

TEST(FitHomography, IsThePlanesHomography) {
  std::mt19937_64 random(10);
  for (size_t points : {4, 5, 40}) {
    const Problem problem = MakeProblem(random, points, 0.0);
    const auto homography = FitHomography(problem.data);
    ASSERT_TRUE(homography.has_value());
    for (const Correspondence& c : problem.data) {
      const Eigen::Vector2d mapped = (*homography * c.first.homogeneous()).hnormalized();
      EXPECT_NEAR((mapped - c.second).norm(), 0.0, 1e-8);
    }
  }
}

TEST(FitHomography, RefusesThreePointsOnALine) {
  const std::vector<Correspondence> data = {{{0, 0}, {0.1, 0}},
                                            {{0.1, 0.1}, {0.2, 0.1}},
                                            {{0.2, 0.2}, {0.3, 0.2}},
                                            {{0.5, 0.1}, {0.6, 0.1}}};
  EXPECT_FALSE(FitHomography(data).has_value());
  EXPECT_FALSE(FitHomography(std::span(data).first(3)).has_value());
}

}  // namespace
}  // namespace rotunda::sfm
