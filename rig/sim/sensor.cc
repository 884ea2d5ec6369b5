#include "rig/sim/sensor.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "rig/sim/noise.h"
#include "sfm/core/run_context.h"

namespace rotunda::sim {
namespace {

using Eigen::Vector3f;

constexpr float kExposure = 0.72f;  // of StudioRadiance's light: skin comes to lie in the middle
constexpr int kCurveSize = 8192;
constexpr int kNormalBits = 13;

/// Standard normal values by rank: table[bits] for uniform bits is a normal number.
std::vector<float> NormalTable() {
  constexpr int kSize = 1 << kNormalBits;
  std::vector<float> table(kSize);
  // Quantiles by bisection of the error function: the same on every machine to float precision.
  for (int i = 0; i < kSize; ++i) {
    const double probability = (i + 0.5) / kSize;
    double low = -6, high = 6;
    for (int step = 0; step < 50; ++step) {
      const double middle = 0.5 * (low + high);
      (0.5 * std::erfc(-middle / std::sqrt(2.0)) < probability ? low : high) = middle;
    }
    table[i] = static_cast<float>(0.5 * (low + high));
  }
  return table;
}

/// Linear 0..1 in kCurveSize steps to the sRGB curve's 8 bits.
std::vector<uint8_t> CurveTable() {
  std::vector<uint8_t> table(kCurveSize + 1);
  for (int i = 0; i <= kCurveSize; ++i) {
    const double linear = static_cast<double>(i) / kCurveSize;
    const double coded =
        linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
    table[i] = static_cast<uint8_t>(std::lround(255 * coded));
  }
  return table;
}

/// What a pixel takes of the samples of the light in its row or column: entry i of those from
/// `first` on, seen from the pixel's own first sample.
struct PixelWeights {
  int first;
  std::vector<float> weights;
};

/// A sample at distance u from the pixel's middle is a spot of standard deviation s about it, and
/// Phi((1/2 - u) / s) - Phi((-1/2 - u) / s) of its light falls on the pixel.
PixelWeights WeightsOf(double blur_px) {
  constexpr double kReach = 3;  // standard deviations
  const int beyond = static_cast<int>(std::ceil(kReach * blur_px * kLightSamples));
  const double scale = 1 / (std::sqrt(2.0) * std::max(blur_px, 1e-6));
  PixelWeights pixel{-beyond, {}};
  double sum = 0;
  for (int i = -beyond; i < kLightSamples + beyond; ++i) {
    const double u = (i + 0.5) / kLightSamples - 0.5;
    sum += pixel.weights.emplace_back(
        static_cast<float>(std::erf(scale * (0.5 - u)) + std::erf(scale * (0.5 + u))));
  }
  for (float& weight : pixel.weights) weight /= static_cast<float>(sum);
  return pixel;
}

/// The light on each pixel of row y; what lies beyond the picture is like its border.
void GatherRow(const LightImage& light, const PixelWeights& pixel, int y,
               std::vector<Vector3f>* row) {
  const int columns = kLightSamples * light.width, rows = kLightSamples * light.height;
  const int taps = static_cast<int>(pixel.weights.size());
  std::vector<Vector3f> samples(columns, Vector3f::Zero());
  for (int i = 0; i < taps; ++i) {
    const int from = std::clamp(kLightSamples * y + pixel.first + i, 0, rows - 1);
    const Vector3f* line = &light.at(0, from);
    for (int x = 0; x < columns; ++x) samples[x] += pixel.weights[i] * line[x];
  }
  row->assign(light.width, Vector3f::Zero());
  for (int x = 0; x < light.width; ++x) {
    for (int i = 0; i < taps; ++i) {
      const int from = std::clamp(kLightSamples * x + pixel.first + i, 0, columns - 1);
      (*row)[x] += pixel.weights[i] * samples[from];
    }
  }
}

}  // namespace

Picture Expose(const LightImage& light, const RigSensor& sensor, uint64_t seed, uint64_t shot) {
  static const std::vector<float> kNormals = NormalTable();
  static const std::vector<uint8_t> kCurve = CurveTable();
  Random random(seed);
  const double gain = 1 + 0.01 * sensor.gain_spread_percent * random.Normal();
  Vector3f factors;
  for (int c = 0; c < 3; ++c) {
    const double colour = 1 + 0.01 * sensor.colour_spread_percent * random.Normal();
    factors[c] = static_cast<float>(kExposure * gain * colour);
  }
  const uint64_t camera_seed = random.Bits();
  const uint64_t noise_seed = shot == 0 ? camera_seed : DeriveSeed(camera_seed, shot);
  const PixelWeights pixel = WeightsOf(sensor.blur_px);
  std::vector<Vector3f> row;

  Picture picture(light.width, light.height);
  const float full_well = static_cast<float>(sensor.full_well_e);
  const float read = static_cast<float>(sensor.read_noise_e / sensor.full_well_e);
  const float cx = 0.5f * static_cast<float>(light.width);
  const float cy = 0.5f * static_cast<float>(light.height);
  const float fall = static_cast<float>(sensor.vignetting) / (cx * cx + cy * cy);
  for (int y = 0; y < light.height; ++y) {
    GatherRow(light, pixel, y, &row);
    for (int x = 0; x < light.width; ++x) {
      const float dx = static_cast<float>(x) + 0.5f - cx, dy = static_cast<float>(y) + 0.5f - cy;
      const float shade = 1.0f - fall * (dx * dx + dy * dy);
      const uint64_t index = static_cast<uint64_t>(y) * light.width + x;
      uint64_t bits = Hash64(noise_seed + index * 0x9E3779B97F4A7C15ull);
      const Vector3f signal = shade * row[x].cwiseProduct(factors);
      uint8_t* out = picture.at(x, y);
      for (int c = 0; c < 3; ++c) {
        const float normal = kNormals[bits & ((1u << kNormalBits) - 1)];
        bits >>= 20;
        const float electrons = std::min(signal[c], 1.2f);
        const float sigma = std::sqrt(electrons / full_well + read * read);
        const float linear = std::clamp(electrons + sigma * normal, 0.0f, 1.0f);
        out[c] = kCurve[static_cast<int>(linear * kCurveSize + 0.5f)];
      }
    }
  }
  return picture;
}

}  // namespace rotunda::sim
