#include "tests/bench/disambiguation_methods.h"

#include <algorithm>

namespace rotunda::bench {
namespace {

const std::vector<std::string> kRig = {"--method", "tc-sfm", "--preset", "rig"};
const std::vector<std::string> kInternet = {"--method", "tc-sfm", "--preset", "internet"};
const std::vector<std::string> kLiteral = {"--method", "tc-sfm", "--preset", "literal"};
const std::vector<std::string> kPlain = {"--method", "plain"};

/// A setting of `rotunda reconstruct --set NAME=VALUE` and what the ablation sets it to.
struct Reading {
  const char* name;
  const char* key;
  const char* value;
};
/// Parts of tc-sfm switched off.
constexpr Reading kWithout[] = {
    {"consistent-view-graph", "consistent-view-graph", "off"},
    {"unfolding", "unfolding", "off"},
    {"obstacles", "obstacles", "off"},
    {"piece-consensus", "piece-consensus", "off"},
    {"matches-brought-back", "matches-brought-back", "off"},
    {"ring-gap", "ring-gap", "off"},
    {"single-image-doubt", "single-image-doubt", "off"},
    {"bidirectional-cost", "bidirectional", "off"},
    {"reprojection", "reprojection-weight", "0"},
};
/// What is switched off where the stages are made that the methods share.
constexpr Reading kWithoutInFrontEnd[] = {
    {"faint-keypoints", "faint-contrast", "0.02"},
};
/// The published method with one of our readings, and "+all" with all of these.
constexpr Reading kLiteralOurs[] = {
    {"+consistent-view-graph", "literal-consistent-view-graph", "on"},
    {"+adaptive-edge-weight", "literal-adaptive-edge-weight", "on"},
    {"+confirmed-light-edges", "literal-confirmed-light-edges", "on"},
    {"+rejected-links", "literal-rejected-links", "on"},
    {"+labels-by-track", "literal-labels-by-track", "on"},
    {"+max-sigma-share", "literal-max-sigma-share", "0.333"},
    {"+weighted-track-graph", "literal-weighted-track-graph", "on"},
    {"+undecided-left-out", "literal-rejected-undecided", "on"},
    {"+missing-observations", "literal-missing-observations", "on"},
    {"+graph-support", "literal-graph-support", "on"},
    {"+rotation-loops", "literal-rotation-loops", "on"},
    {"+undone-merges", "literal-undone-merges", "on"},
    {"+center-angle", "literal-center-angle", "on"},
    {"+strongest-link-next", "literal-strongest-link-next", "on"},
    {"+mean-cost", "literal-mean-cost", "on"},
    {"+reprojection", "literal-reprojection-weight", "1"},
};
/// With another of its own readings; the last is a part of it switched off.
constexpr Reading kLiteralOthers[] = {
    {"+min-edge-weight-0.05", "literal-min-edge-weight", "0.05"},
    {"+min-diversity-0.65", "literal-min-diversity", "0.65"},
    {"+diversity-inclusive", "literal-diversity-inclusive", "on"},
    {"-bidirectional-cost", "literal-bidirectional", "off"},
};

std::vector<std::string> With(std::vector<std::string> options, const Reading& reading) {
  options.insert(options.end(), {"--set", std::string(reading.key) + "=" + reading.value});
  return options;
}

std::vector<Method> MainMethods() {
  return {{"plain", kPlain}, {"literal", kLiteral}, {"tc-sfm", kRig}};
}

/// The names of the main methods are those of the mean set: their cells are shared with it.
std::vector<Method> AblationMethods() {
  std::vector<Method> methods = {{"literal", kLiteral}, {"tc-sfm", kRig}};
  Method all = {"literal+all", kLiteral};
  for (const Reading& reading : kLiteralOurs) {
    methods.push_back({std::string("literal") + reading.name, With(kLiteral, reading)});
    all.options = With(all.options, reading);
  }
  methods.push_back(all);
  for (const Reading& reading : kLiteralOthers) {
    methods.push_back({std::string("literal") + reading.name, With(kLiteral, reading)});
  }
  for (const Reading& reading : kWithout) {
    methods.push_back({std::string("tc-sfm-") + reading.name, With(kRig, reading)});
  }
  for (const Reading& reading : kWithoutInFrontEnd) {
    methods.push_back({std::string("tc-sfm-") + reading.name, kRig, With({}, reading)});
  }
  return methods;
}

void Add(const std::string& group, const std::vector<Capture>& captures,
         const std::vector<Method>& methods, std::vector<Cell>& cells) {
  for (const Capture& capture : captures) {
    for (const Method& method : methods) cells.push_back({group, capture, method});
    if (capture.with_colmap && group == "mean") {
      cells.push_back({group, capture, {"colmap", {}, {}, true}});
    }
  }
}

int PlaceInRun(const Method& method) {
  if (method.is_colmap) return 3;
  if (method.name == "tc-sfm" || method.name == "plain") return 0;
  return method.name == "literal" ? 1 : 2;
}

}  // namespace

std::vector<Cell> PlanCells(const Groups& groups, const CaptureSize& size) {
  std::vector<Cell> cells;
  if (groups.mean) Add("mean", MeanCaptures(size), MainMethods(), cells);
  if (groups.full_size) Add("full-size", FullSizeCaptures(size), MainMethods(), cells);
  if (groups.held_out) Add("held-out", HeldOutCaptures(size), MainMethods(), cells);
  if (groups.stress) Add("stress", StressCaptures(size), MainMethods(), cells);
  if (groups.ablation) Add("ablation", AblationCaptures(size), AblationMethods(), cells);
  if (groups.photographs) {
    Add("photographs", PhotographCaptures(), {{"plain", kPlain}, {"tc-sfm", kInternet}}, cells);
  }
  return cells;
}

void SortToRun(std::vector<Cell>& cells) {
  std::stable_sort(cells.begin(), cells.end(), [](const Cell& a, const Cell& b) {
    return PlaceInRun(a.method) < PlaceInRun(b.method);
  });
}

}  // namespace rotunda::bench
