#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "config/board_config.h"
#include "daemon/calibration_job.h"
#include "daemon/cli/commands.h"
#include "daemon/cli/comparison_text.h"
#include "daemon/cli/terminal.h"
#include "sfm/core/file_io.h"

namespace rotunda::cli {
namespace {

namespace fs = std::filesystem;

struct CalibrateArguments {
  std::vector<fs::path> framesets;
  fs::path board;
  fs::path out;
  std::optional<fs::path> intrinsics_from;
  std::optional<fs::path> frame_from;
  std::optional<fs::path> compare;
  std::optional<fs::path> report;
  rig::LensModel model = rig::LensModel::kOpencv;
};

std::string NowText() {
  const std::time_t now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  std::tm utc = {};
  gmtime_r(&now, &utc);
  char text[32];
  std::strftime(text, sizeof(text), "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text;
}

using daemon::CalibrationOutcome;
using daemon::EarlierCalibration;

Result<std::optional<EarlierCalibration>> ReadOptional(const std::optional<fs::path>& file) {
  if (!file) return std::optional<EarlierCalibration>();
  ROTUNDA_ASSIGN_OR_RETURN(Calibration calibration, ReadCalibration(*file));
  return std::optional<EarlierCalibration>({std::move(calibration), file->string()});
}

bool SameFile(const fs::path& a, const fs::path& b) {
  std::error_code ignored;
  return fs::weakly_canonical(fs::absolute(a, ignored), ignored) ==
         fs::weakly_canonical(fs::absolute(b, ignored), ignored);
}

/// What is read may not be written: refused when `file` is one of these.
Status CheckNoInput(const CalibrateArguments& arguments, const fs::path& file) {
  const std::pair<const char*, std::optional<fs::path>> inputs[] = {
      {"--board", arguments.board},
      {"--fix-intrinsics-from", arguments.intrinsics_from},
      {"--frame-from", arguments.frame_from},
      {"--compare", arguments.compare}};
  for (const auto& [option, input] : inputs) {
    if (!input || !SameFile(file, *input)) continue;
    return Error{ErrorCode::kInvalidArgument,
                 std::string("is also what ") + option +
                     " names, which would be lost; expected a file of its own",
                 file.string()};
  }
  return {};
}

/// Whether what comes of the work can be written: asked before it.
Status CheckOutputs(const CalibrateArguments& arguments) {
  for (const auto& [option, file] :
       {std::pair("--out", std::optional(arguments.out)), {"--report", arguments.report}}) {
    if (!file) continue;
    if (const Status place = CheckOutputFile(*file); !place.ok()) return place.error().In(option);
    if (const Status own = CheckNoInput(arguments, *file); !own.ok()) {
      return own.error().In(option);
    }
  }
  if (!arguments.report || !SameFile(arguments.out, *arguments.report)) return {};
  return Error{ErrorCode::kInvalidArgument,
               "is also what --out names, expected a file of its own (page.html)",
               "--report: " + arguments.report->string()};
}

/// "7 x seen twice (most: c03r2 4, c04r2 3)".
std::string RejectedText(const rig::RejectedCount& rejected) {
  return std::to_string(rejected.count) + " x " + rejected.text.name +
         " (most: " + rig::WorstCameras(rejected) + ")";
}

nlohmann::ordered_json RejectedJson(const std::vector<rig::RejectedCount>& rejected) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const rig::RejectedCount& count : rejected) {
    nlohmann::ordered_json cameras = nlohmann::ordered_json::object();
    for (const auto& [camera, some] : count.cameras) cameras[camera] = some;
    list.push_back({{"reason", count.text.name}, {"count", count.count}, {"cameras", cameras}});
  }
  return list;
}

nlohmann::ordered_json StagesJson(const std::vector<StageCost>& costs) {
  nlohmann::ordered_json stages = nlohmann::ordered_json::array();
  for (const StageCost& cost : costs) {
    stages.push_back({{"stage", cost.stage},
                      {"seconds", cost.seconds},
                      {"peak_memory_mb", cost.peak_memory_mb}});
  }
  return stages;
}

/// One standard deviation over the cameras.
struct SigmaSummary {
  double rotation_deg = 0, position_mm = 0, focal_percent = 0;  // means
  double max_rotation_deg = 0, max_position_mm = 0;
};

SigmaSummary Summarize(const Calibration& calibration) {
  SigmaSummary sigma;
  const auto count = static_cast<double>(calibration.cameras.size());
  for (const CalibratedCamera& camera : calibration.cameras) {
    sigma.rotation_deg += camera.sigma->rotation_deg / count;
    sigma.position_mm += camera.sigma->position_mm / count;
    sigma.max_rotation_deg = std::max(sigma.max_rotation_deg, camera.sigma->rotation_deg);
    sigma.max_position_mm = std::max(sigma.max_position_mm, camera.sigma->position_mm);
    sigma.focal_percent +=
        100 * camera.sigma->focal_px.value_or(0) / camera.intrinsics.MeanFocal_px() / count;
  }
  return sigma;
}

nlohmann::ordered_json UncertaintyJson(const Calibration& calibration) {
  const SigmaSummary sigma = Summarize(calibration);
  return {{"mean_rotation_deg", sigma.rotation_deg},
          {"mean_position_mm", sigma.position_mm},
          {"mean_focal_percent", sigma.focal_percent},
          {"max_rotation_deg", sigma.max_rotation_deg},
          {"max_position_mm", sigma.max_position_mm}};
}

/// A camera's sigma and how its corners fit.
nlohmann::ordered_json CamerasJson(const Calibration& calibration) {
  nlohmann::ordered_json cameras = nlohmann::ordered_json::array();
  for (const CalibratedCamera& camera : calibration.cameras) {
    cameras.push_back({{"camera", camera.camera},
                       {"rotation_deg", camera.sigma->rotation_deg},
                       {"position_mm", camera.sigma->position_mm},
                       {"focal_px", camera.sigma->focal_px.value_or(0)},
                       {"corners", camera.fit->corners},
                       {"kept", camera.fit->kept},
                       {"rms_px", camera.fit->rms_px}});
  }
  return cameras;
}

void PrintJson(const CalibrateArguments& arguments, const CalibrationOutcome& outcome,
               const std::vector<StageCost>& costs) {
  const CalibrationResiduals& residuals = *outcome.calibration.residuals;
  nlohmann::ordered_json result = {{"out", arguments.out.string()},
                                   {"calibrated", outcome.calibration.cameras.size()},
                                   {"of", outcome.sightings.cameras.size()},
                                   {"shots_used", outcome.ShotsUsed()},
                                   {"shots", outcome.sightings.shots.size()},
                                   {"corners", residuals.corners},
                                   {"kept", residuals.kept},
                                   {"rms_px", residuals.rms_px},
                                   {"noise", residuals.noise}};
  if (residuals.held_out_rms_px) result["held_out_rms_px"] = *residuals.held_out_rms_px;
  if (residuals.held_out_p95_px) result["held_out_p95_px"] = *residuals.held_out_p95_px;
  if (residuals.half_split_rotation_ratio) {
    result["half_split_rotation_ratio"] = *residuals.half_split_rotation_ratio;
    result["half_split_position_ratio"] = *residuals.half_split_position_ratio;
  }
  result["uncertainty"] = UncertaintyJson(outcome.calibration);
  result["cameras"] = CamerasJson(outcome.calibration);
  result["rig_frame"] = outcome.result.frame;
  result["rejected_markers"] = RejectedJson(rig::CountRejectedMarkers(outcome.sightings));
  result["rejected_corners"] = RejectedJson(rig::CountRejectedCorners(outcome.sightings));
  result["notes"] = outcome.notes;
  if (const auto changes = outcome.Changes()) result["changes"] = *changes;
  if (outcome.comparison) result["comparison"] = ComparisonJson(*outcome.comparison);
  result["stages"] = StagesJson(costs);
  std::printf("%s\n", result.dump(1).c_str());
}

void PrintSigmas(const Calibration& calibration) {
  const SigmaSummary sigma = Summarize(calibration);
  std::printf(
      "uncertainty (1 sigma)  mean %.4f deg, %.3f mm, focal length %.4f %%; largest %.4f "
      "deg, %.3f mm\n",
      sigma.rotation_deg, sigma.position_mm, sigma.focal_percent, sigma.max_rotation_deg,
      sigma.max_position_mm);
}

void PrintChanges(const CalibrationOutcome& outcome) {
  if (!outcome.comparison) return;
  std::printf("Since the calibration compared with:\n");
  PrintComparison(*outcome.comparison, "  no camera moved and no lens changed");
}

void PrintResiduals(const CalibrationResiduals& residuals) {
  std::printf(
      "corners                %zu of %zu kept (%.1f %%), RMS %.3f px, %.2f times the "
      "detector's sigma\n",
      residuals.kept, residuals.corners,
      100.0 * static_cast<double>(residuals.kept) / static_cast<double>(residuals.corners),
      residuals.rms_px, residuals.noise);
  if (residuals.held_out_rms_px) {
    std::printf("held-out corners       RMS %.3f px, 95 %% below %.3f px\n",
                *residuals.held_out_rms_px, *residuals.held_out_p95_px);
  }
}

void PrintTable(const CalibrateArguments& arguments, const CalibrationOutcome& outcome,
                const std::vector<StageCost>& costs) {
  const CalibrationResiduals& residuals = *outcome.calibration.residuals;
  std::printf("Calibrated %zu of %zu cameras from %zu of %zu shots\n",
              outcome.calibration.cameras.size(), outcome.sightings.cameras.size(),
              outcome.ShotsUsed(), outcome.sightings.shots.size());
  PrintResiduals(residuals);
  PrintSigmas(outcome.calibration);
  if (residuals.half_split_rotation_ratio) {
    std::printf(
        "two halves             differ by %.2f (rotation), %.2f (position) times what the "
        "uncertainty says\n",
        *residuals.half_split_rotation_ratio, *residuals.half_split_position_ratio);
  }
  std::printf("rig frame              %s\n", outcome.result.frame.c_str());
  for (const rig::RejectedCount& rejected : rig::CountRejectedMarkers(outcome.sightings)) {
    std::printf("markers not used       %s\n", RejectedText(rejected).c_str());
  }
  for (const rig::RejectedCount& rejected : rig::CountRejectedCorners(outcome.sightings)) {
    std::printf("corners not used       %s\n", RejectedText(rejected).c_str());
  }
  for (const std::string& note : outcome.notes) std::printf("  note: %s\n", note.c_str());
  PrintChanges(outcome);
  for (const StageCost& cost : costs) {
    std::printf("  %-16s %8.2f s %8.0f MB\n", cost.stage.c_str(), cost.seconds,
                cost.peak_memory_mb);
  }
  std::printf("Calibration: %s\n", arguments.out.c_str());
  if (arguments.report) std::printf("Report:      %s\n", arguments.report->c_str());
}

Status Calibrate(const CalibrateArguments& arguments, const CommonOptions& common) {
  ROTUNDA_RETURN_IF_ERROR(CheckOutputs(arguments));
  daemon::CalibrationTask task;
  ROTUNDA_ASSIGN_OR_RETURN(task.board, config::ReadBoard(arguments.board));
  task.board_name = arguments.board.string();
  task.framesets = arguments.framesets;
  task.model = arguments.model;
  ROTUNDA_ASSIGN_OR_RETURN(task.intrinsics_from, ReadOptional(arguments.intrinsics_from));
  ROTUNDA_ASSIGN_OR_RETURN(task.frame_from, ReadOptional(arguments.frame_from));
  ROTUNDA_ASSIGN_OR_RETURN(task.compare, ReadOptional(arguments.compare));

  ThreadPool threads(common.threads);
  ProgressLine progress(!common.json);
  RunContext context{threads, common.stop, [&](std::string_view stage, size_t done, size_t total) {
                       progress.Update(stage, done, total);
                     }};
  ROTUNDA_ASSIGN_OR_RETURN(CalibrationOutcome outcome, daemon::MakeCalibration(task, context));
  if (outcome.calibration.created_at.empty()) {
    outcome.calibration.created_at = NowText();
    outcome.calibration.id = daemon::CalibrationIdOf(outcome.calibration.created_at);
  }
  ROTUNDA_RETURN_IF_ERROR(WriteCalibration(outcome.calibration, arguments.out));
  if (arguments.report) {
    const Status page =
        WriteFileAtomically(*arguments.report, daemon::CalibrationPage(task, outcome));
    if (!page.ok()) {
      Error error = page.error().In("--report");
      error.message += "; the calibration itself is whole in " + arguments.out.string();
      return error;
    }
  }
  const std::vector<StageCost> costs = progress.Finish();
  if (common.json) {
    PrintJson(arguments, outcome, costs);
  } else {
    PrintTable(arguments, outcome, costs);
  }
  return {};
}

/// Options that name an earlier calibration.
void AddEarlier(CLI::App* command, CalibrateArguments& arguments) {
  command
      ->add_option(
          "--fix-intrinsics-from", arguments.intrinsics_from,
          "Keep the lenses of this calibration, its rig frame and the target as it was "
          "found then: one shot is enough. The board file must be of the same target; cameras that "
          "it does not have are left out")
      ->type_name("FILE");
  command
      ->add_option("--frame-from", arguments.frame_from,
                   "Rig frame of this calibration (cameras that moved do not drag it); default: "
                   "the target in the shot that [rig_frame] of the board file names, else in the "
                   "first one")
      ->type_name("FILE");
  command
      ->add_option(
          "--compare", arguments.compare,
          "Say which cameras moved since this calibration of the same target, how far, and by how "
          "many sigmas (of another target: rotunda compare)")
      ->type_name("FILE");
}

}  // namespace

