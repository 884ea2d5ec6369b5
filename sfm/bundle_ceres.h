#pragma once

#include <stop_token>

#include "sfm/bundle_problem.h"

namespace rotunda::sfm {

/// Moves the free poses and the points of `problem` and, if asked for, the lenses that are used.
/// Ceres, one thread: the same bits every time. kFailed: the solver gave up; kCancelled: stopped,
/// within an iteration. `problem` is half moved after an error.
Result<BundleAdjustmentReport> SolveWithCeres(BundleProblem& problem,
                                              const BundleAdjustmentOptions& options,
                                              std::stop_token stop);

}  // namespace rotunda::sfm
