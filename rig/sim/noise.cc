#include "rig/sim/noise.h"

namespace rotunda::sim {
namespace {

inline uint32_t HashLattice(int x, int y, int z, uint32_t seed) {
  uint32_t h = static_cast<uint32_t>(x) * 0x8DA6B343u ^ static_cast<uint32_t>(y) * 0xD8163841u ^
               static_cast<uint32_t>(z) * 0xCB1AB31Fu ^ seed * 0x9E3779B9u;
  h = (h ^ (h >> 15)) * 0x2C1B3C6Du;
  h = (h ^ (h >> 12)) * 0x297A2D39u;
  return h ^ (h >> 15);
}

inline float LatticeValue(int x, int y, int z, uint32_t seed) {
  return static_cast<float>(HashLattice(x, y, z, seed) >> 8) * (2.0f / 16777216.0f) - 1.0f;
}

inline int Floor(float x) {
  const int i = static_cast<int>(x);
  return i - (x < static_cast<float>(i));
}
inline float Fade(float t) { return t * t * (3.0f - 2.0f * t); }
inline float Mix(float a, float b, float t) { return a + (b - a) * t; }

}  // namespace

float ValueNoise(const Eigen::Vector3f& x, uint32_t seed) {
  const int ix = Floor(x.x()), iy = Floor(x.y()), iz = Floor(x.z());
  const float tx = Fade(x.x() - static_cast<float>(ix));
  const float ty = Fade(x.y() - static_cast<float>(iy));
  const float tz = Fade(x.z() - static_cast<float>(iz));
  const auto edge = [&](int dy, int dz) {
    return Mix(LatticeValue(ix, iy + dy, iz + dz, seed),
               LatticeValue(ix + 1, iy + dy, iz + dz, seed), tx);
  };
  return Mix(Mix(edge(0, 0), edge(1, 0), ty), Mix(edge(0, 1), edge(1, 1), ty), tz);
}

float FractalNoise(const Eigen::Vector3f& x, int octaves, uint32_t seed) {
  float sum = 0, amplitude = 1, frequency = 1;
  for (int octave = 0; octave < octaves; ++octave) {
    sum += amplitude * ValueNoise(x * frequency, seed + static_cast<uint32_t>(octave));
    amplitude *= 0.5f;
    frequency *= 2.03f;
  }
  return sum;
}

Spot NearestSpot(const Eigen::Vector3f& x, uint32_t seed) {
  const Eigen::Vector3i i(Floor(x.x()), Floor(x.y()), Floor(x.z()));
  const uint32_t h = HashLattice(i.x(), i.y(), i.z(), seed);
  const auto middle = [&](int shift) {
    return 0.3f + 0.4f * static_cast<float>((h >> shift) & 255u) / 255.0f;
  };
  const Eigen::Vector3f spot = i.cast<float>() + Eigen::Vector3f(middle(0), middle(8), middle(16));
  return {(x - spot).norm(), static_cast<float>(h >> 24) / 256.0f};
}

}  // namespace rotunda::sim
