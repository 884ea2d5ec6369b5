#pragma once

#include "tests/support/simulated_daemon.h"

namespace rotunda::bench {

/// The daemon on a small disk of its own that fills up `rounds` times at random moments of its
/// work; each time it is killed, started again or goes on when there is room again. Throws with
/// what is wrong, also when no disk can be mounted, which takes root; prints what was done.
void MeasureFullDisk(const test::SimulatedDaemon::Options& options, int rounds, unsigned seed);

}  // namespace rotunda::bench
