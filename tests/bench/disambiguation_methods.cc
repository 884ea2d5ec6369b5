#include "tests/bench/disambiguation_methods.h"

namespace rotunda::bench {
namespace {

const std::vector<std::string> kRig = {"--method", "tc-sfm", "--preset", "rig"};
const std::vector<std::string> kLiteral = {"--method", "tc-sfm", "--preset", "literal"};
const std::vector<std::string> kInternet = {"--method", "tc-sfm", "--preset", "internet"};
const std::vector<std::string> kPlain = {"--method", "plain"};

/// One place where the preset "rig" reads or adds to the paper in its own way, as settings of
/// `rotunda reconstruct --set KEY=VALUE`.
struct Reading {
  const char* name;
  const char* key;
  const char* ours;
  const char* without;    // the paper's way, or the part switched off
  bool in_paper = false;  // what is switched off is the paper's own: literal has it already
};
constexpr Reading kReadings[] = {
    {"consistent-view-graph", "consistent_view_graph", "on", "off"},
    {"weighted-track-graph", "track_graph_weights", "pictures", "one"},
    {"rejected-links", "ambiguity_sign", "rejected-links", "diversity"},
    {"centroid-angle", "translation_error", "centroid", "literal"},
    {"undecided", "undecided", "evidence", "consistent"},
    {"missing-observations", "missing_observations", "on", "off"},
    {"heaviest-edge-next", "next_image", "weight", "matches"},
    {"reprojection-in-merging", "merge_reprojection_weight", "1", "0"},
    {"mean-merging-cost", "merge_cost", "mean", "sum"},
    {"bidirectional-cost", "bidirectional_cost", "on", "off", true},
};

std::vector<std::string> With(std::vector<std::string> options, const Reading& reading,
                              const char* value) {
  options.insert(options.end(), {"--set", std::string(reading.key) + "=" + value});
  return options;
}

std::vector<Method> MainMethods() {
  return {{"plain", kPlain}, {"literal", kLiteral}, {"tc-sfm", kRig}};
}

/// The names of the main methods are those of the mean set: their cells are shared with it.
std::vector<Method> AblationMethods() {
  std::vector<Method> methods = {{"literal", kLiteral}, {"tc-sfm", kRig}};
  for (const Reading& reading : kReadings) {
    if (reading.in_paper) continue;
    methods.push_back(
        {std::string("literal+") + reading.name, With(kLiteral, reading, reading.ours)});
  }
  for (const Reading& reading : kReadings) {
    methods.push_back(
        {std::string("tc-sfm-") + reading.name, With(kRig, reading, reading.without)});
  }
  return methods;
}

void Add(const std::string& group, const std::vector<Capture>& captures,
         const std::vector<Method>& methods, std::vector<Cell>& cells) {
  for (const Capture& capture : captures) {
    for (const Method& method : methods) cells.push_back({group, capture, method});
    if (capture.with_colmap && group == "mean") {
      cells.push_back({group, capture, {"colmap", {}, true}});
    }
  }
}

}  // namespace

std::vector<Cell> PlanCells(const Groups& groups, const CaptureSize& size) {
  std::vector<Cell> cells;
  if (groups.mean) Add("mean", MeanCaptures(size), MainMethods(), cells);
  if (groups.full_size) Add("full-size", FullSizeCaptures(size), MainMethods(), cells);
  if (groups.stress) Add("stress", StressCaptures(size), MainMethods(), cells);
  if (groups.ablation) Add("ablation", AblationCaptures(size), AblationMethods(), cells);
  if (groups.photographs) {
    Add("photographs", PhotographCaptures(), {{"plain", kPlain}, {"tc-sfm", kInternet}}, cells);
  }
  return cells;
}

}  // namespace rotunda::bench
