#include "sfm/epipolar.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace rotunda::sfm {
namespace {

using Vector9 = Eigen::Matrix<double, 9, 1>;
using Vector5 = Eigen::Matrix<double, 5, 1>;
using Matrix5 = Eigen::Matrix<double, 5, 5>;

Vector9 RowsOf(const Eigen::Matrix3d& m) {
  Vector9 rows;
  rows << m.row(0).transpose(), m.row(1).transpose(), m.row(2).transpose();
  return rows;
}

/// Two unit vectors that are orthogonal to `direction` and to each other.
Eigen::Matrix<double, 3, 2> TangentBasis(const Eigen::Vector3d& direction) {
  Eigen::Matrix<double, 3, 2> basis;
  basis.col(0) = direction.unitOrthogonal();
  basis.col(1) = direction.cross(basis.col(0));
  return basis;
}

/// R exp([w]x), t moved along its tangent plane: step = (w, tangent coordinates).
Rigid3 Stepped(const Rigid3& pose, const Vector5& step) {
  const Eigen::Vector3d w = step.head<3>();
  const double angle = w.norm();
  const Eigen::Quaterniond turn = angle > 0
                                      ? Eigen::Quaterniond(Eigen::AngleAxisd(angle, w / angle))
                                      : Eigen::Quaterniond::Identity();
  const Eigen::Vector3d moved = pose.translation + TangentBasis(pose.translation) * step.tail<2>();
  return {(pose.rotation * turn).normalized(), moved.normalized()};
}

/// Derivatives of E's entries, row by row, by the five parameters of Stepped.
Eigen::Matrix<double, 9, 5> EssentialJacobian(const Rigid3& pose) {
  Eigen::Matrix<double, 9, 5> jacobian;
  const Eigen::Matrix3d rotation = pose.RotationMatrix();
  const Eigen::Matrix3d essential = EssentialFromPose(pose);
  for (int k = 0; k < 3; ++k) {
    jacobian.col(k) = RowsOf(essential * CrossMatrix(Eigen::Vector3d::Unit(k)));
  }
  const Eigen::Matrix<double, 3, 2> basis = TangentBasis(pose.translation);
  for (int k = 0; k < 2; ++k) {
    jacobian.col(3 + k) = RowsOf(CrossMatrix(basis.col(k)) * rotation);
  }
  return jacobian;
}

/// Sampson residual r = C / s with C = second^T E first, s^2 = |(E first)_12|^2 + |(E^T
/// second)_12|^2, and its derivatives by E's entries.
struct SampsonResidual {
  double value;
  Vector9 by_essential;
};
SampsonResidual SampsonWithGradient(const Eigen::Matrix3d& essential, const Correspondence& c) {
  const Eigen::Vector3d first = c.first.homogeneous(), second = c.second.homogeneous();
  const Eigen::Vector3d line = essential * first, line_back = essential.transpose() * second;
  const double product = second.dot(line);
  const double s2 = line.head<2>().squaredNorm() + line_back.head<2>().squaredNorm();
  const double inverse = 1.0 / std::sqrt(s2), ratio = product / s2;
  const Eigen::Vector3d u(line.x(), line.y(), 0), v(line_back.x(), line_back.y(), 0);
  Eigen::Matrix3d by_essential = second * first.transpose();
  by_essential -= ratio * (u * first.transpose() + second * v.transpose());
  return {product * inverse, RowsOf(by_essential) * inverse};
}

struct NormalEquations {
  Matrix5 hessian;
  Vector5 gradient;
};
NormalEquations BuildNormalEquations(const Rigid3& pose, std::span<const Correspondence> data) {
  const Eigen::Matrix3d essential = EssentialFromPose(pose);
  Eigen::Matrix<double, 9, 9> outer = Eigen::Matrix<double, 9, 9>::Zero();
  Vector9 weighted = Vector9::Zero();
  for (const Correspondence& c : data) {
    const SampsonResidual residual = SampsonWithGradient(essential, c);
    outer.noalias() += residual.by_essential * residual.by_essential.transpose();
    weighted += residual.value * residual.by_essential;
  }
  const Eigen::Matrix<double, 9, 5> jacobian = EssentialJacobian(pose);
  return {jacobian.transpose() * outer * jacobian, jacobian.transpose() * weighted};
}

double SampsonCost(const Rigid3& pose, std::span<const Correspondence> data) {
  const Eigen::Matrix3d essential = EssentialFromPose(pose);
  double cost = 0;
  for (const Correspondence& c : data) cost += SquaredSampson(essential, c);
  return cost;
}

}  // namespace

