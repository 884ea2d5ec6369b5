#pragma once

#include <Eigen/Core>
#include <array>
#include <span>
#include <vector>

#include "sfm/core/rigid3.h"
#include "sfm/lo_ransac.h"
#include "sfm/two_view_solvers.h"

namespace rotunda::sfm {

/// E of a pose: second^T E first = 0, E = [t]x R with |t| = 1 assumed.
Eigen::Matrix3d EssentialFromPose(const Rigid3& second_from_first);

/// The four poses (|t| = 1) of an essential matrix, or of the essential matrix nearest to a
/// fundamental one (Hartley & Zisserman, 9.6.2).
std::array<Rigid3, 4> PosesFromEssential(const Eigen::Matrix3d& essential);

/// The four poses (|t| = 1) that let a plane map the first camera's normalised coordinates to the
/// second's by `homography`; for two of them the plane is behind the cameras (Ma, Soatto, Kosecka &
/// Sastry, "An Invitation to 3-D Vision", 5.3.3). Empty when it is a rotation, but for rounding.
std::vector<Rigid3> PosesFromHomography(const Eigen::Matrix3d& homography);

/// Squared Sampson distance to the epipolar constraint second^T matrix first = 0 (Hartley &
/// Zisserman, eq. 11.9), in the unit of the coordinates.
double SquaredSampson(const Eigen::Matrix3d& matrix, const Correspondence& c);

/// MSAC score of an epipolar matrix, as LoRansac asks for it.
RansacScore ScoreEpipolar(const Eigen::Matrix3d& matrix, std::span<const Correspondence> data,
                          double max_error, double bail);

/// Places of the correspondences whose Sampson distance is below `max_error`.
std::vector<size_t> EpipolarInliers(const Eigen::Matrix3d& matrix,
                                    std::span<const Correspondence> data, double max_error);

/// True when the rays meet in front of both cameras, or are so near to parallel (sine of the angle
/// below `max_error`) that noise decides where they meet.
bool InFront(const Rigid3& second_from_first, const Correspondence& c, double max_error);

/// Angle under which the two cameras see the point, from the rays' directions.
double RayAngle_rad(const Rigid3& second_from_first, const Correspondence& c);

size_t CountInFront(const Rigid3& second_from_first, std::span<const Correspondence> data,
                    double max_error);

/// Of the four poses of `essential`, the one with most of `data` in front (ties: the first).
Rigid3 PoseInFront(const Eigen::Matrix3d& essential, std::span<const Correspondence> data,
                   double max_error);

/// Levenberg-Marquardt on the sum of squared Sampson distances over rotation and direction of
/// translation (five parameters). Returns a pose with |t| = 1 and no higher cost.
Rigid3 RefinePose(const Rigid3& second_from_first, std::span<const Correspondence> data,
                  int max_iterations);

}  // namespace rotunda::sfm
