#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "daemon/cli/commands.h"
#include "daemon/cli/comparison_text.h"
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

void PrintJson(const CompareArguments& arguments, const Compared& compared) {
  Json result = {{"before", compared.before.id},
                 {"before_file", arguments.before.string()},
                 {"after", compared.after.id},
                 {"after_file", arguments.after.string()}};
  result.update(ComparisonJson(compared.comparison));
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

void PrintTable(const CompareArguments& arguments, const Compared& compared) {
  const rig::CalibrationComparison& comparison = compared.comparison;
  std::printf("then  %s (%s)\nnow   %s (%s)\n", arguments.before.c_str(),
              compared.before.id.c_str(), arguments.after.c_str(), compared.after.id.c_str());
  std::printf("%-10s %9s %15s %11s %15s %8s %9s %8s\n", "camera", "moved/mm", "sigma then, now",
              "turned/deg", "sigma then, now", "sigmas", "focal/%", "lens");
  for (const rig::CameraChange& change : comparison.cameras) PrintRow(change);
  std::printf(
      "%zu cameras are in both; more than %.2f sigmas (of both calibrations together) would count "
      "as moved\n",
      comparison.cameras.size(), comparison.sigmas_limit);
  PrintComparison(comparison, "No camera moved and no lens changed.");
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
        PrintJson(*arguments, *compared);
      } else {
        PrintTable(*arguments, *compared);
      }
      return kDone;
    };
  });
}

}  // namespace rotunda::cli
