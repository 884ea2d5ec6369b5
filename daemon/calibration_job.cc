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
#include "rig/board.h"
#include "rig/calibration_doubts.h"
#include "rig/calibration_report.h"
#include "rig/calibration_result.h"
#include "sfm/core/file_io.h"
#include "sfm/core/frame_set.h"
#include "sfm/core/name_list.h"

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
  for (const auto& [advice, names] : cameras) lines.push_back(Joined(names) + ": " + advice);
  return lines;
}

/// Pictures that are there and cannot be used, by kind of reason ("cannot be read: ...").
void AddDamaged(const rig::BoardSightings& sightings, std::vector<std::string>& notes) {
  struct Damage {
    std::vector<std::string> pictures;
    std::string reason;  // of the first
  };
  std::map<std::string, Damage> kinds;
  for (size_t s = 0; s < sightings.shots.size(); ++s) {
    for (size_t c = 0; c < sightings.cameras.size(); ++c) {
      const rig::BoardSighting& sighting = sightings.sightings[s][c];
      if (sighting.picture.empty() || sighting.detection) continue;
      Damage& damage = kinds[sighting.missing.substr(0, sighting.missing.find(':'))];
      if (damage.pictures.empty()) damage.reason = sighting.missing;
      damage.pictures.push_back(sightings.cameras[c].camera + " in " + sightings.shots[s].id);
    }
  }
  for (const auto& [kind, damage] : kinds) {
    notes.push_back(damage.pictures.size() == 1
                        ? damage.pictures[0] + " was left out: " + damage.reason
                        : ListOfNames(damage.pictures) + " were left out: " + damage.reason +
                              " (the first)");
  }
}

/// Cameras, shots and pictures that are not in the result. With the board file in doubt, what does
/// not fit is told in one note, since that may explain it.
void AddLeftOut(const rig::BoardSightings& sightings, const rig::RigCalibration& result,
                bool board_doubted, std::vector<std::string>& notes) {
  for (size_t c = 0; c < sightings.cameras.size(); ++c) {
    const std::string& problem = result.camera_problem[c];
    if (problem.empty()) continue;
    notes.push_back(sightings.cameras[c].camera + " is not calibrated" +
                    (board_doubted ? " (which the board file may explain)" : "") + ": " + problem);
  }
  for (size_t s = 0; s < sightings.shots.size(); ++s) {
    if (!result.shot_problem[s].empty()) {
      notes.push_back(sightings.shots[s].id + " was left out: " + result.shot_problem[s]);
    }
  }
  std::vector<std::string> pictures;
  for (const rig::DroppedPicture& dropped : result.dropped) {
    if (!dropped.camera) continue;
    pictures.push_back(sightings.cameras[*dropped.camera].camera + " in " +
                       sightings.shots[dropped.shot].id);
    if (!board_doubted) notes.push_back(pictures.back() + " was left out: " + dropped.reason);
  }
  if (board_doubted && !pictures.empty()) {
    notes.push_back("left out, as they do not fit (which the board file may explain): " +
                    ListOfNames(pictures));
  }
}

bool IsOfThisTarget(const CalibrationTask& task, const EarlierCalibration& other) {
  return rig::CheckSameTarget(task.board, other.calibration, other.name).ok();
}

/// Faces that no picture shows. One that an earlier calibration found need not be seen again.
void AddUnseenFaces(const rig::Board& board, const rig::RigCalibration& result,
                    std::vector<std::string>& notes) {
  if (!result.free.intrinsics) return;
  std::vector<std::string> unseen;
  for (size_t f = 0; f < board.faces.size(); ++f) {
    if (!result.uncertainty.faces[f]) unseen.push_back("'" + board.faces[f].name + "'");
  }
  if (unseen.empty()) return;
  notes.push_back((unseen.size() == 1 ? "face " : "faces ") + ListOfNames(unseen) +
                  " of the target: no picture shows enough of it, so where it is was not found and "
                  "is not in the calibration; if the cameras are to see it, tilt the target or "
                  "place it lower");
}

/// The calibration whose cameras this one's should fit as well as.
const Calibration* Reference(const CalibrationTask& task, const CalibrationOutcome& outcome) {
  if (task.intrinsics_from) return &task.intrinsics_from->calibration;
  const bool same = outcome.comparison && IsOfThisTarget(task, *task.compare);
  return same ? &task.compare->calibration : nullptr;
}

/// Compares with the earlier calibration. The calibration is made, so whatever is wrong with that
/// is a note; empty when nothing is.
std::string CompareWithEarlier(const CalibrationTask& task, CalibrationOutcome& outcome) {
  if (!task.compare) return "";
  auto comparison = rig::CompareCalibrations(task.compare->calibration, outcome.calibration, {});
  if (!comparison) {
    return "not compared with " + task.compare->name + ": " + comparison.error().ToString();
  }
  for (const std::string& camera : comparison->only_before) {
    const auto& shown = outcome.sightings.cameras;
    const bool took_part = std::any_of(
        shown.begin(), shown.end(), [&](const auto& sighted) { return sighted.camera == camera; });
    if (took_part) comparison->not_calibrated.push_back(camera);
  }
  outcome.comparison = *std::move(comparison);
  const Status same =
      rig::CheckSameTarget(task.board, task.compare->calibration, task.compare->name);
  if (same.ok()) return "";
  return "compared with a calibration of another target: " +
         same.error().In(task.board_name).ToString();
}

