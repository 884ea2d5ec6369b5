#include "daemon/calibration_request.h"

#include <nlohmann/json.hpp>
#include <set>

#include "daemon/job_request.h"
#include "daemon/store_calibrations.h"
#include "daemon/store_captures.h"
#include "rig/lens_models.h"

namespace rotunda::daemon {
namespace {

using Json = nlohmann::ordered_json;

constexpr size_t kMaxShots = 1000;

void ReadRequestFields(const JsonField& root, CalibrationRequest& request) {
  for (const JsonField& item : root["captures"].Items()) request.captures.push_back(item.String());
  if (request.captures.empty() || request.captures.size() > kMaxShots) {
    root["captures"].Refuse("ids of 1 to " + std::to_string(kMaxShots) + " captures");
  }
  std::set<std::string> ids;
  for (const std::string& id : request.captures) {
    if (!ids.insert(id).second) {
      root["captures"].Fail("capture \"" + id + "\" is named twice: it would count as two shots");
    }
  }
  request.model = ReadName(root["model"], NamesIn(rig::LensModelsByName()), request.model);
  const auto optional = [&](const char* key, std::optional<std::string>& value) {
    if (root[key].present()) value = root[key].String();
  };
  optional("frame_from", request.frame_from);
  optional("intrinsics_from", request.intrinsics_from);
  optional("compare", request.compare);
}

std::string ToBody(const CalibrationRequest& request) {
  Json body = {{"captures", request.captures}, {"model", request.model}};
  if (request.frame_from) body["frame_from"] = *request.frame_from;
  if (request.intrinsics_from) body["intrinsics_from"] = *request.intrinsics_from;
  if (request.compare) body["compare"] = *request.compare;
  return body.dump();
}

}  // namespace

Result<CalibrationRequest> ParseCalibrationRequest(const std::string& body) {
  CalibrationRequest request;
  ROTUNDA_RETURN_IF_ERROR(
      ReadRequest(body, {"captures", "model", "frame_from", "intrinsics_from", "compare"},
                  [&](const JsonField& root) { ReadRequestFields(root, request); }));
  return request;
}

JobHandler CalibrationRequests(Store& store) {
  JobHandler handler;
  handler.check = [](const std::string& body) -> Result<std::string> {
    ROTUNDA_ASSIGN_OR_RETURN(const CalibrationRequest request, ParseCalibrationRequest(body));
    return ToBody(request);
  };
  handler.refers = [&store](const std::string& body) -> Status {
    ROTUNDA_ASSIGN_OR_RETURN(const CalibrationRequest request, ParseCalibrationRequest(body));
    for (const std::string& id : request.captures) ROTUNDA_RETURN_IF_ERROR(FindCapture(store, id));
    for (const auto& id : {request.frame_from, request.intrinsics_from, request.compare}) {
      if (id) ROTUNDA_RETURN_IF_ERROR(FindCalibration(store, *id));
    }
    return {};
  };
  return handler;
}

}  // namespace rotunda::daemon
