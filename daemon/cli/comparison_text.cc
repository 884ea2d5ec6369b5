#include "daemon/cli/comparison_text.h"

#include <cstdio>
#include <string>
#include <vector>

namespace rotunda::cli {
namespace {

using Json = nlohmann::ordered_json;

Json SigmaJson(const PoseSigma& sigma) {
  Json json = {{"position_mm", sigma.position_mm}, {"rotation_deg", sigma.rotation_deg}};
  if (sigma.focal_px) json["focal_px"] = *sigma.focal_px;
  return json;
}

Json ChangeJson(const rig::CameraChange& change) {
  Json json = {{"camera", change.camera},
               {"position_mm", change.position_mm},
               {"rotation_deg", change.rotation_deg},
               {"sigmas", change.sigmas},
               {"moved", change.moved}};
  if (change.swapped_with) json["stands_where"] = *change.swapped_with;
  json["focal_percent"] = change.focal_percent;
  if (change.lens_sigmas) json["lens_sigmas"] = *change.lens_sigmas;
  json["lens_changed"] = change.lens_changed;
  json["other_serial"] = change.other_serial;
  if (change.sigma_before) json["sigma_before"] = SigmaJson(*change.sigma_before);
  if (change.sigma_after) json["sigma_after"] = SigmaJson(*change.sigma_after);
  return json;
}

}  // namespace

Json ComparisonJson(const rig::CalibrationComparison& comparison) {
  Json cameras = Json::array();
  for (const rig::CameraChange& change : comparison.cameras) cameras.push_back(ChangeJson(change));
  return {{"same_rig", comparison.SameRig()},
          {"sigmas_limit", comparison.sigmas_limit},
          {"inflation", comparison.inflation},
          {"lens_inflation", comparison.lens_inflation},
          {"cameras", cameras},
          {"only_before", comparison.only_before},
          {"only_after", comparison.only_after},
          {"not_calibrated", comparison.not_calibrated},
          {"changes", rig::ChangesIn(comparison)}};
}

void PrintComparison(const rig::CalibrationComparison& comparison, const char* nothing_changed) {
  if (comparison.inflation > 1 && comparison.SameRig()) {
    std::printf("All cameras scatter %.2f times what the calibrations' sigmas say: counted in\n",
                comparison.inflation);
  }
  const std::vector<std::string> changes = rig::ChangesIn(comparison);
  for (const std::string& change : changes) std::printf("  %s\n", change.c_str());
  if (changes.empty()) std::printf("%s\n", nothing_changed);
}

}  // namespace rotunda::cli
