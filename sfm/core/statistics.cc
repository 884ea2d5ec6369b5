#include "sfm/core/statistics.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace rotunda {
namespace {

/// Probability that a chi-square variable exceeds `x`. With y = x/2 and Q the upper incomplete
/// gamma function: Q(a + 1, y) = Q(a, y) + y^a e^-y / Gamma(a + 1), from Q(1/2, y) = erfc(sqrt(y))
/// or Q(1, y) = e^-y (Abramowitz and Stegun, 6.5.21, 26.4.4 and 26.4.5).
double ChiSquareTail(int freedom, double x) {
  const double y = 0.5 * x;
  const bool odd = freedom % 2 == 1;
  double tail = odd ? std::erfc(std::sqrt(y)) : std::exp(-y);
  for (double a = odd ? 0.5 : 1.0; a < 0.5 * freedom; a += 1) {
    tail += std::pow(y, a) * std::exp(-y) / std::tgamma(a + 1);
  }
  return tail;
}

}  // namespace

double Median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double ChiSquareLimit(int freedom, double probability) {
  double low = 0, high = 1000;
  for (int i = 0; i < 100; ++i) {
    const double x = 0.5 * (low + high);
    (ChiSquareTail(freedom, x) > probability ? low : high) = x;
  }
  return low;
}

}  // namespace rotunda