void AddCalibrate(CLI::App& app, CommonOptions& common, Action& chosen) {
  auto arguments = std::make_shared<CalibrateArguments>();
  CLI::App* command = AddCommand(
      app, common, "calibrate",
      "Find lenses and poses of all cameras from shots of the calibration target, with the "
      "uncertainty of each, and how the target really is.\n"
      "Done (exit status 0) also means that some cameras may be missing or poorly covered: the "
      "notes say which and what to do.",
      "rotunda calibrate shots/placement_* --board config/cuboid.toml --out calibration.json "
      "--report calibration.html");
  command
      ->add_option("FRAMESET", arguments->framesets,
                   "Frame sets (a shot each), folders of frame sets, or a folder with a folder of "
                   "pictures for each camera, the k-th picture of all being one shot")
      ->required();
  command->add_option("--board", arguments->board, "The target (see config/cuboid.toml)")
      ->type_name("FILE")
      ->required();
  command->add_option("--out", arguments->out, "Calibration to write")
      ->type_name("FILE")
      ->required();
  AddEarlier(command, *arguments);
  command->add_option("--report", arguments->report, "Page to write, for a browser")
      ->type_name("FILE.html");
  AddChoice<rig::LensModel>(
      command, "--model", arguments->model,
      "Lens: opencv (default, 8 parameters), opencv5 (9: k3 as well), or full-opencv (12, for "
      "strong distortion; needs corners up to the edges of every picture). Lenses that are kept "
      "are of the model they were found with",
      rig::LensModelsByName());
  command->get_option("--model")->excludes("--fix-intrinsics-from");
  AddThreads(command, common);
  command->callback([arguments, &common, &chosen] {
    chosen = [arguments, &common] {
      const Status status = Calibrate(*arguments, common);
      return status.ok() ? kDone : Fail(status.error());
    };
  });
}

}  // namespace rotunda::cli
