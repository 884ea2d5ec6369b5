#include <cstdio>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>

#include "daemon/cli/commands.h"
#include "daemon/cli/terminal.h"
#include "daemon/reconstruction_job.h"
#include "sfm/core/frame_set.h"
#include "sfm/pipeline.h"
#include "sfm/presets.h"

namespace rotunda::cli {
namespace {

namespace fs = std::filesystem;

struct ReconstructArguments {
  fs::path frameset;
  fs::path out;
  std::optional<fs::path> calibration;
  sfm::RunChoices choices;
  std::vector<std::string> settings;
  std::string front_camera;
  std::optional<fs::path> database;
  std::optional<fs::path> stages;
  std::optional<std::string> start_from;
  uint64_t seed = 0;
};

Result<sfm::PipelineOptions> MakeOptions(const ReconstructArguments& arguments) {
  if (const Status valid = arguments.choices.Validate(); !valid.ok()) {
    const Error& error = valid.error();
    return Error{error.code, error.message, "--" + error.context};
  }
  sfm::PipelineOptions options = sfm::OptionsOf(arguments.choices);
  for (const std::string& setting : arguments.settings) {
    const size_t equals = std::min(setting.find('='), setting.size());
    const std::string value = setting.substr(std::min(equals + 1, setting.size()));
    ROTUNDA_RETURN_IF_ERROR(sfm::SetOption(setting.substr(0, equals), value, options));
  }
  options.front_camera = arguments.front_camera;
  options.database = arguments.database;
  options.stages_folder = arguments.stages;
  if (arguments.start_from) {
    ROTUNDA_ASSIGN_OR_RETURN(options.start_from, sfm::StageFromName(*arguments.start_from));
  }
  if (arguments.stages) {
    std::error_code failure;
    fs::create_directories(*arguments.stages, failure);
    if (failure) return Error{ErrorCode::kIo, failure.message(), arguments.stages->string()};
  }
  return options;
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

/// Names of the cameras of which `pick` holds.
std::vector<std::string> NamesWhere(const PoseSet& poses,
                                    const std::function<bool(const CameraPose&)>& pick) {
  std::vector<std::string> names;
  for (const CameraPose& pose : poses.cameras) {
    if (pick(pose)) names.push_back(pose.camera);
  }
  return names;
}

bool OnWrongSide(const CameraPose& pose) {
  return pose.vs_calibration && pose.vs_calibration->wrong_side;
}

/// What the table tells, for machines.
void PrintJson(const ReconstructArguments& arguments, const sfm::PipelineResult& reconstruction,
               const std::vector<StageCost>& costs) {
  const PoseSet& poses = reconstruction.poses;
  const PoseSummary& summary = poses.summary;
  nlohmann::ordered_json result = {{"out", arguments.out.string()},
                                   {"registered", summary.registered},
                                   {"of", summary.of},
                                   {"points", summary.points},
                                   {"models", summary.models},
                                   {"scale", poses.metric ? "metric" : "arbitrary"},
                                   {"verdict", summary.verdict},
                                   {"verdict_reason", summary.verdict_reason},
                                   {"mean_reprojection_px", summary.mean_reprojection_px},
                                   {"rms_px", summary.rms_px}};
  result["not_registered"] =
      NamesWhere(poses, [](const CameraPose& pose) { return !pose.registered; });
  result["moved"] = NamesWhere(poses, [](const CameraPose& pose) {
    return pose.vs_calibration && pose.vs_calibration->moved;
  });
  result["swapped"] = NamesWhere(poses, [](const CameraPose& pose) {
    return pose.vs_calibration && pose.vs_calibration->swapped_with;
  });
  result["wrong_side"] = NamesWhere(poses, OnWrongSide);
  result["notes"] = reconstruction.notes;
  result["stages"] = StagesJson(costs);
  std::printf("%s\n", result.dump(1).c_str());
}

void PrintVerdict(const PoseSummary& summary) {
  if (!summary.verdict.empty()) {
    std::printf("Verdict: %s: %s\n", summary.verdict.c_str(), summary.verdict_reason.c_str());
  } else {
    std::printf("Verdict: none: this method does not judge its result%s\n",
                summary.folded ? "; every camera is near its calibrated place" : "");
  }
}

std::string Displacement(const VsCalibration& off) {
  char text[128];
  std::snprintf(text, sizeof text, "%.2f mm, %.3f deg (%.1f sigmas)", off.position_mm,
                off.rotation_deg, off.sigmas);
  return text;
}

/// A line for a camera without a pose or not in its place.
void PrintCamera(const CameraPose& pose) {
  const std::optional<VsCalibration>& off = pose.vs_calibration;
  if (!pose.registered) {
    std::printf("  not registered: %s: %s\n", pose.camera.c_str(), pose.reason.c_str());
  } else if (off && off->moved) {
    std::printf("  moved since the calibration: %s by %s\n", pose.camera.c_str(),
                Displacement(*off).c_str());
  } else if (off && off->swapped_with) {
    std::printf("  swapped since the calibration: %s stands where %s was\n", pose.camera.c_str(),
                off->swapped_with->c_str());
  }
}

void PrintTable(const ReconstructArguments& arguments, const sfm::PipelineResult& result,
                const std::vector<StageCost>& costs) {
  const PoseSummary& summary = result.poses.summary;
  std::printf("Registered %zu of %zu cameras, %zu points, mean reprojection error %.3f px%s\n",
              summary.registered, summary.of, summary.points, summary.mean_reprojection_px,
              result.poses.metric ? ", metric in the rig frame" : ", arbitrary scale");
  PrintVerdict(summary);
  std::string wrong;
  for (const std::string& name : NamesWhere(result.poses, OnWrongSide)) wrong += " " + name;
  if (!wrong.empty()) std::printf("  on the wrong side:%s\n", wrong.c_str());
  for (const CameraPose& pose : result.poses.cameras) PrintCamera(pose);
  for (const std::string& note : result.notes) std::printf("  note: %s\n", note.c_str());
  for (const StageCost& cost : costs) {
    std::printf("  %-16s %8.2f s %8.0f MB\n", cost.stage.c_str(), cost.seconds,
                cost.peak_memory_mb);
  }
  std::printf("Poses:  %s\nReport: %s\n", (arguments.out / "poses.json").c_str(),
              (arguments.out / "report.html").c_str());
}

Status Reconstruct(const ReconstructArguments& arguments, const CommonOptions& common) {
  daemon::ReconstructionTask task;
  ROTUNDA_ASSIGN_OR_RETURN(task.set, ReadFrameSet(arguments.frameset));
  ROTUNDA_ASSIGN_OR_RETURN(task.in_force,
                           daemon::CalibrationOf(arguments.frameset, arguments.calibration));
  ROTUNDA_ASSIGN_OR_RETURN(task.options, MakeOptions(arguments));
  task.out = arguments.out;

  ThreadPool threads(common.threads);
  ProgressLine progress(!common.json);
  RunContext context{threads, common.stop,
                     [&](std::string_view stage, size_t done, size_t total) {
                       progress.Update(stage, done, total);
                     },
                     arguments.seed};
  ROTUNDA_ASSIGN_OR_RETURN(const sfm::PipelineResult result,
                           daemon::MakeReconstruction(task, context));

  const std::vector<StageCost> costs = progress.Finish();
  if (common.json) {
    PrintJson(arguments, result, costs);
  } else {
    PrintTable(arguments, result, costs);
  }
  return {};
}

void AddFiles(CLI::App* command, ReconstructArguments& arguments) {
  command->add_option("FRAMESET", arguments.frameset, "Frame set, or folder of pictures")
      ->required();
  command
      ->add_option("--out", arguments.out,
                   "Folder to make, in one that exists; if it is there it must be empty")
      ->type_name("DIR")
      ->required();
  command
      ->add_option(
          "--calibration", arguments.calibration,
          "Intrinsics, scale and rig frame; default: FRAMESET/calibration.json, if there. Its "
          "page (FILE with .html for .json) is shown in the report")
      ->type_name("FILE");
}

void AddMethodOptions(CLI::App* command, ReconstructArguments& arguments) {
  sfm::RunChoices& choices = arguments.choices;
  AddChoice(
      command, "--method", choices.method,
      "tc-sfm (default): tells look-alike sides of the subject apart and says how sure it is; "
      "plain: incremental SfM as it is",
      sfm::MethodsByName());
  AddChoice(command, "--preset", choices.preset,
            "rig (default): the cameras surround the subject, and a result in which they "
            "do not is unsure; internet: they may stand anywhere; literal: tc-sfm as "
            "it was published, to compare with",
            sfm::PresetsByName());
  command
      ->add_option("--set", arguments.settings,
                   "One option of the method by its name, for comparisons; a wrong name lists them")
      ->type_name("NAME=VALUE");
  AddChoice(
      command, "--pairs", choices.pairs,
      "Pairs to match: exhaustive (default), or neighbours = those whose calibrated views overlap "
      "(faster, blind to swapped cameras)",
      sfm::PairSelectionsByName());
  AddChoice(
      command, "--prior", choices.calibration_prior,
      "calibration: calibrated poses help to tell look-alike sides apart, where the pictures show "
      "nothing that does; the poses then no longer show by themselves that the rig is as "
      "calibrated. Default: none, only lenses are taken from the calibration",
      sfm::PriorsByName());
  command
      ->add_option("--front", arguments.front_camera,
                   "Without a calibration: the camera in the middle of the front; the others then "
                   "have their sides (front, left, back, right) by it")
      ->type_name("CAMERA");
  AddLensFlags(command, choices.refine_intrinsics);
}

/// Where products in between come from and go to.
void AddStageOptions(CLI::App* command, ReconstructArguments& arguments) {
  command
      ->add_option("--database", arguments.database,
                   "Take keypoints and matches from this COLMAP database.db")
      ->type_name("FILE");
  CLI::Option* stages =
      command
          ->add_option("--stages", arguments.stages,
                       "Folder to which features, matches, two-view geometries and, with "
                       "--method plain, tracks are written")
          ->type_name("DIR");
  command
      ->add_option("--start-from", arguments.start_from,
                   "Read the products up to this one from --stages instead of making them; tracks "
                   "only with --method plain")
      ->check(CLI::IsMember({"features", "matches", "two-views", "tracks"}))
      ->needs(stages);
}

}  // namespace

void AddReconstruct(CLI::App& app, CommonOptions& common, Action& chosen) {
  auto arguments = std::make_shared<ReconstructArguments>();
  CLI::App* command = AddCommand(
      app, common, "reconstruct",
      "Find the camera poses of a frame set, or of a plain folder of pictures, from the pictures.\n"
      "Writes poses.json, sparse/0 (COLMAP binary model), points.ply and report.html into DIR. "
      "Done "
      "(exit status 0) also means that some cameras may be missing: see 'registered'.",
      "rotunda reconstruct person1 --out person1-poses");
  AddFiles(command, *arguments);
  AddMethodOptions(command, *arguments);
  AddStageOptions(command, *arguments);
  AddSeed(command, arguments->seed, "Seed of all random sampling");
  AddThreads(command, common);
  command->callback([arguments, &common, &chosen] {
    chosen = [arguments, &common] {
      const Status status = Reconstruct(*arguments, common);
      return status.ok() ? kDone : Fail(status.error());
    };
  });
}

}  // namespace rotunda::cli
