#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "rig/sim/garment.h"
#include "rig/sim/noise.h"

namespace rotunda::sim {
namespace {

// What a designer chooses once for a garment.
struct Style {
  std::array<cv::Scalar, 6> inks;
  cv::Scalar shirt, trousers;
  double print_scale = 1;  // factor on the size of what is printed
  double density = 1;      // factor on how much
  double weave = 1;        // contrast of the cloth itself
  double mottle = 1;
};

// Chance that a seed's cloth is plain, with few prints.
constexpr double kPlainChance = 0.15;

cv::Scalar ColourOf(double hue, double saturation, double value) {
  const auto channel = [&](double offset) {
    const double k = std::fmod(offset + hue * 6.0, 6.0);
    return 255.0 * value * (1.0 - saturation * std::clamp(std::min(k, 4.0 - k), 0.0, 1.0));
  };
  return {channel(5), channel(3), channel(1)};
}

Style DrawStyle(uint64_t seed) {
  Random random(seed);
  Style style;
  const double hue = random.Uniform();
  const bool dark = random.Chance(0.5);
  // Draws one after the other: the order in which arguments are evaluated is the compiler's.
  const auto colour = [&](double from, double to, double value, double any_hue) {
    const double saturation = random.Uniform(from, to);
    return ColourOf(any_hue, saturation, value);
  };
  style.shirt = colour(0.15, 0.55, dark ? 0.42 : 0.78, hue);
  const double other_hue = std::fmod(hue + random.Uniform(0.3, 0.7), 1.0);
  const double trousers_value = random.Uniform(0.35, 0.6);
  style.trousers = colour(0.1, 0.4, trousers_value, other_hue);
  for (size_t i = 0; i < style.inks.size(); ++i) {
    const bool light = (i % 2 == 0) == dark;
    const double value = light ? random.Uniform(0.75, 0.95) : random.Uniform(0.12, 0.5);
    const double ink_hue = random.Uniform();
    style.inks[i] = colour(0.1, 0.8, value, ink_hue);
  }
  style.print_scale = random.Uniform(0.8, 1.4);
  style.density = random.Uniform(0.7, 1.3);
  style.weave = random.Uniform(0.7, 1.2);
  style.mottle = random.Uniform(0.7, 1.2);
  if (random.Chance(kPlainChance)) style.density *= 0.12;
  return style;
}

/// Draws shapes on the panel; lengths in metres, on texels with OpenCV's 4 bits of subpixel.
class Printer {
 public:
  Printer(cv::Mat* cloth, const Style& style, uint64_t seed)
      : cloth_(*cloth), style_(style), random_(seed) {}

  void PrintAll() {
    const double area =
        style_.density * kPanelWidth_m * kPanelHeight_m / (style_.print_scale * style_.print_scale);
    const auto times = [&](double per_m2) { return static_cast<int>(area * per_m2); };
    for (int i = times(14); i > 0; --i) Blob(Size(0.05, 0.13));
    for (int i = times(26); i > 0; --i) Flower(Size(0.02, 0.055));
    for (int i = times(45); i > 0; --i) Rings(Size(0.012, 0.035));
    for (int i = times(60); i > 0; --i) Polygon(Size(0.008, 0.03));
    for (int i = times(40); i > 0; --i) Stroke(Size(0.03, 0.10));
    for (int i = times(55); i > 0; --i) Letters(Size(0.010, 0.032));
    for (int i = times(500); i > 0; --i) Dot(Size(0.0018, 0.006));
  }

 private:
  static constexpr int kShift = 4;

  double Size(double low, double high) {
    return style_.print_scale * low * std::pow(high / low, random_.Uniform());
  }
  cv::Scalar Ink() { return style_.inks[random_.Index(static_cast<int>(style_.inks.size()))]; }
  cv::Point2d Place() {
    return {random_.Uniform(0, cloth_.cols / kTexelsPerMetre),
            random_.Uniform(0, cloth_.rows / kTexelsPerMetre)};
  }
  static cv::Point Fixed(const cv::Point2d& p) {
    const double k = kTexelsPerMetre * (1 << kShift);
    return {static_cast<int>(std::lround(p.x * k)), static_cast<int>(std::lround(p.y * k))};
  }
  static cv::Point2d Polar(double angle, double radius) {
    return {radius * std::cos(angle), radius * std::sin(angle)};
  }
  static int Thickness(double width_m) {
    return std::max(1, static_cast<int>(std::lround(width_m * kTexelsPerMetre)));
  }

