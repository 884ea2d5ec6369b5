#include "sfm/presets.h"

#include <cmath>
#include <cstdlib>
#include <functional>
#include <map>
#include <optional>

#include "sfm/core/name_list.h"

namespace rotunda::sfm {
namespace {

constexpr char kContrast[] = "contrast";
constexpr char kFaintContrast[] = "faint-contrast";

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

struct Setting {
  std::optional<Method> only;  // the method that it acts on; nullopt: all
  Setter set;
};

const std::map<std::string, Setting, std::less<>>& Settings() {
  using O = PipelineOptions;
  constexpr Method kOurs = Method::kTcSfm, kPaper = Method::kLiteral;
  static const std::map<std::string, Setting, std::less<>> settings = {
      {"consistent-view-graph",
       {kOurs, Switch([](O& o) -> bool& { return o.tc_sfm.consistent_view_graph; })}},
      {"unfolding", {kOurs, Switch([](O& o) -> bool& { return o.tc_sfm.unfolding; })}},
      {"piece-consensus",
       {kOurs, Switch([](O& o) -> bool& { return o.tc_sfm.consistency.piece_consensus; })}},
      {"matches-brought-back",
       {kOurs, Switch([](O& o) -> bool& { return o.tc_sfm.matches_brought_back; })}},
      {"single-image-doubt",
       {kOurs, Switch([](O& o) -> bool& { return o.tc_sfm.single_image_doubt; })}},
      {"ring-gap",
       {kOurs, Choice<std::optional<double>>(
                   [](O& o) -> std::optional<double>& { return o.tc_sfm.max_gap_deg; },
                   TcSfmOptions().max_gap_deg, std::nullopt)}},
      {"obstacles", {kOurs, Switch([](O& o) -> bool& { return o.tc_sfm.covisibility.obstacles; })}},
      {"bidirectional",
       {kOurs, Switch([](O& o) -> bool& { return o.tc_sfm.merging.bidirectional; })}},
      {"reprojection-weight",
       {kOurs, Number([](O& o) -> double& { return o.tc_sfm.merging.reprojection_weight; })}},
      {"literal-consistent-view-graph",
       {kPaper, Switch([](O& o) -> bool& { return o.literal.consistent_view_graph; })}},
      {"literal-min-edge-weight",
       {kPaper, Number([](O& o) -> double& { return o.literal.min_edge_weight; })}},
      {"literal-adaptive-edge-weight",
       {kPaper, Switch([](O& o) -> bool& { return o.literal.adaptive_edge_weight; })}},
      {"literal-confirmed-light-edges",
       {kPaper, Switch([](O& o) -> bool& { return o.literal.confirmed_light_edges; })}},
      {"literal-missing-observations",
       {kPaper, Switch([](O& o) -> bool& { return o.literal.correction.missing_observations; })}},
      {"literal-graph-support",
       {kPaper, Switch([](O& o) -> bool& { return o.literal.correction.graph_support; })}},
      {"literal-rotation-loops",
       {kPaper, Switch([](O& o) -> bool& { return o.literal.correction.rotation_loops; })}},
      {"literal-undone-merges",
       {kPaper, Switch([](O& o) -> bool& { return o.literal.clusters.undo_inconsistent_merges; })}},
      {"literal-rejected-links",
       {kPaper,
        Choice<AmbiguitySign>([](O& o) -> AmbiguitySign& { return o.literal.segments.sign; },
                              AmbiguitySign::kRejectedLinks, AmbiguitySign::kDiversity)}},
      {"literal-min-diversity",
       {kPaper, Number([](O& o) -> double& { return o.literal.segments.min_diversity; })}},
      {"literal-diversity-inclusive",
       {kPaper, Switch([](O& o) -> bool& { return o.literal.segments.diversity_inclusive; })}},
      {"literal-labels-by-track",
       {kPaper, Switch([](O& o) -> bool& { return o.literal.correction.labels_by_track; })}},
      {"literal-max-sigma-share",
       {kPaper, Number([](O& o) -> double& { return o.literal.correction.max_sigma_share; })}},
      {"literal-weighted-track-graph",
       {kPaper, Switch([](O& o) -> bool& { return o.literal.track_graph.weighted; })}},
      {"literal-rejected-undecided",
       {kPaper,
        Choice<bool>([](O& o) -> bool& { return o.literal.correction.undecided_is_consistent; },
                     false, true)}},
      {"literal-center-angle",
       {kPaper, Choice<PlaceDistance>(
                    [](O& o) -> PlaceDistance& { return o.literal.correction.place_distance; },
                    PlaceDistance::kCenterAngle, PlaceDistance::kTranslationAngle)}},
      {"literal-strongest-link-next",
       {kPaper, Choice<NextImage>([](O& o) -> NextImage& { return o.literal.correction.next; },
                                  NextImage::kStrongestLink, NextImage::kMostPrimaryPoints)}},
      {"literal-mean-cost",
       {kPaper, Switch([](O& o) -> bool& { return o.literal.merging.mean_cost; })}},
      {"literal-reprojection-weight",
       {kPaper, Number([](O& o) -> double& { return o.literal.merging.reprojection_weight; })}},
      {"literal-bidirectional",
       {kPaper, Switch([](O& o) -> bool& { return o.literal.merging.bidirectional; })}},
      {kContrast,
       {std::nullopt, Number([](O& o) -> double& { return o.features.contrast_threshold; })}},
      {kFaintContrast,
       {std::nullopt, Number([](O& o) -> double& { return o.features.faint_contrast_threshold; })}},
  };
  return settings;
}

}  // namespace

void ApplyPreset(Preset preset, PipelineOptions& options) {
  options.preset = NameIn(PresetsByName(), preset);
  if (preset == Preset::kLiteral) options.method = Method::kLiteral;
  if (preset == Preset::kInternet) options.tc_sfm.max_gap_deg.reset();
}

PipelineOptions OptionsOf(const RunChoices& choices) {
  PipelineOptions options;
  options.method = choices.method;
  ApplyPreset(choices.preset, options);
  options.pairs = choices.pairs;
  options.calibration_prior = choices.calibration_prior;
  options.refine_intrinsics = choices.refine_intrinsics;
  return options;
}

Status SetOption(std::string_view key, std::string_view value, PipelineOptions& options) {
  const auto found = Settings().find(key);
  if (found == Settings().end()) {
    std::string known;
    for (const auto& [name, setting] : Settings()) known += (known.empty() ? "" : ", ") + name;
    return Error{ErrorCode::kInvalidArgument,
                 "option '" + std::string(key) + "' is not known; known are " + known, ""};
  }
  const Setting& setting = found->second;
  if (setting.only && *setting.only != options.method) {
    return Error{ErrorCode::kInvalidArgument,
                 std::string("is an option of ") + MethodName(*setting.only) +
                     " and has no effect on " + MethodName(options.method),
                 std::string(key)};
  }
  if (setting.set(value, options)) {
    options.settings[std::string(key)] = value;
    return {};
  }
  return Error{
      ErrorCode::kInvalidArgument,
      std::string("'").append(value) + "' was given, a number, \"on\" or \"off\" is expected",
      std::string(key)};
}

bool ActsOnFeatures(std::string_view key) { return key == kContrast || key == kFaintContrast; }

}  // namespace rotunda::sfm
