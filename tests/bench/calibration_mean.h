#pragma once

#include "sfm/core/run_context.h"

namespace rotunda::bench {

/// Renders a small rig's shots of the cuboid, spoils them in eight ways and prints of each what the
/// calibration makes of it: errors against truth, and what it says.
void BenchMeanInputs(ThreadPool& threads);

}  // namespace rotunda::bench
