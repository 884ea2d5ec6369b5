#pragma once

#include "tests/support/simulated_daemon.h"

namespace rotunda::bench {

/// The daemon on a small disk of its own that fills up `rounds` times at random moments of its
/// work; each time it is killed, started again or goes on when there is room again. Throws with
/// what is wrong; prints what was done, or why it was not (mounting a disk takes root).
void MeasureFullDisk(const test::SimulatedDaemon::Options& options, int rounds, unsigned seed);

}  // namespace rotunda::bench
