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

/// Separable, three taps of the variance asked for.
void Blur(float sigma_px, LightImage* image) {
  const float side = 0.5f * sigma_px * sigma_px;
  if (side <= 0) return;
  const float middle = 1.0f - 2.0f * side;
  std::vector<Vector3f> row(image->width);
  for (int y = 0; y < image->height; ++y) {
    Vector3f* pixels = &image->at(0, y);
    row.assign(pixels, pixels + image->width);
    for (int x = 1; x + 1 < image->width; ++x) {
      pixels[x] = middle * row[x] + side * (row[x - 1] + row[x + 1]);
    }
  }
  std::vector<Vector3f> above(image->width), here(image->width);
  above.assign(&image->at(0, 0), &image->at(0, 0) + image->width);
  for (int y = 1; y + 1 < image->height; ++y) {
    Vector3f* pixels = &image->at(0, y);
    const Vector3f* below = &image->at(0, y + 1);
    here.assign(pixels, pixels + image->width);
    for (int x = 0; x < image->width; ++x) {
      pixels[x] = middle * here[x] + side * (above[x] + below[x]);
    }
    std::swap(above, here);
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
  LightImage blurred = light;
  Blur(static_cast<float>(sensor.blur_px), &blurred);

  Picture picture(light.width, light.height);
  const float full_well = static_cast<float>(sensor.full_well_e);
  const float read = static_cast<float>(sensor.read_noise_e / sensor.full_well_e);
  const float cx = 0.5f * static_cast<float>(light.width);
  const float cy = 0.5f * static_cast<float>(light.height);
  const float fall = static_cast<float>(sensor.vignetting) / (cx * cx + cy * cy);
  for (int y = 0; y < light.height; ++y) {
    for (int x = 0; x < light.width; ++x) {
      const float dx = static_cast<float>(x) + 0.5f - cx, dy = static_cast<float>(y) + 0.5f - cy;
      const float shade = 1.0f - fall * (dx * dx + dy * dy);
      const uint64_t index = static_cast<uint64_t>(y) * light.width + x;
      uint64_t bits = Hash64(noise_seed + index * 0x9E3779B97F4A7C15ull);
      const Vector3f signal = shade * blurred.at(x, y).cwiseProduct(factors);
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
