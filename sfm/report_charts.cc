#include "sfm/report_charts.h"

#include <algorithm>
#include <cmath>

#include "sfm/core/html_text.h"
#include "sfm/report_views.h"

namespace rotunda::sfm::report {
namespace {

constexpr double kWidth_px = 1280;
constexpr double kLeft_px = 56;  // room for the scale's figures
constexpr double kPanel_px = 96;
constexpr double kBars_px = 62;  // height of the longest bar

/// Least of the round numbers below, x 10^n, that is at least `value`.
double RoundedUp(double value) {
  const double power = std::pow(10.0, std::floor(std::log10(value)));
  for (const double lead : {1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0}) {
    if (value <= lead * power * (1 + 1e-12)) return lead * power;
  }
  return 10.0 * power;
}

std::string Label(double x, double y, const std::string& css, const std::string& text) {
  return "<text class=\"" + css + "\" x=\"" + Coordinate(x) + "\" y=\"" + Coordinate(y) + "\">" +
         Escaped(text) + "</text>";
}

std::string Rule(double y, const std::string& css) {
  return "<path class=\"" + css + "\" d=\"M" + Coordinate(kLeft_px) + " " + Coordinate(y) + "H" +
         Coordinate(kWidth_px) + "\"/>";
}

/// Shortest text of a round number.
std::string RoundText(double value) {
  std::string text = Fixed(value, 5);
  while (text.ends_with('0')) text.pop_back();
  if (text.ends_with('.')) text.pop_back();
  return text;
}

std::string DrawPanel(const ReportInput& input, const Facts& facts, const Quantity& quantity,
                      double top_px) {
  const double base = top_px + kPanel_px - 8;
  const double scale_max = quantity.max > 0 ? RoundedUp(quantity.max) : 1.0;
  const auto height = [&](double value) { return kBars_px * std::max(value, 0.0) / scale_max; };
  const double pitch = (kWidth_px - kLeft_px) / static_cast<double>(quantity.values.size());
  std::string out =
      Label(kLeft_px, base - kBars_px - 9, "chart-title", quantity.label + ", " + quantity.unit) +
      Rule(base - kBars_px, "grid") + Rule(base, "base") +
      Label(kLeft_px - 6, base - kBars_px + 4, "label end", RoundText(scale_max)) +
      Label(kLeft_px - 6, base + 4, "label end", "0");
  for (size_t i = 0; i < quantity.values.size(); ++i) {
    const double left = kLeft_px + pitch * (static_cast<double>(i) + 0.12);
    const bool missing = !input.poses.cameras[i].registered;
    if (!quantity.values[i] && !missing) continue;
    const double bar = missing ? kBars_px : std::max(height(*quantity.values[i]), 0.6);
    out += CameraLink(input, facts, i) + "<rect" + (missing ? " class=\"absent\"" : "") + " x=\"" +
           Coordinate(left) + "\" y=\"" + Coordinate(base - bar) + "\" width=\"" +
           Coordinate(std::min(pitch * 0.76, 40.0)) + "\" height=\"" + Coordinate(bar) +
           "\"/></a>\n";
  }
  return out + Rule(base - height(quantity.median), "median") + "\n";
}

/// Names below the bars, standing on end; left out when they would not fit.
std::string DrawNames(const PoseSet& poses, double top_px, double* height_px) {
  constexpr double kLetter_px = 5.6, kLeast_pitch_px = 9;
  const double pitch = (kWidth_px - kLeft_px) / static_cast<double>(poses.cameras.size());
  size_t longest = 0;
  for (const CameraPose& pose : poses.cameras) longest = std::max(longest, pose.camera.size());
  *height_px = 6 + kLetter_px * static_cast<double>(longest);
  if (pitch < kLeast_pitch_px || longest > 16) {
    *height_px = 4;
    return {};
  }
  std::string out;
  for (size_t i = 0; i < poses.cameras.size(); ++i) {
    const double x =
        kLeft_px + pitch * (static_cast<double>(i) + 0.12) + std::min(pitch * 0.38, 20.0) + 3;
    const std::string at = Coordinate(x) + " " + Coordinate(top_px + 4);
    out += "<text class=\"bar-name\" transform=\"translate(" + at + ") rotate(-90)\">" +
           Escaped(poses.cameras[i].camera) + "</text>";
  }
  return out + "\n";
}

}  // namespace

std::string DrawBars(const ReportInput& input, const Facts& facts) {
  double y = 0;
  std::string panels;
  for (const Quantity& quantity : facts.quantities) {
    if (!quantity.graded) continue;
    panels += DrawPanel(input, facts, quantity, y);
    y += kPanel_px;
  }
  if (panels.empty()) return {};
  double names_px = 0;
  panels += DrawNames(input.poses, y, &names_px);
  return "<svg class=\"bars\" role=\"img\" aria-label=\"Figures by camera\" viewBox=\"0 0 " +
         Coordinate(kWidth_px) + " " + Coordinate(y + names_px) + "\">\n" + panels + "</svg>";
}

}  // namespace rotunda::sfm::report
