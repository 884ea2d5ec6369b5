#include "sfm/presets.h"

#include <cmath>
#include <cstdlib>
#include <functional>
#include <map>

namespace rotunda::sfm {
namespace {

using Setter = std::function<bool(std::string_view, PipelineOptions&)>;

/// A field that is one of two readings.
template <typename T>
Setter Choice(T& (*field)(PipelineOptions&), T on, T off) {
  return [=](std::string_view value, PipelineOptions& options) {
    if (value != "on" && value != "off") return false;
    field(options) = value == "on" ? on : off;
    return true;
  };
}

Setter Switch(bool& (*field)(PipelineOptions&)) { return Choice<bool>(field, true, false); }

Setter Number(double& (*field)(PipelineOptions&)) {
  return [field](std::string_view value, PipelineOptions& options) {
    const std::string text(value);
    char* end = nullptr;
    const double number = std::strtod(text.c_str(), &end);
    if (text.empty() || *end != '\0' || !std::isfinite(number)) return false;
    field(options) = number;
    return true;
  };
}

const std::map<std::string, Setter, std::less<>>& Setters() {
  using O = PipelineOptions;
  static const std::map<std::string, Setter, std::less<>> setters = {
      {"consistent-view-graph",
       Switch([](O& o) -> bool& { return o.tc_sfm.consistent_view_graph; })},
      {"unfolding", Switch([](O& o) -> bool& { return o.tc_sfm.unfolding; })},
      {"obstacles", Switch([](O& o) -> bool& { return o.tc_sfm.covisibility.obstacles; })},
      {"bidirectional", Switch([](O& o) -> bool& { return o.tc_sfm.merging.bidirectional; })},
      {"reprojection-weight",
       Number([](O& o) -> double& { return o.tc_sfm.merging.reprojection_weight; })},
      {"literal-weighted-track-graph",
       Switch([](O& o) -> bool& { return o.literal.track_graph.weighted; })},
      {"literal-rejected-undecided",
       Choice<bool>([](O& o) -> bool& { return o.literal.correction.undecided_is_consistent; },
                    false, true)},
      {"literal-center-angle",
       Choice<PlaceDistance>(
           [](O& o) -> PlaceDistance& { return o.literal.correction.place_distance; },
           PlaceDistance::kCenterAngle, PlaceDistance::kTranslationAngle)},
      {"literal-strongest-link-next",
       Choice<NextImage>([](O& o) -> NextImage& { return o.literal.correction.next; },
                         NextImage::kStrongestLink, NextImage::kMostPrimaryPoints)},
      {"literal-mean-cost", Switch([](O& o) -> bool& { return o.literal.merging.mean_cost; })},
      {"literal-reprojection-weight",
       Number([](O& o) -> double& { return o.literal.merging.reprojection_weight; })},
      {"literal-bidirectional",
       Switch([](O& o) -> bool& { return o.literal.merging.bidirectional; })},
      {"contrast", Number([](O& o) -> double& { return o.features.contrast_threshold; })},
      {"faint-contrast",
       Number([](O& o) -> double& { return o.features.faint_contrast_threshold; })},
  };
  return setters;
}

}  // namespace

void ApplyPreset(Preset preset, PipelineOptions& options) {
  if (preset == Preset::kLiteral) options.method = Method::kLiteral;
  if (preset == Preset::kInternet) options.tc_sfm.max_gap_deg.reset();
}

Status SetOption(std::string_view key, std::string_view value, PipelineOptions& options) {
  const auto found = Setters().find(key);
  if (found == Setters().end()) {
    std::string known;
    for (const auto& [name, setter] : Setters()) known += (known.empty() ? "" : ", ") + name;
    return Error{ErrorCode::kInvalidArgument,
                 "option '" + std::string(key) + "' is not known; known are " + known, ""};
  }
  if (found->second(value, options)) return {};
  return Error{ErrorCode::kInvalidArgument,
               "'" + std::string(value) + "' was given, a number, \"on\" or \"off\" is expected",
               std::string(key)};
}

}  // namespace rotunda::sfm
