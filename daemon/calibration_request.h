#pragma once

#include <optional>
#include <string>
#include <vector>

#include "daemon/jobs.h"
#include "daemon/store.h"
#include "sfm/core/result.h"

namespace rotunda::daemon {

/// POST /v1/calibrations {"captures": [ids], "model": a name in rig::LensModelsByName?,
/// "frame_from", "intrinsics_from", "compare": ids of calibrations?}.
struct CalibrationRequest {
  std::vector<std::string> captures;
  std::string model = "opencv";
  std::optional<std::string> frame_from, intrinsics_from, compare;
};

/// kInvalidArgument names the field.
Result<CalibrationRequest> ParseCalibrationRequest(const std::string& body);

/// What a queue needs to take such requests, without what does the work (`run`): that is in
/// calibration_job.h, with all the libraries it takes. `store` outlives the handler.
JobHandler CalibrationRequests(Store& store);

}  // namespace rotunda::daemon
