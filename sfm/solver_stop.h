#pragma once

#include <memory>
#include <stop_token>

namespace ceres {
class IterationCallback;
}

// Private to the .cc files that solve with Ceres.

namespace rotunda::sfm {

/// For Solver::Options::callbacks: ends a solve with USER_FAILURE after the iteration under way,
/// once `stop` is set; Ceres then leaves the parameters as they were given. It only looks on: a
/// solve that is not stopped gives the same bits with and without it.
std::unique_ptr<ceres::IterationCallback> StopBetweenIterations(std::stop_token stop);

}  // namespace rotunda::sfm
