#include "daemon/calibration_job.h"

#include <algorithm>
#include <cctype>
#include <map>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

#include "config/board_config.h"
#include "daemon/calibration_request.h"
#include "daemon/store_calibrations.h"
#include "daemon/store_captures.h"
#include "rig/calibration_report.h"
#include "rig/calibration_result.h"
#include "sfm/core/file_io.h"
#include "sfm/core/frame_set.h"

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// When the newest shot was taken; empty when the pictures do not say.
std::string NewestShot(const rig::BoardSightings& sightings) {
  std::string newest;
  for (const rig::BoardShot& shot : sightings.shots) {
    const Result<FrameSet> set = ReadFrameSet(shot.folder);
    if (set && !set->plain_folder) newest = std::max(newest, set->captured_at);
  }
  return newest;
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

Result<std::optional<Calibration>> ReadOurs(Store& store, const std::optional<std::string>& id) {
  if (!id) return std::optional<Calibration>();
  ROTUNDA_ASSIGN_OR_RETURN(const CalibrationRecord record, FindCalibration(store, *id));
  ROTUNDA_ASSIGN_OR_RETURN(
      Calibration calibration,
      ReadCalibration(store.CalibrationFolder(record.id) / "calibration.json"));
  return std::optional<Calibration>(std::move(calibration));
}

Result<CalibrationTask> TaskOf(Store& store, const CalibrationRequest& request,
                               const fs::path& board) {
  CalibrationTask task;
  ROTUNDA_ASSIGN_OR_RETURN(task.board, config::ReadBoard(board));
  for (const std::string& id : request.captures) {
    ROTUNDA_ASSIGN_OR_RETURN(const CaptureRecord capture, FindCapture(store, id));
    task.framesets.push_back(store.CaptureFolder(capture.id));
  }
  task.model = rig::LensModelsByName().at(request.model);
  ROTUNDA_ASSIGN_OR_RETURN(task.frame_from, ReadOurs(store, request.frame_from));
  ROTUNDA_ASSIGN_OR_RETURN(task.intrinsics_from, ReadOurs(store, request.intrinsics_from));
  std::optional<std::string> compare = request.compare;
  if (!compare) {
    ROTUNDA_ASSIGN_OR_RETURN(const auto active, ActiveCalibration(store));
    if (active) compare = active->id;
  }
  ROTUNDA_ASSIGN_OR_RETURN(task.compare, ReadOurs(store, compare));
  return task;
}

/// Another rig's calibration is refused before the work.
Status CheckReference(const rig::ShotPictures& pictures, const std::optional<Calibration>& other,
                      const std::string& use, size_t least) {
  if (!other) return {};
  const Status shared = rig::CheckShared(pictures.cameras, *other, least);
  return shared.ok() ? shared : Status(shared.error().In(use + " " + other->id));
}

Status WriteFolder(const CalibrationTask& task, const CalibrationOutcome& outcome,
                   const fs::path& out) {
  ROTUNDA_ASSIGN_OR_RETURN(OutputFolder folder, OutputFolder::Begin(out));
  ROTUNDA_RETURN_IF_ERROR(
      WriteNewFile(folder.path() / "report.html", CalibrationPage(task, outcome)));
  ROTUNDA_RETURN_IF_ERROR(
      WriteNewFile(folder.path() / "calibration.json", CalibrationToJson(outcome.calibration)));
  return folder.Commit();
}

std::string ResultOf(const CalibrationOutcome& outcome) {
  const CalibrationResiduals& residuals = *outcome.calibration.residuals;
  Json result = {{"calibration", outcome.calibration.id},
                 {"calibrated", outcome.calibration.cameras.size()},
                 {"of", outcome.sightings.cameras.size()},
                 {"shots", outcome.sightings.shots.size()},
                 {"shots_used", outcome.ShotsUsed()},
                 {"corners", residuals.corners},
                 {"kept", residuals.kept},
                 {"rms_px", residuals.rms_px},
                 {"notes", outcome.notes}};
  if (const auto changes = outcome.Changes()) result["changes"] = *changes;
  return result.dump(-1, ' ', false, Json::error_handler_t::replace);
}

/// Of a calibration that the interrupted run had brought to its end.
std::string ResultOf(const CalibrationRecord& record) {
  const Json result = {{"calibration", record.id}, {"calibrated", record.cameras}};
  return result.dump();
}

Result<std::string> Run(Store& store, const CalibrationJobOptions& options, const JobRecord& job,
                        JobContext& context) {
  ROTUNDA_ASSIGN_OR_RETURN(const CalibrationRequest request, ParseCalibrationRequest(job.body));
  std::string id = job.product;
  std::error_code ignored;
  if (!id.empty() && fs::exists(store.CalibrationFolder(id) / "calibration.json", ignored)) {
    // The run before had come to its end; whether to its row, too, does not matter.
    ROTUNDA_ASSIGN_OR_RETURN(const CalibrationRecord made, RecordCalibration(store, id));
    return ResultOf(made);
  }
  ROTUNDA_ASSIGN_OR_RETURN(const CalibrationTask task, TaskOf(store, request, options.board));
  ThreadPool pool(options.threads);
  RunContext run{pool, context.stop, context.progress};
  ROTUNDA_ASSIGN_OR_RETURN(CalibrationOutcome outcome, MakeCalibration(task, run));
  if (id.empty()) {
    ROTUNDA_ASSIGN_OR_RETURN(
        id, FreeCalibrationId(store, CalibrationIdOf(outcome.calibration.created_at)));
    ROTUNDA_RETURN_IF_ERROR(SetJobProduct(store, job.number, id));
  }
  outcome.calibration.id = id;
  ROTUNDA_RETURN_IF_ERROR(WriteFolder(task, outcome, store.CalibrationFolder(id)));
  ROTUNDA_RETURN_IF_ERROR(RecordCalibration(store, id));
  return ResultOf(outcome);
}

}  // namespace