  void Fill(const std::vector<cv::Point>& outline, const cv::Scalar& ink) {
    cv::fillPoly(cloth_, std::vector<std::vector<cv::Point>>{outline}, ink, cv::LINE_AA, kShift);
  }
  void Disc(const cv::Point2d& centre, double radius_m, const cv::Scalar& ink) {
    cv::circle(cloth_, Fixed(centre), static_cast<int>(radius_m * kTexelsPerMetre * (1 << kShift)),
               ink, cv::FILLED, cv::LINE_AA, kShift);
  }
  std::vector<cv::Point> Closed(const cv::Point2d& centre, double size, int lobes, double depth) {
    const double phase = random_.Uniform(0, 6.28);
    const double skew = random_.Uniform(-0.3, 0.3);
    std::vector<cv::Point> outline;
    for (int i = 0; i < 48; ++i) {
      const double angle = 6.283185307 * i / 48;
      const double radius = size * (1 + depth * std::cos(lobes * angle + phase) +
                                    skew * std::cos(angle) + 0.5 * depth * std::sin(2 * angle));
      outline.push_back(Fixed(centre + Polar(angle, 0.6 * radius)));
    }
    return outline;
  }

  void Blob(double size) {
    const cv::Point2d centre = Place();
    const int lobes = 2 + random_.Index(4);
    const cv::Scalar ink = Ink();
    const double depth = random_.Uniform(0.1, 0.35);
    Fill(Closed(centre, size, lobes, depth), ink);
    if (!random_.Chance(0.6)) return;
    const cv::Scalar inner = Ink();
    Fill(Closed(centre, 0.6 * size, lobes, 0.25), inner);
  }
  void Flower(double size) {
    const cv::Point2d centre = Place();
    const int petals = 4 + random_.Index(5);
    const double phase = random_.Uniform(0, 6.28);
    const cv::Scalar ink = Ink(), vein = Ink();
    for (int i = 0; i < petals; ++i) {
      const double angle = phase + 6.283185307 * i / petals;
      std::vector<cv::Point> petal;
      for (int k = 0; k < 20; ++k) {
        const double t = 6.283185307 * k / 20;
        const cv::Point2d local(0.55 * size * (1 + std::cos(t)), 0.26 * size * std::sin(t));
        petal.push_back(
            Fixed(centre + cv::Point2d(std::cos(angle) * local.x - std::sin(angle) * local.y,
                                       std::sin(angle) * local.x + std::cos(angle) * local.y)));
      }
      Fill(petal, ink);
      cv::line(cloth_, Fixed(centre), Fixed(centre + Polar(angle, 0.8 * size)), vein,
               Thickness(0.0012), cv::LINE_AA, kShift);
    }
    Disc(centre, 0.22 * size, Ink());
    Disc(centre, 0.10 * size, Ink());
  }
  void Rings(double size) {
    const cv::Point2d centre = Place();
    const int rings = 2 + random_.Index(3);
    for (int i = rings; i > 0; --i) Disc(centre, 0.5 * size * i / rings, Ink());
  }
  void Polygon(double size) {
    const cv::Point2d centre = Place();
    const int corners = 3 + random_.Index(4);
    std::vector<cv::Point> outline;
    const double phase = random_.Uniform(0, 6.28);
    for (int i = 0; i < corners; ++i) {
      const double angle = phase + 6.283185307 * (i + random_.Uniform(-0.25, 0.25)) / corners;
      outline.push_back(Fixed(centre + Polar(angle, 0.5 * size * random_.Uniform(0.6, 1.2))));
    }
    Fill(outline, Ink());
  }
  void Stroke(double length) {
    cv::Point2d at = Place();
    double angle = random_.Uniform(0, 6.28), turn = random_.Uniform(-0.25, 0.25);
    const int width = Thickness(length * random_.Uniform(0.02, 0.08));
    const cv::Scalar ink = Ink();
    for (int i = 0; i < 16; ++i) {
      const cv::Point2d next = at + Polar(angle, length / 10);
      cv::line(cloth_, Fixed(at), Fixed(next), ink, width, cv::LINE_AA, kShift);
      at = next;
      angle += turn + random_.Uniform(-0.12, 0.12);
    }
  }
  void Letters(double height) {
    static constexpr char kAlphabet[] = "ABCDEFGHJKLMNPRSTUVXYZ0123456789&%?";
    std::string word;
    for (int i = 1 + random_.Index(5); i >= 0; --i) {
      word += kAlphabet[random_.Index(static_cast<int>(sizeof(kAlphabet)) - 1)];
    }
    const cv::Point2d at = Place();
    const int fonts[] = {cv::FONT_HERSHEY_SIMPLEX, cv::FONT_HERSHEY_DUPLEX,
                         cv::FONT_HERSHEY_TRIPLEX, cv::FONT_HERSHEY_SCRIPT_COMPLEX};
    const int font = fonts[random_.Index(4)];
    const cv::Point corner(static_cast<int>(at.x * kTexelsPerMetre),
                           static_cast<int>(at.y * kTexelsPerMetre));
    cv::putText(cloth_, word, corner, font, height * kTexelsPerMetre / 22.0, Ink(),
                Thickness(0.12 * height), cv::LINE_AA);
  }
  void Dot(double size) { Disc(Place(), 0.5 * size, Ink()); }

