#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "sfm/core/calibration.h"
#include "sfm/core/frame_set.h"
#include "sfm/core/pose_set.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"
#include "sfm/features.h"
#include "sfm/reconstruction.h"
#include "sfm/segments.h"

namespace rotunda::sfm {

struct ReportInput {
  const FrameSet& set;
  const PoseSet& poses;
  const Reconstruction& reconstruction;           // in the frame of `poses`
  const std::optional<Calibration>& calibration;  // the one the poses were aligned to
  const Features& features;
  const std::optional<Segments>& segments;  // communities of tracks, where the method has them
  const std::string& calibration_page;      // HTML of the calibration's own report; empty: none
};

/// One HTML file that needs nothing else: summary, table of cameras, top and side view of cameras
/// and points, a strip of the pictures, one with the communities of tracks, the calibration's page.
/// Same input, same bytes.
Result<std::string> BuildReport(const ReportInput& input, RunContext& context);

}  // namespace rotunda::sfm
