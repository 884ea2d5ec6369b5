#pragma once

#include "rig/sim/served_image.h"
#include "rig/sim/simulate.h"

namespace rotunda::sim {

/// What SimulateFrameSet would write, rendered into memory for simulated cameras to serve: one shot
/// in `format`.
Result<ServedShots> RenderShot(const RigOptions& rig, const SimulateOptions& options,
                               PixelFormat format, RunContext& context);

}  // namespace rotunda::sim
