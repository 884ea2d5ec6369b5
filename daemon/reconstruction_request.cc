#include "daemon/reconstruction_request.h"

#include <nlohmann/json.hpp>

#include "daemon/job_request.h"
#include "daemon/store_calibrations.h"
#include "daemon/store_captures.h"

namespace rotunda::daemon {
namespace {

using Json = nlohmann::ordered_json;

void ReadRequestFields(const JsonField& root, ReconstructionRequest& request) {
  sfm::RunChoices& choices = request.choices;
  request.capture = root["capture"].String();
  if (root["calibration"].present()) request.calibration = root["calibration"].String();
  choices.method = ReadChoice(root["method"], sfm::MethodsByName(), choices.method);
  choices.preset = ReadChoice(root["preset"], RequestPresets(), choices.preset);
  choices.pairs = ReadChoice(root["pairs"], sfm::PairSelectionsByName(), choices.pairs);
  choices.calibration_prior =
      ReadChoice(root["prior"], sfm::PriorsByName(), choices.calibration_prior);
  const JsonField refine = root["refine_intrinsics"];
  if (refine.present()) choices.refine_intrinsics = refine.Bool();
  if (const Status valid = choices.Validate(); !valid.ok()) {
    root[valid.error().context].Fail(valid.error().message);
  }
}

std::string ToBody(const ReconstructionRequest& request) {
  const sfm::RunChoices& choices = request.choices;
  Json body = {{"capture", request.capture}};
  if (request.calibration) body["calibration"] = *request.calibration;
  body["method"] = NameIn(sfm::MethodsByName(), choices.method);
  body["preset"] = NameIn(RequestPresets(), choices.preset);
  body["pairs"] = NameIn(sfm::PairSelectionsByName(), choices.pairs);
  body["prior"] = NameIn(sfm::PriorsByName(), choices.calibration_prior);
  if (choices.refine_intrinsics) body["refine_intrinsics"] = *choices.refine_intrinsics;
  return body.dump();
}

/// Whether what a checked request refers to is there.
Status CheckReferences(Store& store, const ReconstructionRequest& request) {
  ROTUNDA_ASSIGN_OR_RETURN(const CaptureRecord capture, FindCapture(store, request.capture));
  if (request.calibration) {
    ROTUNDA_RETURN_IF_ERROR(FindCalibration(store, *request.calibration));
  }
  if (!request.choices.calibration_prior || request.calibration || capture.calibration) return {};
  return Error{ErrorCode::kInvalidArgument,
               "needs a calibration, and none was in force at capture \"" + capture.id +
                   "\": name one as \"calibration\"",
               sfm::kPriorOption};
}

}  // namespace

const std::map<std::string, sfm::Preset>& RequestPresets() {
  static const auto presets = [] {
    auto all = sfm::PresetsByName();
    std::erase_if(all, [](const auto& each) { return each.second == sfm::Preset::kLiteral; });
    return all;
  }();
  return presets;
}

Result<ReconstructionRequest> ParseReconstructionRequest(const std::string& body) {
  ReconstructionRequest request;
  ROTUNDA_RETURN_IF_ERROR(ReadRequest(
      body, {"calibration", "method", "preset", "pairs", "prior", "refine_intrinsics"},
      [&](const JsonField& root) { ReadRequestFields(root, request); }, "capture"));
  return request;
}

std::string ReconstructionBody(const std::string& capture, const sfm::RunChoices& choices) {
  return ToBody({capture, std::nullopt, choices});
}

JobHandler ReconstructionRequests(Store& store) {
  JobHandler handler;
  handler.check = [](const std::string& body) -> Result<std::string> {
    ROTUNDA_ASSIGN_OR_RETURN(const ReconstructionRequest request, ParseReconstructionRequest(body));
    return ToBody(request);
  };
  handler.refers = [&store](const std::string& body) -> Status {
    ROTUNDA_ASSIGN_OR_RETURN(const ReconstructionRequest request, ParseReconstructionRequest(body));
    return CheckReferences(store, request);
  };
  return handler;
}

}  // namespace rotunda::daemon