Eigen::Matrix3d EssentialFromPose(const Rigid3& second_from_first) {
  return CrossMatrix(second_from_first.translation) * second_from_first.RotationMatrix();
}

std::array<Rigid3, 4> PosesFromEssential(const Eigen::Matrix3d& essential) {
  const Eigen::JacobiSVD<Eigen::Matrix3d, Eigen::FullPivHouseholderQRPreconditioner> svd(
      essential, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d u = svd.matrixU(), v = svd.matrixV();
  if (u.determinant() < 0) u = -u;
  if (v.determinant() < 0) v = -v;
  Eigen::Matrix3d w;
  w << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  const Eigen::Quaterniond a(Eigen::Matrix3d(u * w * v.transpose()));
  const Eigen::Quaterniond b(Eigen::Matrix3d(u * w.transpose() * v.transpose()));
  const Eigen::Vector3d t = u.col(2);
  return {{{a, t}, {a, -t}, {b, t}, {b, -t}}};
}

std::vector<Rigid3> PosesFromHomography(const Eigen::Matrix3d& homography) {
  constexpr double kRotation = 1e-9;  // relative difference of the outer singular values
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(homography.transpose() * homography);
  // The middle singular value of R + t n^T / d is one, and its determinant is positive when the
  // cameras are on one side of the plane.
  const double middle = eigen.eigenvalues()[1];
  if (!(middle > 0)) return {};
  const double sign = homography.determinant() < 0 ? -1.0 : 1.0;
  const Eigen::Matrix3d h = sign / std::sqrt(middle) * homography;
  const double large = eigen.eigenvalues()[2] / middle, small = eigen.eigenvalues()[0] / middle;
  if (!(large - small > kRotation)) return {};
  const Eigen::Vector3d v1 = eigen.eigenvectors().col(2), v2 = eigen.eigenvectors().col(1),
                        v3 = eigen.eigenvectors().col(0);
  const Eigen::Vector3d a = std::sqrt(std::max(0.0, 1 - small)) * v1;
  const Eigen::Vector3d b = std::sqrt(std::max(0.0, large - 1)) * v3;
  std::vector<Rigid3> poses;
  for (double side : {1.0, -1.0}) {
    const Eigen::Vector3d u = (a + side * b) / std::sqrt(large - small);
    const Eigen::Vector3d normal = v2.cross(u);
    Eigen::Matrix3d from, to;
    from << v2, u, normal;
    to << h * v2, h * u, (h * v2).cross(h * u);
    const Eigen::Matrix3d rotation = to * from.transpose();
    const Eigen::Vector3d t = ((h - rotation) * normal).normalized();
    const Eigen::Quaterniond turn = Eigen::Quaterniond(rotation).normalized();
    poses.push_back({turn, t});
    poses.push_back({turn, -t});
  }
  return poses;
}

double SquaredSampson(const Eigen::Matrix3d& m, const Correspondence& c) {
  const double x1 = c.first.x(), y1 = c.first.y(), x2 = c.second.x(), y2 = c.second.y();
  const double a0 = m(0, 0) * x1 + m(0, 1) * y1 + m(0, 2);
  const double a1 = m(1, 0) * x1 + m(1, 1) * y1 + m(1, 2);
  const double a2 = m(2, 0) * x1 + m(2, 1) * y1 + m(2, 2);
  const double b0 = m(0, 0) * x2 + m(1, 0) * y2 + m(2, 0);
  const double b1 = m(0, 1) * x2 + m(1, 1) * y2 + m(2, 1);
  const double product = x2 * a0 + y2 * a1 + a2;
  return product * product / (a0 * a0 + a1 * a1 + b0 * b0 + b1 * b1);
}

RansacScore ScoreEpipolar(const Eigen::Matrix3d& matrix, std::span<const Correspondence> data,
                          double max_error, double bail) {
  constexpr size_t kBlock = 16;  // correspondences between two looks at `bail`
  const double limit = max_error * max_error;
  RansacScore score{0.0, 0};
  for (size_t begin = 0; begin < data.size(); begin += kBlock) {
    const size_t end = std::min(data.size(), begin + kBlock);
    for (size_t i = begin; i < end; ++i) {
      const double squared = SquaredSampson(matrix, data[i]);
      const bool inlier = squared < limit;
      score.cost += inlier ? squared : limit;
      score.inliers += inlier;
    }
    if (score.cost > bail) return score;
  }
  return score;
}

std::vector<size_t> EpipolarInliers(const Eigen::Matrix3d& matrix,
                                    std::span<const Correspondence> data, double max_error) {
  std::vector<size_t> inliers;
  for (size_t i = 0; i < data.size(); ++i) {
    if (SquaredSampson(matrix, data[i]) < max_error * max_error) inliers.push_back(i);
  }
  return inliers;
}

bool InFront(const Rigid3& second_from_first, const Correspondence& c, double max_error) {
  // depth2 b = depth1 a + t, crossed with b and with a.
  const Eigen::Vector3d a = second_from_first.rotation * c.first.homogeneous().normalized();
  const Eigen::Vector3d b = c.second.homogeneous().normalized();
  const Eigen::Vector3d& t = second_from_first.translation;
  const Eigen::Vector3d normal = a.cross(b);
  if (normal.squaredNorm() < max_error * max_error) return true;
  return b.cross(t).dot(normal) > 0 && a.cross(t).dot(normal) > 0;
}

double RayAngle_rad(const Rigid3& second_from_first, const Correspondence& c) {
  const Eigen::Vector3d a = second_from_first.rotation * c.first.homogeneous();
  const Eigen::Vector3d b = c.second.homogeneous();
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

size_t CountInFront(const Rigid3& second_from_first, std::span<const Correspondence> data,
                    double max_error) {
  return static_cast<size_t>(std::count_if(data.begin(), data.end(), [&](const Correspondence& c) {
    return InFront(second_from_first, c, max_error);
  }));
}

Rigid3 PoseInFront(const Eigen::Matrix3d& essential, std::span<const Correspondence> data,
                   double max_error) {
  const std::array<Rigid3, 4> poses = PosesFromEssential(essential);
  std::array<size_t, 4> counts;
  std::transform(poses.begin(), poses.end(), counts.begin(),
                 [&](const Rigid3& pose) { return CountInFront(pose, data, max_error); });
  return poses[static_cast<size_t>(std::max_element(counts.begin(), counts.end()) -
                                   counts.begin())];
}

Rigid3 RefinePose(const Rigid3& second_from_first, std::span<const Correspondence> data,
                  int max_iterations) {
  constexpr double kMinDamping = 1e-12, kMaxDamping = 1e3;
  constexpr double kMinRelativeGain = 1e-10;
  Rigid3 pose = second_from_first;
  double cost = SampsonCost(pose, data);
  double damping = 1e-6;  // relative to the diagonal
  NormalEquations normal = BuildNormalEquations(pose, data);
  for (int iteration = 0; iteration < max_iterations && damping < kMaxDamping; ++iteration) {
    Matrix5 damped = normal.hessian;
    damped.diagonal() *= 1.0 + damping;
    const Vector5 step = -damped.ldlt().solve(normal.gradient);
    if (!step.allFinite()) break;
    const Rigid3 candidate = Stepped(pose, step);
    const double candidate_cost = SampsonCost(candidate, data);
    if (!(candidate_cost < cost)) {
      damping *= 10.0;
      continue;
    }
    const bool converged = cost - candidate_cost < kMinRelativeGain * cost;
    pose = candidate;
    cost = candidate_cost;
    if (converged) break;
    damping = std::max(kMinDamping, 0.1 * damping);
    normal = BuildNormalEquations(pose, data);
  }
  return pose;
}

}  // namespace rotunda::sfm