  cv::Mat& cloth_;
  const Style& style_;
  Random random_;
};

/// Dye that took unevenly, yarn of uneven thickness, and the weave's grain.
void Weave(const Style& style, uint32_t seed, cv::Mat* cloth) {
  for (int y = 0; y < cloth->rows; ++y) {
    uint8_t* row = cloth->ptr<uint8_t>(y);
    const float v = static_cast<float>(y) / kTexelsPerMetre;
    for (int x = 0; x < cloth->cols; ++x) {
      const float u = static_cast<float>(x) / kTexelsPerMetre;
      const float slub = ValueNoise({u * 60, v * 700, 0.5f}, seed + 1) +
                         ValueNoise({u * 700, v * 60, 0.5f}, seed + 2);
      const float grain = ValueNoise({u * 330, v * 330, 0.5f}, seed + 3);
      const float patch = FractalNoise({u * 28, v * 28, 0.5f}, 3, seed + 4);
      const float factor = 1.0f +
                           static_cast<float>(style.weave) * (0.045f * slub + 0.075f * grain) +
                           static_cast<float>(style.mottle) * 0.055f * patch;
      for (int c = 0; c < 3; ++c) {
        row[3 * x + c] = cv::saturate_cast<uint8_t>(static_cast<float>(row[3 * x + c]) * factor);
      }
    }
  }
}

Picture ToPicture(const cv::Mat& rgb) {
  Picture picture(rgb.cols, rgb.rows);
  for (int y = 0; y < rgb.rows; ++y) {
    std::copy_n(rgb.ptr<uint8_t>(y), static_cast<size_t>(rgb.cols) * 3, picture.at(0, y));
  }
  return picture;
}

}  // namespace

Picture DrawPanel(uint64_t style_seed, uint64_t design, float hem_z_m) {
  const Style style = DrawStyle(style_seed);
  cv::Mat cloth(static_cast<int>(kPanelHeight_m * kTexelsPerMetre),
                static_cast<int>(kPanelWidth_m * kTexelsPerMetre), CV_8UC3, style.shirt);
  const int hem = static_cast<int>((kPanelHeight_m - hem_z_m) * kTexelsPerMetre);
  cloth.rowRange(hem, cloth.rows).setTo(style.trousers);
  Printer(&cloth, style, design).PrintAll();
  Weave(style, static_cast<uint32_t>(design), &cloth);
  return ToPicture(cloth);
}

Picture DrawPlaid(uint64_t style_seed) {
  const Style style = DrawStyle(style_seed);
  constexpr int kSize = 256;
  Random random(style_seed + 1);
  std::array<double, 12> bands;  // place and width, as fractions of the period
  for (size_t i = 0; i < bands.size(); i += 2) {
    bands[i] = random.Uniform();
    bands[i + 1] = random.Uniform(0.02, 0.12);
  }
  cv::Mat cloth(kSize, kSize, CV_8UC3, style.shirt);
  const auto thread = [&](int i) {
    cv::Vec3d colour(style.shirt[0], style.shirt[1], style.shirt[2]);
    for (size_t band = 0; band < bands.size(); band += 2) {
      const double at = std::fmod((i + 0.5) / kSize - bands[band] + 1.0, 1.0);
      const cv::Scalar& ink = style.inks[band / 2];
      if (at < bands[band + 1]) colour = {ink[0], ink[1], ink[2]};
    }
    return colour;
  };
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      const cv::Vec3d mixed = 0.5 * (thread(x) + thread(y));
      const double twill = (x + y) / 2 % 4 < 2 ? 1.05 : 0.95;
      for (int c = 0; c < 3; ++c) {
        cloth.at<cv::Vec3b>(y, x)[c] = cv::saturate_cast<uint8_t>(mixed[c] * twill);
      }
    }
  }
  return ToPicture(cloth);
}

}  // namespace rotunda::sim
