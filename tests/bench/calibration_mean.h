#pragma once

#include "sfm/core/run_context.h"
#include "tests/bench/calibration_verdict.h"

namespace rotunda::bench {

/// Renders a small rig's shots of the cuboid, spoils them in nine ways and prints of each what the
/// calibration makes of it: errors against truth, and what it says. Each has an outcome that it
/// must have: all cameras within limits, or what is wrong is left out by name and the rest is
/// within them.
void BenchMeanInputs(ThreadPool& threads, Verdict& verdict);

}  // namespace rotunda::bench
