#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "sfm/core/rigid3.h"

namespace rotunda::sfm {

/// Poses (at most four) that put three points on three rays: lambda_i ray_i = cam_from_world *
/// x_i with lambda_i > 0. `rays_in_cam` are unit vectors. The law of cosines gives three quadrics
/// in the depths lambda; the pencil of two of them holds a pair of planes, found by a cubic
/// (Persson & Nordberg, "Lambda Twist", ECCV 2018). Points on a line give no pose. `poses` is
/// cleared first.
void SolveP3p(const std::array<Eigen::Vector3d, 3>& rays_in_cam,
              const std::array<Eigen::Vector3d, 3>& points_in_world, std::vector<Rigid3>& poses);

}  // namespace rotunda::sfm
