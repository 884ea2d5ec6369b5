#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>

namespace rotunda::sim {

/// Random numbers as a function of (seed, index): no state, so any thread may ask for any of them
/// and the bytes do not depend on the order. The finalizer of SplitMix64 (Steele et al. 2014).
inline uint64_t Hash64(uint64_t value) {
  value += 0x9E3779B97F4A7C15ull;
  value = (value ^ (value >> 30)) * 0xBF58476D1CE4E5B9ull;
  value = (value ^ (value >> 27)) * 0x94D049BB133111EBull;
  return value ^ (value >> 31);
}

/// Numbers of one stream, in order.
class Random {
 public:
  explicit Random(uint64_t seed) : state_(Hash64(seed)) {}
  uint64_t Bits() { return Hash64(state_ += 0xD1342543DE82EF95ull); }
  /// Uniform in [0, 1).
  double Uniform() { return static_cast<double>(Bits() >> 11) * 0x1p-53; }
  double Uniform(double low, double high) { return low + (high - low) * Uniform(); }
  /// Uniform in [0, count).
  int Index(int count) { return static_cast<int>(Uniform() * count); }
  bool Chance(double probability) { return Uniform() < probability; }
  /// Standard normal (Box and Muller 1958).
  double Normal() {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - Uniform()));
    return radius * std::cos(6.283185307179586 * Uniform());
  }

 private:
  uint64_t state_;
};

/// Smooth noise with zero mean, within [-1, 1], one feature a unit of length: trilinear blend with
/// a smooth fade of random values on the integer lattice.
float ValueNoise(const Eigen::Vector3f& x, uint32_t seed);

/// Sum of `octaves` of ValueNoise, each of twice the frequency and half the amplitude; within
/// [-2, 2].
float FractalNoise(const Eigen::Vector3f& x, int octaves, uint32_t seed);

/// Distance (in units of `x`) to a random spot of the lattice cell around x, and that cell's random
/// number in [0, 1): for freckles. Spots keep to the middle of their cell.
struct Spot {
  float distance;
  float random;
};
Spot NearestSpot(const Eigen::Vector3f& x, uint32_t seed);

inline float SmoothStep(float edge0, float edge1, float x) {
  const float t = std::clamp((x - edge0) / (edge1 - edge0), 0.0f, 1.0f);
  return t * t * (3.0f - 2.0f * t);
}

}  // namespace rotunda::sim
