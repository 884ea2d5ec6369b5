#pragma once

#include "sfm/bundle_problem.h"

namespace rotunda::sfm {

/// Moves the free poses and the points of `problem`; lenses stay. Levenberg-Marquardt with the
/// points eliminated (Triggs et al. 2000, section 6.1) and the dense camera system that remains
/// factorised; the damping follows Nielsen (1999), losses weigh the squares anew at every step.
/// Memory: 144 bytes an observation and 2.3 kB a pair of free images. The sums are taken in parts
/// that the problem alone decides: the same bits on any number of threads. kFailed: a residual is
/// not finite, or the normal equations cannot be solved; kCancelled. `problem` is half moved after
/// an error.
Result<BundleAdjustmentReport> SolveByPointElimination(BundleProblem& problem,
                                                       const BundleAdjustmentOptions& options,
                                                       RunContext& context);

}  // namespace rotunda::sfm