/// What explains most comes first.
std::vector<std::string> Notes(const CalibrationTask& task, const CalibrationOutcome& outcome) {
  const rig::RigCalibration& result = outcome.result;
  std::vector<std::string> notes;
  const std::string doubt = rig::DoubtOnBoard(task.board, outcome.sightings, &result, {});
  if (!doubt.empty()) notes.push_back(task.board_name + " " + doubt);
  for (std::string& fit :
       rig::DoubtsOnFit(outcome.calibration, outcome.checks, Reference(task, outcome), {})) {
    notes.push_back(std::move(fit));
  }
  if (!result.frame_problem.empty()) notes.push_back(result.frame_problem);
  AddDamaged(outcome.sightings, notes);
  AddLeftOut(outcome.sightings, result, !doubt.empty(), notes);
  AddUnseenFaces(task.board, result, notes);
  if (doubt.empty()) {  // else it would be of cameras with which nothing may be wrong
    for (std::string& advice : Advice(outcome.sightings, outcome.checks)) {
      notes.push_back(std::move(advice));
    }
  }
  if (!task.not_compared.empty()) notes.push_back(task.not_compared);
  return notes;
}

Result<std::optional<EarlierCalibration>> ReadOurs(Store& store,
                                                   const std::optional<std::string>& id) {
  if (!id) return std::optional<EarlierCalibration>();
  ROTUNDA_ASSIGN_OR_RETURN(const CalibrationRecord record, FindCalibration(store, *id));
  ROTUNDA_ASSIGN_OR_RETURN(
      Calibration calibration,
      ReadCalibration(store.CalibrationFolder(record.id) / "calibration.json"));
  return std::optional<EarlierCalibration>({std::move(calibration), record.id});
}

/// The calibration in force, as nobody asked for another. One that cannot be read is a note.
Status CompareWithActive(Store& store, CalibrationTask& task) {
  ROTUNDA_ASSIGN_OR_RETURN(const auto active, ActiveCalibration(store));
  if (!active) return {};
  auto compare = ReadOurs(store, active->id);
  if (compare) {
    task.compare = *std::move(compare);
  } else {
    task.not_compared = "not compared with the calibration in force, " + active->id + ": " +
                        compare.error().ToString();
  }
  return {};
}

Result<CalibrationTask> TaskOf(Store& store, const CalibrationRequest& request,
                               const fs::path& board) {
  CalibrationTask task;
  ROTUNDA_ASSIGN_OR_RETURN(task.board, config::ReadBoard(board));
  task.board_name = board.string();
  for (const std::string& id : request.captures) {
    ROTUNDA_ASSIGN_OR_RETURN(const CaptureRecord capture, FindCapture(store, id));
    task.framesets.push_back(store.CaptureFolder(capture.id));
  }
  task.model = rig::LensModelsByName().at(request.model);
  ROTUNDA_ASSIGN_OR_RETURN(task.frame_from, ReadOurs(store, request.frame_from));
  ROTUNDA_ASSIGN_OR_RETURN(task.intrinsics_from, ReadOurs(store, request.intrinsics_from));
  task.compare_asked_for = request.compare.has_value();
  if (task.compare_asked_for) {
    ROTUNDA_ASSIGN_OR_RETURN(task.compare, ReadOurs(store, request.compare));
  } else {
    ROTUNDA_RETURN_IF_ERROR(CompareWithActive(store, task));
  }
  return task;
}

/// Another rig's calibration is refused before the work.
Status CheckReference(const rig::ShotPictures& pictures,
                      const std::optional<EarlierCalibration>& other, const std::string& use,
                      size_t least) {
  if (!other) return {};
  const Status shared = rig::CheckShared(pictures.cameras, other->calibration, least);
  return shared.ok() ? shared : Status(shared.error().In(use + " " + other->name));
}

/// What was kept or is compared with must be of the same target.
Status CheckTarget(const CalibrationTask& task, const std::optional<EarlierCalibration>& other) {
  if (!other) return {};
  const Status same = rig::CheckSameTarget(task.board, other->calibration, other->name);
  return same.ok() ? same : Status(same.error().In(task.board_name));
}

Status CheckKept(const CalibrationTask& task, const std::vector<rig::SightedCamera>& cameras) {
  if (!task.intrinsics_from) return {};
  const Status kept = rig::CheckKeptLenses(cameras, task.intrinsics_from->calibration);
  return kept.ok() ? kept : Status(kept.error().In(task.intrinsics_from->name));
}

