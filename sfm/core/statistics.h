#pragma once

#include <vector>

namespace rotunda {

/// Standard deviation of normally distributed errors over their median absolute value:
/// 1 / Phi^-1(3/4).
inline constexpr double kSigmaFromMedian = 1.4826;

/// The middle value, of an even number the upper one of the middle two; 0 when there is none.
double Median(std::vector<double> values);

/// The value that a chi-square variable exceeds with this probability.
double ChiSquareLimit(int freedom, double probability);

}  // namespace rotunda