Result<CalibrationOutcome> MakeCalibration(const CalibrationTask& task, RunContext& context) {
  CalibrationOutcome outcome;
  ROTUNDA_ASSIGN_OR_RETURN(const rig::ShotPictures pictures, rig::FindShots(task.framesets));
  ROTUNDA_RETURN_IF_ERROR(
      CheckReference(pictures, task.compare, "compare", rig::kMinComparedCameras));
  ROTUNDA_RETURN_IF_ERROR(CheckReference(pictures, task.frame_from, "frame_from", 1));
  ROTUNDA_ASSIGN_OR_RETURN(outcome.sightings, rig::DetectBoards(pictures, task.board, {}, context));
  rig::RigCalibrationOptions options;
  options.model = task.model;
  if (task.intrinsics_from) options.intrinsics_from = options.frame_from = &*task.intrinsics_from;
  if (task.frame_from) options.frame_from = &*task.frame_from;
  ROTUNDA_ASSIGN_OR_RETURN(outcome.result,
                           rig::CalibrateRig(task.board, outcome.sightings, options, context));
  ROTUNDA_ASSIGN_OR_RETURN(outcome.validation,
                           rig::CrossValidate(task.board, outcome.result, {}, context));
  outcome.checks = rig::CheckCameras(task.board, outcome.sightings, outcome.result, {});

  Calibration& calibration = outcome.calibration;
  calibration =
      rig::ToCalibration(task.board, outcome.sightings, outcome.result, &outcome.validation);
  calibration.created_at = NewestShot(outcome.sightings);
  if (!calibration.created_at.empty()) calibration.id = CalibrationIdOf(calibration.created_at);
  outcome.notes = Notes(outcome.sightings, outcome.result, outcome.checks);
  if (task.compare) {
    ROTUNDA_ASSIGN_OR_RETURN(outcome.comparison,
                             rig::CompareCalibrations(*task.compare, calibration, {}));
  }
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "interrupted", ""};
  return outcome;
}

size_t CalibrationOutcome::ShotsUsed() const {
  size_t used = 0;
  for (const auto& shot : result.model.rig_from_board) used += shot.has_value();
  return used;
}

std::optional<std::vector<std::string>> CalibrationOutcome::Changes() const {
  if (!comparison) return std::nullopt;
  return rig::ChangesIn(*comparison);
}

std::string CalibrationPage(const CalibrationTask& task, const CalibrationOutcome& outcome) {
  return rig::BuildCalibrationReport({task.board, outcome.sightings, outcome.result,
                                      outcome.calibration, outcome.checks, outcome.validation,
                                      outcome.comparison, outcome.notes});
}

std::string CalibrationIdOf(const std::string& created_at) {
  std::string id = "charuco-";
  for (const char c : created_at) {
    if (std::isalnum(static_cast<unsigned char>(c)) != 0) id += c;
  }
  return id;
}

JobHandler MakeCalibrationHandler(Store& store, CalibrationJobOptions options) {
  JobHandler handler = CalibrationRequests(store);
  handler.run = [&store, options](const JobRecord& job, JobContext& context) {
    return Run(store, options, job, context);
  };
  return handler;
}

}  // namespace rotunda::daemon
