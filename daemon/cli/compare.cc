#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "daemon/cli/commands.h"
#include "daemon/cli/terminal.h"
#include "rig/calibration_comparison.h"

namespace rotunda::cli {
namespace {

using Json = nlohmann::ordered_json;

struct CompareArguments {
  std::filesystem::path before, after;
};

struct Compared {
  Calibration before, after;
  rig::CalibrationComparison comparison;
};

Result<Compared> Compare(const CompareArguments& arguments) {
  Compared compared;
  ROTUNDA_ASSIGN_OR_RETURN(compared.before, ReadCalibration(arguments.before));
  ROTUNDA_ASSIGN_OR_RETURN(compared.after, ReadCalibration(arguments.after));
  auto comparison = rig::CompareCalibrations(compared.before, compared.after, {});
  if (!comparison) {
    return comparison.error().In(arguments.before.string() + " and " + arguments.after.string());
  }
  compared.comparison = *std::move(comparison);
  return compared;
}

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

void PrintJson(const Compared& compared) {
  const rig::CalibrationComparison& comparison = compared.comparison;
  Json cameras = Json::array();
  for (const rig::CameraChange& change : comparison.cameras) cameras.push_back(ChangeJson(change));
  const Json result = {{"before", compared.before.id},
                       {"after", compared.after.id},
                       {"sigmas_limit", comparison.sigmas_limit},
                       {"inflation", comparison.inflation},
                       {"lens_inflation", comparison.lens_inflation},
                       {"cameras", cameras},
                       {"only_before", comparison.only_before},
                       {"only_after", comparison.only_after},
                       {"changes", rig::ChangesIn(comparison)}};
  std::printf("%s\n", result.dump(1).c_str());
}

/// A dash when there is no figure.
std::string Number(std::optional<double> value, const char* format) {
  if (!value) return "-";
  char text[32];
  std::snprintf(text, sizeof(text), format, *value);
  return text;
}

void PrintRow(const rig::CameraChange& change) {
  const auto sigma = [](const std::optional<PoseSigma>& all, double PoseSigma::*one,
                        const char* format) { return all ? Number((*all).*one, format) : "-"; };
  const auto mm = [&](const auto& all) { return sigma(all, &PoseSigma::position_mm, "%.3f"); };
  const auto deg = [&](const auto& all) { return sigma(all, &PoseSigma::rotation_deg, "%.4f"); };
  std::printf("%-10s %9.3f %7s %7s %11.4f %7s %7s %8.2f %+9.3f %8s  %s\n", change.camera.c_str(),
              change.position_mm, mm(change.sigma_before).c_str(), mm(change.sigma_after).c_str(),
              change.rotation_deg, deg(change.sigma_before).c_str(),
              deg(change.sigma_after).c_str(), change.sigmas, change.focal_percent,
              Number(change.lens_sigmas, "%.2f").c_str(), rig::VerdictOn(change).c_str());
}

void PrintTable(const Compared& compared) {
  const rig::CalibrationComparison& comparison = compared.comparison;
  std::printf("%-10s %9s %15s %11s %15s %8s %9s %8s\n", "camera", "moved/mm", "sigma then, now",
              "turned/deg", "sigma then, now", "sigmas", "focal/%", "lens");
  for (const rig::CameraChange& change : comparison.cameras) PrintRow(change);
  std::printf(
      "%zu cameras are in both; one has moved above %.2f sigmas, of both calibrations together\n",
      comparison.cameras.size(), comparison.sigmas_limit);
  if (comparison.inflation > 1) {
    std::printf("All cameras scatter %.2f times what the calibrations' sigmas say: counted in\n",
                comparison.inflation);
  }
  const std::vector<std::string> changes = rig::ChangesIn(comparison);
  for (const std::string& change : changes) std::printf("  %s\n", change.c_str());
  if (changes.empty()) std::printf("No camera moved and no lens changed.\n");
}

}  // namespace

void AddCompare(CLI::App& app, CommonOptions& common, Action& chosen) {
  auto arguments = std::make_shared<CompareArguments>();
  CLI::App* command = AddCommand(
      app, common, "compare",
      "Compare two calibrations of a rig: which cameras moved or were swapped and which lenses "
      "changed, how far, and by how many sigmas of both; who is in one of them only. The rig "
      "frames need not be the same: they are laid over each other as most cameras agree.\n"
      "Done (exit status 0) whatever moved; --json tells it to a program.",
      "rotunda compare calibrations/monday.json calibrations/tuesday.json");
  command->add_option("BEFORE", arguments->before, "The earlier calibration.json")
      ->required()
      ->type_name("FILE");
  command->add_option("AFTER", arguments->after, "The later one")->required()->type_name("FILE");
  command->callback([arguments, &common, &chosen] {
    chosen = [arguments, &common] {
      const Result<Compared> compared = Compare(*arguments);
      if (!compared.ok()) return Fail(compared.error());
      if (common.json) {
        PrintJson(*compared);
      } else {
        PrintTable(*compared);
      }
      return kDone;
    };
  });
}

}  // namespace rotunda::cli
