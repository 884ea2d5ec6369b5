#include "daemon/reconstruction_request.h"

#include <nlohmann/json.hpp>

#include "daemon/job_request.h"
#include "daemon/store_calibrations.h"
#include "daemon/store_captures.h"

namespace rotunda::daemon {
namespace {

using Json = nlohmann::ordered_json;

std::string ReadChoice(const JsonField& field, const std::string& first,
                       const std::string& second) {
  if (!field.present()) return first;
  std::string choice = field.String();
  if (choice != first && choice != second) field.Refuse("\"" + first + "\" or \"" + second + "\"");
  return choice;
}

std::string ToBody(const ReconstructionRequest& request) {
  Json body = {{"capture", request.capture}};
  if (request.calibration) body["calibration"] = *request.calibration;
  body["method"] = request.method;
  body["pairs"] = request.pairs;
  if (request.refine_intrinsics) body["refine_intrinsics"] = *request.refine_intrinsics;
  return body.dump();
}

}  // namespace

Result<ReconstructionRequest> ParseReconstructionRequest(const std::string& body) {
  ReconstructionRequest request;
  ROTUNDA_RETURN_IF_ERROR(
      ReadRequest(body, {"capture", "calibration", "method", "pairs", "refine_intrinsics"},
                  [&](const JsonField& root) {
                    request.capture = root["capture"].String();
                    if (root["calibration"].present())
                      request.calibration = root["calibration"].String();
                    request.method = ReadChoice(root["method"], request.method, kPlainMethod);
                    request.pairs = ReadChoice(root["pairs"], request.pairs, kNeighbourPairs);
                    const JsonField refine = root["refine_intrinsics"];
                    if (refine.present()) request.refine_intrinsics = refine.Bool();
                  }));
  return request;
}

std::string ReconstructionBody(const std::string& capture) {
  ReconstructionRequest request;
  request.capture = capture;
  return ToBody(request);
}

JobHandler ReconstructionRequests(Store& store) {
  JobHandler handler;
  handler.check = [](const std::string& body) -> Result<std::string> {
    ROTUNDA_ASSIGN_OR_RETURN(const ReconstructionRequest request, ParseReconstructionRequest(body));
    return ToBody(request);
  };
  handler.refers = [&store](const std::string& body) -> Status {
    ROTUNDA_ASSIGN_OR_RETURN(const ReconstructionRequest request, ParseReconstructionRequest(body));
    ROTUNDA_RETURN_IF_ERROR(FindCapture(store, request.capture));
    if (request.calibration) {
      ROTUNDA_RETURN_IF_ERROR(FindCalibration(store, *request.calibration));
    }
    return {};
  };
  return handler;
}

}  // namespace rotunda::daemon
