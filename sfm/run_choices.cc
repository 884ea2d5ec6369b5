#include "sfm/run_choices.h"

#include "sfm/core/name_list.h"

namespace rotunda::sfm {
namespace {

Status NoEffect(const char* field, Method method) {
  return Error{ErrorCode::kInvalidArgument,
               std::string("has no effect on ") + MethodName(method) + ", only on " +
                   MethodName(Method::kTcSfm),
               field};
}

}  // namespace

const char* MethodName(Method method) {
  switch (method) {
    case Method::kTcSfm:
      return "tc-sfm";
    case Method::kLiteral:
      return "tc-sfm literal";
    case Method::kPlain:
      return "plain";
  }
  return "";
}

Status RunChoices::Validate() const {
  if (method == Method::kPlain && preset != Preset::kRig) return NoEffect(kPresetOption, method);
  if (!calibration_prior) return {};
  return CheckPriorOf(preset == Preset::kLiteral ? Method::kLiteral : method);
}

const std::map<std::string, Method>& MethodsByName() {
  static const std::map<std::string, Method> methods = {
      {MethodName(Method::kTcSfm), Method::kTcSfm}, {MethodName(Method::kPlain), Method::kPlain}};
  return methods;
}

const std::map<std::string, Preset>& PresetsByName() {
  static const std::map<std::string, Preset> presets = {
      {"rig", Preset::kRig}, {"internet", Preset::kInternet}, {"literal", Preset::kLiteral}};
  return presets;
}

const std::map<std::string, PairSelection>& PairSelectionsByName() {
  static const std::map<std::string, PairSelection> selections = {
      {"exhaustive", PairSelection::kExhaustive}, {"neighbours", PairSelection::kNeighbours}};
  return selections;
}

const std::map<std::string, bool>& PriorsByName() {
  static const std::map<std::string, bool> priors = {{"none", false}, {"calibration", true}};
  return priors;
}

Status CheckPriorOf(Method method) {
  return method == Method::kTcSfm ? Status() : NoEffect(kPriorOption, method);
}

std::string PriorOf(const PoseSet& poses) {
  const auto said = poses.options.find(kPriorOption);
  return said == poses.options.end() ? NameIn(PriorsByName(), false) : said->second;
}

bool HadPrior(const PoseSet& poses) { return PriorOf(poses) != NameIn(PriorsByName(), false); }

}  // namespace rotunda::sfm
