#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "daemon/jobs.h"
#include "daemon/store.h"
#include "sfm/core/frame_set.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"
#include "sfm/pipeline.h"

namespace rotunda::daemon {

/// `calibration`, else the one that came with the frame set; and the page that lies beside it.
/// Empty when there is neither.
Result<sfm::CalibrationInForce> CalibrationOf(
    const std::filesystem::path& frameset, const std::optional<std::filesystem::path>& calibration);

/// Reconstructs the set into the folder `out`, which appears whole or not at all.
struct ReconstructionTask {
  FrameSet set;
  sfm::CalibrationInForce in_force;
  sfm::PipelineOptions options;
  std::filesystem::path out;
};
Result<sfm::PipelineResult> MakeReconstruction(const ReconstructionTask& task, RunContext& context);

/// Jobs with bodies as ReconstructionRequest. Without a calibration the one that was in force at
/// the capture is taken. Result: {"reconstruction", "capture", "method", "preset" (when it has
/// one), "prior", "registered", "of", "rms_px", "verdict", "verdict_reason", "notes"}. `threads` 0:
/// the machine's cores. `store` outlives the handler.
JobHandler MakeReconstructionHandler(Store& store, int threads);

}  // namespace rotunda::daemon
