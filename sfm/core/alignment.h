#pragma once

#include <Eigen/Core>
#include <vector>

#include "sfm/core/result.h"
#include "sfm/core/rigid3.h"

namespace rotunda {

/// Least-squares similarity that takes source[i] to target[i] (Umeyama, PAMI 1991, eq. 40-42).
/// `with_scale` false: rigid motion. kInvalidArgument below 3 points or when they lie on one line.
Result<Sim3> FitSim3(const std::vector<Eigen::Vector3d>& source,
                     const std::vector<Eigen::Vector3d>& target, bool with_scale);

/// FitSim3 that a minority of moved points does not bend: consensus over all triples of a seeded
/// sample (at most 500), then least squares over the points whose residual is below 4 times the
/// robust standard deviation (1.4826 x median of the residual norms), until the set stays the same.
struct RobustSim3 {
  Sim3 target_from_source;
  std::vector<bool> inliers;
  double sigma = 0.0;  // robust standard deviation of the residuals, target's unit
};
Result<RobustSim3> FitSim3Robust(const std::vector<Eigen::Vector3d>& source,
                                 const std::vector<Eigen::Vector3d>& target, uint64_t seed);

}  // namespace rotunda
