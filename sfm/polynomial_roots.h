#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace rotunda::sfm {

/// Real roots of polynomials of a fixed degree by Sturm's theorem: the number of distinct real
/// roots in (a, b] is the number of sign changes of the Sturm chain at a less that at b. Bisection
/// until an interval holds one root, then Newton steps kept inside the interval.
template <size_t Degree>
class SturmSolver {
 public:
  /// Coefficients by ascending power.
  using Coefficients = std::array<double, Degree + 1>;

  /// Appends the roots in ascending order. Nothing when the leading coefficient vanishes beside the
  /// others or one is not finite.
  static void Solve(const Coefficients& coefficients, std::vector<double>& roots) {
    SturmSolver solver;
    if (!solver.BuildChain(coefficients)) return;
    double bound = 0;  // Cauchy's, of the monic polynomial
    for (size_t i = 0; i < Degree; ++i) bound = std::max(bound, std::abs(solver.chain_[0][i]));
    bound += 1.0;
    const int below = solver.SignChanges(-bound), above = solver.SignChanges(bound);
    solver.Isolate({-bound, bound, below, above}, roots);
  }

 private:
  /// Half-open interval (low, high] with the chain's sign changes at both ends.
  struct Interval {
    double low, high;
    int changes_low, changes_high;
  };

  bool BuildChain(const Coefficients& coefficients) {
    const double lead = coefficients[Degree];
    if (lead == 0.0) return false;
    for (size_t i = 0; i <= Degree; ++i) chain_[0][i] = coefficients[i] / lead;
    for (double c : chain_[0]) {
      if (!std::isfinite(c)) return false;
    }
    for (size_t i = 1; i <= Degree; ++i) {
      chain_[1][i - 1] = chain_[0][i] * static_cast<double>(i) / static_cast<double>(Degree);
    }
    size_ = 2;
    while (size_ <= Degree && AppendRemainder()) ++size_;
    return true;
  }

  /// chain[k] = -(chain[k-2] mod chain[k-1]) up to a positive factor. Member k has degree Degree -
  /// k; false when the remainder vanishes (a multiple root) or its degree drops by more than one.
  bool AppendRemainder() {
    const size_t k = size_, divisor_degree = Degree - k + 1;
    Coefficients remainder = chain_[k - 2];
    const Coefficients& divisor = chain_[k - 1];
    for (size_t step = 0; step < 2; ++step) {
      const size_t top = divisor_degree + 1 - step;
      const double factor = remainder[top] / divisor[divisor_degree];
      for (size_t i = 0; i <= divisor_degree; ++i) {
        remainder[i + top - divisor_degree] -= factor * divisor[i];
      }
    }
    const size_t degree = Degree - k;
    const double scale = std::abs(remainder[degree]);
    if (!(scale > 0)) return false;
    chain_[k].fill(0.0);
    for (size_t i = 0; i <= degree; ++i) chain_[k][i] = -remainder[i] / scale;
    return true;
  }

  double Value(size_t member, double x) const {
    double value = chain_[member][Degree - member];
    for (size_t i = Degree - member; i-- > 0;) value = value * x + chain_[member][i];
    return value;
  }

  int SignChanges(double x) const {
    int changes = 0;
    bool negative = Value(0, x) < 0;
    for (size_t k = 1; k < size_; ++k) {
      const bool next = Value(k, x) < 0;
      changes += next != negative;
      negative = next;
    }
    return changes;
  }

  void Isolate(const Interval& interval, std::vector<double>& roots) const {
    const int count = interval.changes_low - interval.changes_high;
    if (count <= 0) return;
    const double middle = 0.5 * (interval.low + interval.high);
    const bool narrow = interval.high - interval.low <= 1e-12 * std::max(1.0, std::abs(middle));
    if (count == 1 || narrow) {
      roots.push_back(narrow ? middle : Polish(interval.low, interval.high));
      return;
    }
    const int changes = SignChanges(middle);
    Isolate({interval.low, middle, interval.changes_low, changes}, roots);
    Isolate({middle, interval.high, changes, interval.changes_high}, roots);
  }

  double Polish(double low, double high) const {
    constexpr int kMaxSteps = 200;
    const bool rising = Value(0, high) > 0;
    double x = 0.5 * (low + high);
    for (int step = 0; step < kMaxSteps; ++step) {
      const double value = Value(0, x);
      ((value < 0) == rising ? low : high) = x;
      double next = x - value / (static_cast<double>(Degree) * Value(1, x));
      if (!(next > low && next < high)) next = 0.5 * (low + high);
      const double change = std::abs(next - x);
      x = next;
      if (change <= 1e-15 * std::abs(x)) break;
    }
    return x;
  }

  std::array<Coefficients, Degree + 1> chain_{};
  size_t size_ = 0;
};

}  // namespace rotunda::sfm
