#include <algorithm>

#include "daemon/api_answers.h"
#include "daemon/store_calibrations.h"
#include "daemon/store_reconstructions.h"

namespace rotunda::daemon {
namespace {

using Json = nlohmann::ordered_json;

HttpResponse List(const ApiParts& parts, const ApiRequest& request) {
  const Result<Page> page = PageOf(request);
  return page ? JsonAnswer(ListCalibrations(parts.store, *page)) : Problem(page.error());
}

HttpResponse File(const ApiParts& parts, const std::string& id, const std::string& file,
                  const std::string& content_type) {
  const Result<CalibrationRecord> calibration = FindCalibration(parts.store, id);
  if (!calibration) return Problem(calibration.error());
  return FileAnswer(parts.store.CalibrationFolder(id) / file, content_type);
}

HttpResponse Activate(Store& store, const std::string& id) {
  return BulkAnswer([&store, id] { return JsonAnswer(ActivateCalibration(store, id)); });
}

/// A camera that is not configured may have been: then it has a history.
HttpResponse OneCamerasDrift(const ApiParts& parts, const std::string& camera, const Page& page) {
  const auto history = DriftHistory(parts.store, camera, page);
  const std::vector<std::string> configured = parts.station.CameraNames();
  const bool is_configured =
      std::find(configured.begin(), configured.end(), camera) != configured.end();
  if (history && history->items.empty() && page.after.empty() && !is_configured) {
    return Problem(404, "there is no camera '" + camera + "', and none of this name has been");
  }
  return JsonAnswer(history);
}

HttpResponse Drift(const ApiParts& parts, const ApiRequest& request) {
  const Result<Page> page = PageOf(request);
  if (!page) return Problem(page.error());
  if (const auto camera = request.query.find("camera"); camera != request.query.end()) {
    return OneCamerasDrift(parts, camera->second, *page);
  }
  const auto active = ActiveCalibration(parts.store);
  if (!active) return Problem(active.error());
  const auto drift = DriftNow(parts.store);
  if (!drift) return Problem(drift.error());
  Json answer = Json::object();
  if (*active) answer["calibration"] = (*active)->id;
  answer["cameras"] = ItemsJson(*drift);
  return JsonAnswer(answer);
}

std::vector<QueryParameter> DriftQuery() {
  std::vector<QueryParameter> query = PageQuery();
  query.push_back({"camera", "The history of this camera, newest first, instead of all cameras"});
  return query;
}

}  // namespace

std::vector<Route> CalibrationRoutes(const ApiParts& parts) {
  return {{.method = "POST",
           .path = "/v1/calibrations",
           .role = Role::kOperator,
           .operation = "startCalibration",
           .summary = "Queue a calibration from captures of the target",
           .request_schema = "CalibrationRequest",
           .status = 202,
           .schema = "Job",
           .headers = {JobLocation()},
           .handle =
               [parts](const ApiRequest& request) {
                 return SubmitJob(parts, JobKind::kCalibration, BodyObject(request.http.body),
                                  request);
               }},
          {.method = "GET",
           .path = "/v1/calibrations",
           .operation = "listCalibrations",
           .summary = "Calibrations, newest first",
           .query = PageQuery(),
           .schema = "CalibrationPage",
           .handle = [parts](const ApiRequest& request) { return List(parts, request); }},
          {.method = "GET",
           .path = "/v1/calibrations/{calibration}",
           .operation = "getCalibration",
           .summary = "One calibration",
           .schema = "Calibration",
           .handle =
               [parts](const ApiRequest& request) {
                 return JsonAnswer(FindCalibration(parts.store, request.path.at("calibration")));
               }},
          {.method = "GET",
           .path = "/v1/calibrations/{calibration}/calibration.json",
           .operation = "getCalibrationFile",
           .summary = "Lenses, poses and uncertainties (rotunda-calibration/1)",
           .schema = "CalibrationFile",
           .handle =
               [parts](const ApiRequest& request) {
                 return File(parts, request.path.at("calibration"), "calibration.json",
                             "application/json");
               }},
          {.method = "GET",
           .path = "/v1/calibrations/{calibration}/report",
           .operation = "getCalibrationReport",
           .summary = "The calibration's page, for a browser",
           .content_type = "text/html; charset=utf-8",
           .handle =
               [parts](const ApiRequest& request) {
                 return File(parts, request.path.at("calibration"), "report.html",
                             "text/html; charset=utf-8");
               }},
          {.method = "POST",
           .path = "/v1/calibrations/{calibration}/activate",
           .role = Role::kOperator,
           .operation = "activateCalibration",
           .summary = "Put the calibration in force",
           .schema = "Calibration",
           .handle =
               [parts](const ApiRequest& request) {
                 return Activate(parts.store, request.path.at("calibration"));
               }},
          {.method = "GET",
           .path = "/v1/drift",
           .operation = "getDrift",
           .summary = "How far cameras are from where the calibration in force has them",
           .query = DriftQuery(),
           .schema = "DriftAnswer",
           .handle = [parts](const ApiRequest& request) { return Drift(parts, request); }}};
}

}  // namespace rotunda::daemon
