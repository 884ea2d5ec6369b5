#include "sfm/solver_stop.h"

#include <ceres/ceres.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <stop_token>
#include <utility>

namespace rotunda::sfm {
namespace {

/// Rosenbrock's valley, which takes tens of iterations; counts its evaluations and sets `stop` in
/// the one that `stop_at` says.
class Valley final : public ceres::SizedCostFunction<2, 2> {
 public:
  Valley(std::stop_source stop, int stop_at) : stop_(std::move(stop)), stop_at_(stop_at) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    if (++evaluations_ == stop_at_) stop_.request_stop();
    const double x = parameters[0][0], y = parameters[0][1];
    residuals[0] = 10 * (y - x * x);
    residuals[1] = 1 - x;
    if (jacobians && jacobians[0]) {
      const std::array<double, 4> rows = {-20 * x, 10, -1, 0};
      std::copy(rows.begin(), rows.end(), jacobians[0]);
    }
    return true;
  }

 private:
  mutable std::stop_source stop_;
  mutable int evaluations_ = 0;
  const int stop_at_;
};

constexpr int kNever = 0;

struct Solved {
  std::array<double, 2> x = {-1.2, 1.0};
  ceres::Solver::Summary summary;
};

Solved Solve(int stop_at, bool with_callback) {
  Solved solved;
  std::stop_source stop;
  ceres::Problem problem;
  problem.AddResidualBlock(new Valley(stop, stop_at), nullptr, solved.x.data());
  ceres::Solver::Options options;
  options.logging_type = ceres::SILENT;
  const auto callback = StopBetweenIterations(stop.get_token());
  if (with_callback) options.callbacks.push_back(callback.get());
  ceres::Solve(options, &problem, &solved.summary);
  return solved;
}

TEST(StopBetweenIterations, EndsASolveInTheIterationInWhichItIsAsked) {
  const std::array<double, 2> start = Solved().x;
  const Solved first = Solve(1, true);
  EXPECT_EQ(first.summary.termination_type, ceres::USER_FAILURE);
  EXPECT_EQ(first.summary.iterations.size(), 1u);
  EXPECT_FALSE(first.summary.IsSolutionUsable());
  EXPECT_EQ(first.x, start) << "left as it was";
  const Solved later = Solve(4, true);
  EXPECT_EQ(later.summary.termination_type, ceres::USER_FAILURE);
  EXPECT_LE(later.summary.iterations.size(), 4u);
  EXPECT_EQ(later.x, start);
}

TEST(StopBetweenIterations, ChangesNoBitOfASolveThatIsNotStopped) {
  const Solved without = Solve(kNever, false), with = Solve(kNever, true);
  EXPECT_EQ(with.summary.termination_type, ceres::CONVERGENCE);
  EXPECT_GT(with.summary.iterations.size(), 4u);
  EXPECT_EQ(with.summary.iterations.size(), without.summary.iterations.size());
  EXPECT_EQ(with.x, without.x);
  EXPECT_EQ(with.summary.final_cost, without.summary.final_cost);
}

}  // namespace
}  // namespace rotunda::sfm
