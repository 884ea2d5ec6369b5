#pragma once

#include <map>
#include <optional>
#include <string>

#include "daemon/jobs.h"
#include "daemon/store.h"
#include "sfm/core/result.h"
#include "sfm/run_choices.h"

namespace rotunda::daemon {

/// POST /v1/captures/{id}/reconstructions, its body with "capture" added: {"capture": id,
/// "calibration": id?, "method"?, "preset"?, "pairs"?, "prior"?: names in sfm/run_choices.h
/// (preset: RequestPresets()), "refine_intrinsics": bool?}.
struct ReconstructionRequest {
  std::string capture;
  std::optional<std::string> calibration;
  sfm::RunChoices choices;
};

/// All but the literal one, which is to compare methods with.
const std::map<std::string, sfm::Preset>& RequestPresets();

/// kInvalidArgument names the field.
Result<ReconstructionRequest> ParseReconstructionRequest(const std::string& body);

/// The body of the request to reconstruct a capture, with the calibration in force at the shot.
std::string ReconstructionBody(const std::string& capture, const sfm::RunChoices& choices = {});

/// What a queue needs to take such requests, without what does the work (`run`): that is in
/// reconstruction_job.h, with all the libraries it takes. `store` outlives the handler.
JobHandler ReconstructionRequests(Store& store);

}  // namespace rotunda::daemon
