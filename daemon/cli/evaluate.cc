#include "sfm/core/evaluate.h"

#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "daemon/cli/commands.h"
#include "daemon/cli/terminal.h"
#include "sfm/core/file_io.h"

namespace rotunda::cli {
namespace {

struct EvaluateArguments {
  std::filesystem::path measured;
  std::filesystem::path truth;
  bool per_camera = false;
};

Result<Evaluation> Evaluate(const EvaluateArguments& arguments) {
  std::error_code ignored;
  if (std::filesystem::is_directory(arguments.measured, ignored)) {
    return Error{ErrorCode::kInvalidArgument,
                 "found a folder, expected the file poses.json or calibration.json in it",
                 arguments.measured.string()};
  }
  ROTUNDA_ASSIGN_OR_RETURN(const Calibration truth, ReadCalibration(arguments.truth));
  ROTUNDA_ASSIGN_OR_RETURN(const std::string text, ReadFile(arguments.measured));
  const nlohmann::json json = nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false);
  const std::string name = arguments.measured.string();
  if (json.is_object() && json.contains("format") && json["format"] == kCalibrationFormat) {
    ROTUNDA_ASSIGN_OR_RETURN(const Calibration calibration, CalibrationFromJson(text, name));
    return EvaluateCalibration(calibration, truth);
  }
  ROTUNDA_ASSIGN_OR_RETURN(const PoseSet poses, PoseSetFromJson(text, name));
  return EvaluatePoses(poses, truth);
}

void PrintTable(const Evaluation& evaluation, bool per_camera) {
  if (per_camera) {
    std::printf("%-12s %14s %14s\n", "camera", "rotation/deg", "position/mm");
    for (const CameraError& camera : evaluation.cameras) {
      std::printf("%-12s %14.4f %14.3f\n", camera.camera.c_str(), camera.rotation_deg,
                  camera.position_mm);
    }
  }
  std::printf("'%s' against the truth '%s'\n", evaluation.measured_id.c_str(),
              evaluation.truth_id.c_str());
  std::printf("registered        %zu of %zu%s\n", evaluation.registered, evaluation.of,
              evaluation.folded ? ", FOLDED (a camera is more than 10 degrees off)" : "");
  if (!evaluation.not_in_truth.empty()) {
    std::string names;
    for (const std::string& name : evaluation.not_in_truth) names += " " + name;
    std::printf("compared          %zu; not in the truth:%s\n", evaluation.cameras.size(),
                names.c_str());
  }
  std::printf("rotation error    mean %.4f  median %.4f  max %.4f deg\n",
              evaluation.mean_rotation_deg, evaluation.median_rotation_deg,
              evaluation.max_rotation_deg);
  std::printf("position error    mean %.3f  median %.3f  max %.3f mm\n",
              evaluation.mean_position_mm, evaluation.median_position_mm,
              evaluation.max_position_mm);
  if (evaluation.rotation_error_over_sigma && evaluation.position_error_over_sigma) {
    std::printf("error / predicted sigma (root mean square)  rotation %.2f  position %.2f\n",
                *evaluation.rotation_error_over_sigma, *evaluation.position_error_over_sigma);
  }
}

}  // namespace

void AddEvaluate(CLI::App& app, CommonOptions& common, Action& chosen) {
  auto arguments = std::make_shared<EvaluateArguments>();
  CLI::App* command =
      AddCommand(app, common, "evaluate",
                 "Compare poses (after one similarity transform) or a calibration (after one rigid "
                 "motion: its scale counts) with the truth.",
                 "rotunda evaluate out/poses.json --truth capture/truth.json --per-camera");
  command->add_option("MEASURED", arguments->measured, "poses.json or calibration.json")
      ->required();
  command->add_option("--truth", arguments->truth, "The true calibration")
      ->type_name("FILE")
      ->required();
  command->add_flag("--per-camera", arguments->per_camera, "Also list every camera's error");
  command->callback([arguments, &common, &chosen] {
    chosen = [arguments, &common] {
      const Result<Evaluation> evaluation = Evaluate(*arguments);
      if (!evaluation.ok()) return Fail(evaluation.error());
      if (common.json) {
        std::printf("%s", EvaluationToJson(*evaluation).c_str());
      } else {
        PrintTable(*evaluation, arguments->per_camera);
      }
      return kDone;
    };
  });
}

}  // namespace rotunda::cli
