#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

namespace rotunda::sfm {

/// One correspondence in normalised, undistorted coordinates (x/z, y/z) of both cameras.
struct Correspondence {
  Eigen::Vector2d first;
  Eigen::Vector2d second;
};

/// Essential matrices E (Frobenius norm 1) with second^T E first = 0 for five correspondences, det
/// E = 0 and 2 E E^T E - tr(E E^T) E = 0: Nister, "An efficient solution to the five-point relative
/// pose problem", PAMI 2004, eq. 8-28, with Sturm sequences for the polynomial of degree ten.
/// `solutions` is cleared first and holds at most ten.
void SolveFivePoint(std::span<const Correspondence, 5> sample,
                    std::vector<Eigen::Matrix3d>& solutions);

/// Fundamental matrices (Frobenius norm 1, at most three) through seven correspondences: det(a F1
/// + (1 - a) F2) = 0 on the null space of the epipolar equations (Hartley & Zisserman, 11.1.2).
/// `solutions` is cleared first.
void SolveSevenPoint(std::span<const Correspondence, 7> sample,
                     std::vector<Eigen::Matrix3d>& solutions);

/// Weighted least squares of the epipolar equation over at least eight correspondences in
/// normalised frames (Hartley, PAMI 1997), brought to rank two. nullopt when they are fewer.
std::optional<Eigen::Matrix3d> FitFundamental(std::span<const Correspondence> data,
                                              std::span<const double> weights);

/// Homography second ~ H first (Frobenius norm 1) by the direct linear transform over at least four
/// correspondences in normalised frames (Hartley & Zisserman, algorithm 4.2). nullopt when they are
/// fewer or do not determine it (three points on a line).
std::optional<Eigen::Matrix3d> FitHomography(std::span<const Correspondence> data);

}  // namespace rotunda::sfm
