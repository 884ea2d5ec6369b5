#pragma once

#include <optional>
#include <string>

#include "daemon/jobs.h"
#include "daemon/store.h"
#include "sfm/core/result.h"

namespace rotunda::daemon {

/// POST /v1/captures/{id}/reconstructions, its body with "capture" added: {"capture": id,
/// "calibration": id?, "method": "tc-sfm" | "plain"?, "pairs": "exhaustive" | "neighbours"?,
/// "refine_intrinsics": bool?}.
struct ReconstructionRequest {
  std::string capture;
  std::optional<std::string> calibration;
  std::string method = "tc-sfm";
  std::string pairs = "exhaustive";
  std::optional<bool> refine_intrinsics;
};
inline constexpr char kPlainMethod[] = "plain";
inline constexpr char kNeighbourPairs[] = "neighbours";

/// kInvalidArgument names the field.
Result<ReconstructionRequest> ParseReconstructionRequest(const std::string& body);

/// The body of the request to reconstruct a capture in the usual way.
std::string ReconstructionBody(const std::string& capture);

/// What a queue needs to take such requests, without what does the work (`run`): that is in
/// reconstruction_job.h, with all the libraries it takes. `store` outlives the handler.
JobHandler ReconstructionRequests(Store& store);

}  // namespace rotunda::daemon