/// All that can be refused before pictures are read.
Status CheckTask(const CalibrationTask& task, const rig::ShotPictures& pictures) {
  if (!task.frame_from && !task.intrinsics_from) {  // else the frame is an earlier calibration's
    const Status frame = rig::CheckFrameShot(pictures.shots, task.board.rig_frame);
    if (!frame.ok()) return frame.error().In(task.board_name);
  }
  if (task.compare_asked_for) {
    ROTUNDA_RETURN_IF_ERROR(
        CheckReference(pictures, task.compare, "compare", rig::kMinComparedCameras));
    ROTUNDA_RETURN_IF_ERROR(CheckTarget(task, task.compare));
  }
  ROTUNDA_RETURN_IF_ERROR(CheckReference(pictures, task.frame_from, "frame_from", 1));
  ROTUNDA_RETURN_IF_ERROR(CheckTarget(task, task.intrinsics_from));
  return CheckKept(task, pictures.cameras);
}

/// Why there is no calibration: the board file, when the pictures contradict it.
Error Explained(const CalibrationTask& task, const CalibrationOutcome& outcome,
                const Error& error) {
  const std::string doubt = error.code == ErrorCode::kCancelled
                                ? ""
                                : rig::DoubtOnBoard(task.board, outcome.sightings, nullptr, {});
  if (doubt.empty()) return error;
  return {error.code, doubt + " (" + error.ToString() + ")", task.board_name};
}

Result<rig::RigCalibration> Solve(const CalibrationTask& task, const rig::BoardSightings& sightings,
                                  RunContext& context) {
  rig::RigCalibrationOptions options;
  options.model = task.model;
  if (task.intrinsics_from) {
    options.intrinsics_from = options.frame_from = &task.intrinsics_from->calibration;
  }
  if (task.frame_from) options.frame_from = &task.frame_from->calibration;
  return rig::CalibrateRig(task.board, sightings, options, context);
}

/// What made_from.json says.
std::string MadeFrom(const CalibrationTask& task, const CalibrationRequest& request) {
  Json made_from = {{"captures", request.captures}, {"board", task.board.name}};
  if (!request.intrinsics_from) made_from["model"] = request.model;
  if (request.frame_from) made_from["frame_from"] = *request.frame_from;
  if (request.intrinsics_from) made_from["intrinsics_from"] = *request.intrinsics_from;
  return made_from.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

Status WriteFolder(const CalibrationTask& task, const CalibrationOutcome& outcome,
                   const std::string& made_from, const fs::path& out) {
  ROTUNDA_ASSIGN_OR_RETURN(OutputFolder folder, OutputFolder::Begin(out));
  ROTUNDA_RETURN_IF_ERROR(
      WriteNewFile(folder.path() / "report.html", CalibrationPage(task, outcome)));
  ROTUNDA_RETURN_IF_ERROR(
      WriteNewFile(folder.path() / "calibration.json", CalibrationToJson(outcome.calibration)));
  ROTUNDA_RETURN_IF_ERROR(WriteNewFile(folder.path() / kMadeFromName, made_from));
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
  outcome.calibration.created_at = store.Now();  // only the id is of the newest shot
  ROTUNDA_RETURN_IF_ERROR(
      WriteFolder(task, outcome, MadeFrom(task, request), store.CalibrationFolder(id)));
  ROTUNDA_RETURN_IF_ERROR(RecordCalibration(store, id));
  return ResultOf(outcome);
}

}  // namespace

Result<CalibrationOutcome> MakeCalibration(const CalibrationTask& task, RunContext& context) {
  CalibrationOutcome outcome;
  ROTUNDA_ASSIGN_OR_RETURN(const rig::ShotPictures pictures, rig::FindShots(task.framesets));
  ROTUNDA_RETURN_IF_ERROR(CheckTask(task, pictures));
  ROTUNDA_ASSIGN_OR_RETURN(outcome.sightings, rig::DetectBoards(pictures, task.board, {}, context));
  ROTUNDA_RETURN_IF_ERROR(CheckKept(task, outcome.sightings.cameras));  // sizes are known now
  Result<rig::RigCalibration> result = Solve(task, outcome.sightings, context);
  if (!result) return Explained(task, outcome, result.error());
  outcome.result = *std::move(result);
  Result<rig::CrossValidation> validation =
      rig::CrossValidate(task.board, outcome.result, {}, context);
  if (!validation) return Explained(task, outcome, validation.error());
  outcome.validation = *std::move(validation);
  outcome.checks = rig::CheckCameras(task.board, outcome.sightings, outcome.result, {});

  Calibration& calibration = outcome.calibration;
  calibration =
      rig::ToCalibration(task.board, outcome.sightings, outcome.result, &outcome.validation);
  calibration.created_at = NewestShot(outcome.sightings);
  if (!calibration.created_at.empty()) calibration.id = CalibrationIdOf(calibration.created_at);
  const std::string doubtful_comparison = CompareWithEarlier(task, outcome);
  outcome.notes = Notes(task, outcome);
  if (!doubtful_comparison.empty()) outcome.notes.push_back(doubtful_comparison);
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
