#include "daemon/reconstruction_job.h"

#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

#include "daemon/reconstruction_request.h"
#include "daemon/store_calibrations.h"
#include "daemon/store_captures.h"
#include "daemon/store_reconstructions.h"
#include "sfm/core/file_io.h"
#include "sfm/presets.h"

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

std::string ResultOf(const ReconstructionRecord& record, const std::vector<std::string>& notes) {
  Json result = {
      {"reconstruction", record.id}, {"capture", record.capture}, {"method", record.method}};
  if (!record.preset.empty()) result["preset"] = record.preset;
  result.update({{"prior", record.prior},
                 {"registered", record.registered},
                 {"of", record.of},
                 {"rms_px", record.rms_px},
                 {"verdict", record.verdict},
                 {"verdict_reason", record.verdict_reason},
                 {"notes", notes}});
  return result.dump(-1, ' ', false, Json::error_handler_t::replace);
}

/// The page of a calibration that a frame set has a copy of.
std::string PageOf(const Store& store, const Calibration& calibration) {
  if (!IsStoreId(calibration.id)) return "";
  const auto page = ReadFile(store.CalibrationFolder(calibration.id) / "report.html");
  return page ? *page : "";
}

Result<ReconstructionTask> TaskOf(Store& store, const ReconstructionRequest& request,
                                  const std::string& id) {
  ROTUNDA_ASSIGN_OR_RETURN(const CaptureRecord capture, FindCapture(store, request.capture));
  ReconstructionTask task;
  ROTUNDA_ASSIGN_OR_RETURN(task.set, ReadFrameSet(store.CaptureFolder(capture.id)));
  task.set.id = capture.id;  // a set that was copied here may have another
  std::optional<fs::path> calibration = std::nullopt;
  if (request.calibration) {
    ROTUNDA_ASSIGN_OR_RETURN(const CalibrationRecord wanted,
                             FindCalibration(store, *request.calibration));
    calibration = store.CalibrationFolder(wanted.id) / "calibration.json";
  }
  ROTUNDA_ASSIGN_OR_RETURN(task.in_force, CalibrationOf(task.set.folder, calibration));
  if (task.in_force.calibration && task.in_force.page.empty()) {
    task.in_force.page = PageOf(store, *task.in_force.calibration);
  }
  task.options = sfm::OptionsOf(request.choices);
  task.out = store.ReconstructionFolder(id);
  return task;
}

Result<std::string> Run(Store& store, int threads, const JobRecord& job, JobContext& context) {
  ROTUNDA_ASSIGN_OR_RETURN(const ReconstructionRequest request,
                           ParseReconstructionRequest(job.body));
  // First: the name of what is made is made of it.
  ROTUNDA_RETURN_IF_ERROR(FindCapture(store, request.capture));
  std::string id = job.product;
  std::error_code ignored;
  if (id.empty()) {
    ROTUNDA_ASSIGN_OR_RETURN(id, FreeReconstructionId(store, request.capture));
    ROTUNDA_RETURN_IF_ERROR(SetJobProduct(store, job.number, id));
  } else if (fs::exists(store.ReconstructionFolder(id) / "poses.json", ignored)) {
    // The run before had come to its end; whether to its row, too, does not matter.
    ROTUNDA_ASSIGN_OR_RETURN(const ReconstructionRecord made, RecordReconstruction(store, id));
    return ResultOf(made, {});
  }
  ROTUNDA_ASSIGN_OR_RETURN(const ReconstructionTask task, TaskOf(store, request, id));
  ThreadPool pool(threads);
  RunContext run{pool, context.stop, context.progress};
  ROTUNDA_ASSIGN_OR_RETURN(const sfm::PipelineResult made, MakeReconstruction(task, run));
  ROTUNDA_ASSIGN_OR_RETURN(const ReconstructionRecord record, RecordReconstruction(store, id));
  return ResultOf(record, made.notes);
}

}  // namespace

Result<sfm::CalibrationInForce> CalibrationOf(const fs::path& frameset,
                                              const std::optional<fs::path>& calibration) {
  sfm::CalibrationInForce in_force;
  std::error_code ignored;
  fs::path file = calibration.value_or(frameset / "calibration.json");
  if (!calibration && !fs::exists(file, ignored)) return in_force;
  ROTUNDA_ASSIGN_OR_RETURN(in_force.calibration, ReadCalibration(file));
  const fs::path page = file.replace_extension(".html");
  if (fs::exists(page, ignored)) {
    ROTUNDA_ASSIGN_OR_RETURN(in_force.page, ReadFile(page));
  }
  return in_force;
}

Result<sfm::PipelineResult> MakeReconstruction(const ReconstructionTask& task,
                                               RunContext& context) {
  ROTUNDA_ASSIGN_OR_RETURN(OutputFolder folder, OutputFolder::Begin(task.out));
  ROTUNDA_ASSIGN_OR_RETURN(
      sfm::PipelineResult result,
      sfm::RunPipeline(task.set, task.in_force.calibration, task.options, context));
  ROTUNDA_RETURN_IF_ERROR(sfm::WriteResult(result, task.in_force, folder.path(), context));
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "interrupted", ""};
  ROTUNDA_RETURN_IF_ERROR(folder.Commit());
  return result;
}

JobHandler MakeReconstructionHandler(Store& store, int threads) {
  JobHandler handler = ReconstructionRequests(store);
  handler.run = [&store, threads](const JobRecord& job, JobContext& context) {
    return Run(store, threads, job, context);
  };
  return handler;
}

}  // namespace rotunda::daemon
