#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "config/board_config.h"
#include "daemon/cli/commands.h"
#include "daemon/cli/terminal.h"
#include "rig/board_sightings.h"
#include "rig/calibration_checks.h"
#include "rig/calibration_comparison.h"
#include "rig/calibration_report.h"
#include "rig/calibration_result.h"
#include "sfm/core/file_io.h"
#include "sfm/core/frame_set.h"

namespace rotunda::cli {
namespace {

namespace fs = std::filesystem;

constexpr size_t kWorstCameras = 5;  // that are named

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

/// When the newest shot was taken, or now when the pictures do not say.
std::string CreatedAt(const rig::BoardSightings& sightings) {
  std::string newest;
  for (const rig::BoardShot& shot : sightings.shots) {
    const Result<FrameSet> set = ReadFrameSet(shot.folder);
    if (set && !set->plain_folder) newest = std::max(newest, set->captured_at);
  }
  if (!newest.empty()) return newest;
  const std::time_t now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  std::tm utc = {};
  gmtime_r(&now, &utc);
  char text[32];
  std::strftime(text, sizeof(text), "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text;
}

/// "charuco-20260118T101500Z".
std::string IdOf(const std::string& created_at) {
  std::string id = "charuco-";
  for (const char c : created_at) {
    if (std::isalnum(static_cast<unsigned char>(c)) != 0) id += c;
  }
  return id;
}

Result<std::optional<Calibration>> ReadOptional(const std::optional<fs::path>& file) {
  if (!file) return std::optional<Calibration>();
  ROTUNDA_ASSIGN_OR_RETURN(Calibration calibration, ReadCalibration(*file));
  return std::optional<Calibration>(std::move(calibration));
}

/// "c00r5, c01r5 and c02r5".
std::string Listed(const std::vector<std::string>& names) {
  std::string text = names[0];
  for (size_t i = 1; i < names.size(); ++i) {
    text += (i + 1 == names.size() ? " and " : ", ") + names[i];
  }
  return text;
}

/// What to do for better coverage, once for all cameras to whom it applies.
std::vector<std::string> Advice(const rig::BoardSightings& sightings,
                                const std::vector<rig::CameraCheck>& checks) {
  std::map<std::string, std::vector<std::string>> cameras;
  for (size_t c = 0; c < checks.size(); ++c) {
    for (const std::string& advice : checks[c].advice) {
      cameras[advice].push_back(sightings.cameras[c].camera);
    }
  }
  std::vector<std::string> lines;
  for (const auto& [advice, names] : cameras) lines.push_back(Listed(names) + ": " + advice);
  return lines;
}

std::vector<std::string> Notes(const rig::BoardSightings& sightings,
                               const rig::RigCalibration& result,
                               const std::vector<rig::CameraCheck>& checks) {
  std::vector<std::string> notes;
  if (!result.frame_problem.empty()) notes.push_back(result.frame_problem);
  for (size_t c = 0; c < sightings.cameras.size(); ++c) {
    const std::string& name = sightings.cameras[c].camera;
    if (!result.camera_problem[c].empty()) {
      notes.push_back(name + " is not calibrated: " + result.camera_problem[c]);
    }
  }
  for (size_t s = 0; s < sightings.shots.size(); ++s) {
    if (!result.shot_problem[s].empty()) {
      notes.push_back(sightings.shots[s].id + " was left out: " + result.shot_problem[s]);
    }
  }
  for (const rig::DroppedPicture& dropped : result.dropped) {
    if (!dropped.camera) continue;
    notes.push_back(sightings.cameras[*dropped.camera].camera + " in " +
                    sightings.shots[dropped.shot].id + " was left out: " + dropped.reason);
  }
  for (std::string& advice : Advice(sightings, checks)) notes.push_back(std::move(advice));
  if (result.drawing_refused) {
    notes.push_back(
        "the faces of the board do not stand as the board file draws them; where they are was "
        "found from the pictures alone");
  }
  return notes;
}

std::vector<std::string> Changes(const rig::CalibrationComparison& comparison) {
  std::vector<std::string> changes;
  char text[200];
  for (const rig::CameraChange& change : comparison.cameras) {
    if (change.moved) {
      std::snprintf(text, sizeof(text), " moved by %.2f mm, %.3f deg (%.1f sigma)",
                    change.position_mm, change.rotation_deg, change.sigmas);
      changes.push_back(change.camera + text +
                        (change.swapped_with ? ": it stands where " + *change.swapped_with +
                                                   " was; are the two swapped?"
                                             : ""));
    }
    if (change.other_serial) changes.push_back(change.camera + " has another serial number");
  }
  for (const std::string& camera : comparison.only_before) changes.push_back(camera + " is gone");
  for (const std::string& camera : comparison.only_after) changes.push_back(camera + " is new");
  return changes;
}

/// What the command shows, on paper or as JSON.
struct Outcome {
  Calibration calibration;
  size_t cameras = 0, shots = 0, shots_used = 0;
  std::string frame;
  std::vector<rig::RejectedCount> rejected;
  std::vector<std::string> notes;
  std::optional<std::vector<std::string>> changes;
  std::vector<StageCost> costs;
};

/// "7 x seen twice (most: c03r2 4, c04r2 3)".
std::string RejectedText(const rig::RejectedCount& rejected) {
  std::string worst;
  for (size_t i = 0; i < std::min(kWorstCameras, rejected.cameras.size()); ++i) {
    const auto& [camera, count] = rejected.cameras[i];
    worst += (worst.empty() ? "" : ", ") + camera + " " + std::to_string(count);
  }
  return std::to_string(rejected.count) + " x " + rejected.kind + " (most: " + worst + ")";
}

nlohmann::ordered_json RejectedJson(const std::vector<rig::RejectedCount>& rejected) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const rig::RejectedCount& count : rejected) {
    nlohmann::ordered_json cameras = nlohmann::ordered_json::object();
    for (const auto& [camera, markers] : count.cameras) cameras[camera] = markers;
    list.push_back({{"reason", count.kind}, {"count", count.count}, {"cameras", cameras}});
  }
  return list;
}

void PrintJson(const CalibrateArguments& arguments, const Outcome& outcome) {
  nlohmann::ordered_json stages = nlohmann::ordered_json::array();
  for (const StageCost& cost : outcome.costs) {
    stages.push_back({{"stage", cost.stage},
                      {"seconds", cost.seconds},
                      {"peak_memory_mb", cost.peak_memory_mb}});
  }
  const CalibrationResiduals& residuals = *outcome.calibration.residuals;
  nlohmann::ordered_json result = {
      {"out", arguments.out.string()}, {"calibrated", outcome.calibration.cameras.size()},
      {"of", outcome.cameras},         {"shots_used", outcome.shots_used},
      {"shots", outcome.shots},        {"corners", residuals.corners},
      {"kept", residuals.kept},        {"rms_px", residuals.rms_px},
      {"noise", residuals.noise}};
  if (residuals.held_out_rms_px) result["held_out_rms_px"] = *residuals.held_out_rms_px;
  if (residuals.held_out_p95_px) result["held_out_p95_px"] = *residuals.held_out_p95_px;
  result["rig_frame"] = outcome.frame;
  result["rejected_markers"] = RejectedJson(outcome.rejected);
  result["notes"] = outcome.notes;
  if (outcome.changes) result["changes"] = *outcome.changes;
  result["stages"] = stages;
  std::printf("%s\n", result.dump(1).c_str());
}

void PrintSigmas(const Calibration& calibration) {
  double rotation = 0, position = 0, max_rotation = 0, max_position = 0, focal = 0;
  for (const CalibratedCamera& camera : calibration.cameras) {
    rotation += camera.sigma->rotation_deg;
    position += camera.sigma->position_mm;
    max_rotation = std::max(max_rotation, camera.sigma->rotation_deg);
    max_position = std::max(max_position, camera.sigma->position_mm);
    focal += 100 * camera.sigma->focal_px.value_or(0) / camera.intrinsics.MeanFocal_px();
  }
  const auto count = static_cast<double>(calibration.cameras.size());
  std::printf(
      "uncertainty (1 sigma)  mean %.4f deg, %.3f mm, focal length %.4f %%; largest %.4f "
      "deg, %.3f mm\n",
      rotation / count, position / count, focal / count, max_rotation, max_position);
}

void PrintTable(const CalibrateArguments& arguments, const Outcome& outcome) {
  const CalibrationResiduals& residuals = *outcome.calibration.residuals;
  std::printf("Calibrated %zu of %zu cameras from %zu of %zu shots\n",
              outcome.calibration.cameras.size(), outcome.cameras, outcome.shots_used,
              outcome.shots);
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
  PrintSigmas(outcome.calibration);
  if (residuals.half_split_rotation_ratio) {
    std::printf(
        "two halves             differ by %.2f (rotation), %.2f (position) times what the "
        "uncertainty says\n",
        *residuals.half_split_rotation_ratio, *residuals.half_split_position_ratio);
  }
  std::printf("rig frame              %s\n", outcome.frame.c_str());
  for (const rig::RejectedCount& rejected : outcome.rejected) {
    std::printf("markers not used       %s\n", RejectedText(rejected).c_str());
  }
  for (const std::string& note : outcome.notes) std::printf("  note: %s\n", note.c_str());
  if (outcome.changes && outcome.changes->empty()) {
    std::printf("Since the calibration compared with, no camera moved.\n");
  } else if (outcome.changes) {
    std::printf("Since the calibration compared with:\n");
    for (const std::string& change : *outcome.changes) std::printf("  %s\n", change.c_str());
  }
  for (const StageCost& cost : outcome.costs) {
    std::printf("  %-16s %8.2f s %8.0f MB\n", cost.stage.c_str(), cost.seconds,
                cost.peak_memory_mb);
  }
  std::printf("Calibration: %s\n", arguments.out.c_str());
  if (arguments.report) std::printf("Report:      %s\n", arguments.report->c_str());
}

/// The error, with the file that it is about.
Status CheckFile(const Status& status, const fs::path& file) {
  return status.ok() ? status : Status(status.error().In(file.string()));
}

Status Calibrate(const CalibrateArguments& arguments, const CommonOptions& common) {
  ROTUNDA_ASSIGN_OR_RETURN(const rig::Board board, config::ReadBoard(arguments.board));
  ROTUNDA_ASSIGN_OR_RETURN(const auto intrinsics_from, ReadOptional(arguments.intrinsics_from));
  ROTUNDA_ASSIGN_OR_RETURN(const auto frame_from, ReadOptional(arguments.frame_from));
  ROTUNDA_ASSIGN_OR_RETURN(const auto before, ReadOptional(arguments.compare));
  ROTUNDA_ASSIGN_OR_RETURN(const rig::ShotPictures pictures, rig::FindShots(arguments.framesets));

  if (before) {
    ROTUNDA_RETURN_IF_ERROR(CheckFile(
        rig::CheckShared(pictures.cameras, *before, rig::kMinComparedCameras), *arguments.compare));
  }
  if (frame_from) {
    ROTUNDA_RETURN_IF_ERROR(
        CheckFile(rig::CheckShared(pictures.cameras, *frame_from, 1), *arguments.frame_from));
  }

  ThreadPool threads(common.threads);
  ProgressLine progress(!common.json);
  RunContext context{threads, common.stop, [&](std::string_view stage, size_t done, size_t total) {
                       progress.Update(stage, done, total);
                     }};
  ROTUNDA_ASSIGN_OR_RETURN(const rig::BoardSightings sightings,
                           rig::DetectBoards(pictures, board, {}, context));
  rig::RigCalibrationOptions options;
  options.model = arguments.model;
  if (intrinsics_from) options.intrinsics_from = options.frame_from = &*intrinsics_from;
  if (frame_from) options.frame_from = &*frame_from;
  ROTUNDA_ASSIGN_OR_RETURN(const rig::RigCalibration result,
                           rig::CalibrateRig(board, sightings, options, context));
  ROTUNDA_ASSIGN_OR_RETURN(const rig::CrossValidation validation,
                           rig::CrossValidate(board, result, {}, context));
  const auto checks = rig::CheckCameras(board, sightings, result, {});

  Outcome outcome;
  outcome.calibration = rig::ToCalibration(board, sightings, result, &validation);
  outcome.calibration.created_at = CreatedAt(sightings);
  outcome.calibration.id = IdOf(outcome.calibration.created_at);
  outcome.cameras = sightings.cameras.size();
  outcome.shots = sightings.shots.size();
  for (const auto& shot : result.model.rig_from_board) outcome.shots_used += shot.has_value();
  outcome.frame = result.frame;
  outcome.rejected = rig::CountRejected(sightings);
  outcome.notes = Notes(sightings, result, checks);
  std::optional<rig::CalibrationComparison> comparison;
  if (before) {
    ROTUNDA_ASSIGN_OR_RETURN(comparison,
                             rig::CompareCalibrations(*before, outcome.calibration, {}));
    outcome.changes = Changes(*comparison);
  }
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "interrupted", ""};
  if (arguments.report) {
    const std::string page =
        rig::BuildCalibrationReport({board, sightings, result, outcome.calibration, checks,
                                     validation, comparison, outcome.notes});
    ROTUNDA_RETURN_IF_ERROR(WriteFileAtomically(*arguments.report, page));
  }
  ROTUNDA_RETURN_IF_ERROR(WriteCalibration(outcome.calibration, arguments.out));
  outcome.costs = progress.Finish();
  if (common.json) {
    PrintJson(arguments, outcome);
  } else {
    PrintTable(arguments, outcome);
  }
  return {};
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
  command
      ->add_option("--fix-intrinsics-from", arguments->intrinsics_from,
                   "Keep the lenses of this calibration, its rig frame and the target as it was "
                   "found then: one shot is enough")
      ->type_name("FILE");
  command
      ->add_option("--frame-from", arguments->frame_from,
                   "Rig frame of this calibration (cameras that moved do not drag it); default: "
                   "the target in the shot that [rig_frame] of the board file names, else in the "
                   "first one")
      ->type_name("FILE");
  command
      ->add_option("--compare", arguments->compare,
                   "Say which cameras moved since this calibration")
      ->type_name("FILE");
  command->add_option("--report", arguments->report, "Page to write, for a browser")
      ->type_name("FILE.html");
  AddChoice<rig::LensModel>(
      command, "--model", arguments->model,
      "Lens: opencv (default, 8 parameters), opencv5 (9: k3 as well), or full-opencv (12, for "
      "strong distortion; needs corners up to the edges of every picture)",
      {{"opencv", rig::LensModel::kOpencv},
       {"opencv5", rig::LensModel::kOpencv5},
       {"full-opencv", rig::LensModel::kFullOpencv}});
  command->callback([arguments, &common, &chosen] {
    chosen = [arguments, &common] {
      const Status status = Calibrate(*arguments, common);
      return status.ok() ? kDone : Fail(status.error());
    };
  });
}

}  // namespace rotunda::cli
