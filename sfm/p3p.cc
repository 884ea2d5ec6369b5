#include "sfm/p3p.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>

namespace rotunda::sfm {
namespace {

/// Squared distances between the points and cosines between the rays:
/// lambda_i^2 + lambda_j^2 - 2 cos_ij lambda_i lambda_j = squared_ij.
struct Triangle {
  double squared_12, squared_13, squared_23;
  double cos_12, cos_13, cos_23;
};

/// Real roots of x^3 + b x^2 + c x + d, polished by Newton's method.
size_t CubicRoots(double b, double c, double d, std::array<double, 3>& roots) {
  const double shift = b / 3.0;
  const double p = c - b * shift;
  const double q = 2.0 * shift * shift * shift - shift * c + d;
  const double discriminant = 0.25 * q * q + p * p * p / 27.0;
  size_t count = 0;
  if (discriminant > 0) {
    const double root = std::sqrt(discriminant);
    const double u = std::cbrt(-0.5 * q + (q > 0 ? -root : root));
    roots[count++] = u - (u != 0 ? p / (3.0 * u) : 0.0) - shift;
  } else {
    const double radius = 2.0 * std::sqrt(std::max(0.0, -p / 3.0));
    const double angle =
        radius > 0 ? std::acos(std::clamp(3.0 * q / (p * radius), -1.0, 1.0)) / 3.0 : 0.0;
    for (int k = 0; k < 3; ++k) {
      roots[count++] = radius * std::cos(angle - 2.0 * kPi * k / 3.0) - shift;
    }
  }
  for (size_t i = 0; i < count; ++i) {
    for (int step = 0; step < 3; ++step) {
      const double x = roots[i];
      const double slope = (3.0 * x + 2.0 * b) * x + c;
      if (slope == 0) break;
      roots[i] -= (((x + b) * x + c) * x + d) / slope;
    }
  }
  return count;
}

/// A member alpha D_12 - beta D_13 of the pencil of D_12 = squared_23 Q_12 - squared_12 Q_23 and
/// D_13 = squared_23 Q_13 - squared_13 Q_23, the quadrics that hold the depths up to scale (Lambda
/// Twist, eq. 8-12).
struct PencilPlace {
  double alpha, beta;
};

Eigen::Matrix3d PencilMember(const Triangle& t, const PencilPlace& place) {
  const double b12 = -t.cos_12, b13 = -t.cos_13, b23 = -t.cos_23;
  Eigen::Matrix3d d12, d13;
  d12 << t.squared_23, t.squared_23 * b12, 0,                                //
      t.squared_23 * b12, t.squared_23 - t.squared_12, -t.squared_12 * b23,  //
      0, -t.squared_12 * b23, -t.squared_12;
  d13 << t.squared_23, 0, t.squared_23 * b13,  //
      0, -t.squared_13, -t.squared_13 * b23,   //
      t.squared_23 * b13, -t.squared_13 * b23, t.squared_23 - t.squared_13;
  return place.alpha * d12 - place.beta * d13;
}

/// Where the pencil is singular: p3 beta^3 + p2 beta^2 alpha + p1 beta alpha^2 + p0 alpha^3 = 0.
std::vector<PencilPlace> SingularMembers(const Triangle& t) {
  const double a12 = t.squared_12, a13 = t.squared_13, a23 = t.squared_23;
  const double s12 = 1.0 - t.cos_12 * t.cos_12;
  const double s13 = 1.0 - t.cos_13 * t.cos_13;
  const double s23 = 1.0 - t.cos_23 * t.cos_23;
  const double blob = t.cos_12 * t.cos_23 * t.cos_13 - 1.0;
  const double p3 = a13 * (a23 * s13 - a13 * s23);
  const double p2 =
      2.0 * blob * a23 * a13 + a13 * (2.0 * a12 + a13) * s23 + a23 * (a23 - a12) * s13;
  const double p1 =
      a23 * (a13 - a23) * s12 - a12 * a12 * s23 - 2.0 * a12 * (blob * a23 + a13 * s23);
  const double p0 = a12 * (a12 * s23 - a23 * s12);
  std::array<double, 3> roots;
  std::vector<PencilPlace> places;
  // By the end of the cubic with the larger leading coefficient: isosceles triangles have one zero.
  const bool by_beta = std::abs(p3) >= std::abs(p0);
  const double lead = by_beta ? p3 : p0;
  constexpr double kNoCubicTerm = 1e-13;
  if (std::abs(lead) > kNoCubicTerm * std::max(std::abs(p1), std::abs(p2))) {
    const size_t count = by_beta ? CubicRoots(p2 / p3, p1 / p3, p0 / p3, roots)
                                 : CubicRoots(p1 / p0, p2 / p0, p3 / p0, roots);
    for (size_t i = 0; i < count; ++i) {
      places.push_back(by_beta ? PencilPlace{1.0, roots[i]} : PencilPlace{roots[i], 1.0});
    }
    return places;
  }
  places = {{1.0, 0.0}, {0.0, 1.0}};
  if (p1 != 0 || p2 != 0) places.push_back({p2, -p1});
  return places;
}

/// The two planes normal^T lambda = 0 that a singular quadric of signature (+, -, 0) consists of,
/// taken from the root at which it is best separated from one of another signature.
std::optional<std::array<Eigen::Vector3d, 2>> PlanePair(const Triangle& t) {
  double best = 0;
  std::optional<std::array<Eigen::Vector3d, 2>> planes;
  for (const PencilPlace& place : SingularMembers(t)) {
    Eigen::Matrix3d member = PencilMember(t, place);
    if (!member.allFinite()) continue;
    member /= member.norm();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(member);
    const double low = solver.eigenvalues()(0), high = solver.eigenvalues()(2);
    const double quality = std::min(-low, high) - std::abs(solver.eigenvalues()(1));
    if (quality <= best) continue;
    best = quality;
    const Eigen::Vector3d a = std::sqrt(high) * solver.eigenvectors().col(2);
    const Eigen::Vector3d b = std::sqrt(-low) * solver.eigenvectors().col(0);
    planes = {a + b, a - b};
  }
  return planes;
}

Eigen::Vector3d CosineResidual(const Triangle& t, const Eigen::Vector3d& depths) {
  const double l1 = depths(0), l2 = depths(1), l3 = depths(2);
  return {l1 * l1 + l2 * l2 - 2.0 * t.cos_12 * l1 * l2 - t.squared_12,
          l1 * l1 + l3 * l3 - 2.0 * t.cos_13 * l1 * l3 - t.squared_13,
          l2 * l2 + l3 * l3 - 2.0 * t.cos_23 * l2 * l3 - t.squared_23};
}

/// Gauss-Newton on the three laws of cosines. At a double root the equations are singular: only
/// steps that lower the residual are taken.
Eigen::Vector3d RefineDepths(const Triangle& t, Eigen::Vector3d depths) {
  constexpr int kSteps = 5;
  Eigen::Vector3d residual = CosineResidual(t, depths);
  for (int step = 0; step < kSteps; ++step) {
    const double l1 = depths(0), l2 = depths(1), l3 = depths(2);
    Eigen::Matrix3d jacobian;
    jacobian << l1 - t.cos_12 * l2, l2 - t.cos_12 * l1, 0,  //
        l1 - t.cos_13 * l3, 0, l3 - t.cos_13 * l1,          //
        0, l2 - t.cos_23 * l3, l3 - t.cos_23 * l2;
    const Eigen::Vector3d next = depths - 0.5 * jacobian.partialPivLu().solve(residual);
    const Eigen::Vector3d next_residual = CosineResidual(t, next);
    if (!(next_residual.squaredNorm() < residual.squaredNorm())) break;
    depths = next;
    residual = next_residual;
  }
  return depths;
}

/// The triangle with its corners renamed so that corner `first` (0, 1 or 2) becomes the first and
/// the other two follow in cyclic order.
Triangle Rotated(const Triangle& t, Eigen::Index first) {
  if (first == 0) return t;
  const Triangle once = {t.squared_23, t.squared_12, t.squared_13, t.cos_23, t.cos_12, t.cos_13};
  return Rotated(once, first - 1);
}

/// a tau^2 + b tau + c = 0.
struct Quadratic {
  double a, b, c;
  double Size() const { return std::abs(a) + std::abs(b) + std::abs(c); }
};

/// D_12 and D_13 on the plane lambda_1 = w0 lambda_2 + w1 lambda_3, in tau = lambda_3 / lambda_2.
/// One of them may vanish there (it may be the plane pair itself); the larger one is given.
Quadratic OnPlane(const Triangle& t, double w0, double w1) {
  const double a12 = t.squared_12, a13 = t.squared_13, a23 = t.squared_23;
  const Quadratic by_12 = {a23 * w1 * w1 - a12,
                           2.0 * a23 * w1 * (w0 - t.cos_12) + 2.0 * a12 * t.cos_23,
                           a23 * (w0 * w0 + 1.0 - 2.0 * t.cos_12 * w0) - a12};
  const Quadratic by_13 = {a23 * (w1 * w1 + 1.0 - 2.0 * t.cos_13 * w1) - a13,
                           2.0 * a23 * w0 * (w1 - t.cos_13) + 2.0 * a13 * t.cos_23,
                           a23 * w0 * w0 - a13};
  return by_12.Size() > by_13.Size() ? by_12 : by_13;
}

/// Depths in the plane normal^T lambda = 0 that satisfy the laws of cosines. The depth with the
/// largest coefficient is expressed by the others.
void DepthsInPlane(const Triangle& triangle, const Eigen::Vector3d& normal,
                   std::vector<Eigen::Vector3d>& out) {
  Eigen::Index first = 0;
  normal.cwiseAbs().maxCoeff(&first);
  const Eigen::Index second = (first + 1) % 3, third = (first + 2) % 3;
  const Triangle t = Rotated(triangle, first);
  const double w0 = -normal(second) / normal(first), w1 = -normal(third) / normal(first);
  const Quadratic q = OnPlane(t, w0, w1);
  const double discriminant = q.b * q.b - 4.0 * q.a * q.c;
  constexpr double kDoubleRoot = -1e-10;  // a double root may come out slightly complex
  if (!(discriminant > kDoubleRoot * q.b * q.b)) return;
  const double root = std::sqrt(std::max(0.0, discriminant));
  const double larger = -0.5 * (q.b + (q.b > 0 ? root : -root));
  for (const double tau : {larger / q.a, q.c / larger}) {
    if (!(tau > 0) || !std::isfinite(tau)) continue;
    const double scale = std::sqrt(t.squared_23 / (tau * (tau - 2.0 * t.cos_23) + 1.0));
    Eigen::Vector3d depths;
    depths(first) = (w0 + w1 * tau) * scale;
    depths(second) = scale;
    depths(third) = tau * scale;
    if (depths.allFinite() && depths(first) > 0) out.push_back(RefineDepths(triangle, depths));
  }
}

/// Right-handed orthonormal frame of a triangle: first edge, in-plane normal to it, plane normal.
Eigen::Matrix3d TriangleFrame(const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                              const Eigen::Vector3d& c) {
  Eigen::Matrix3d frame;
  frame.col(0) = (b - a).normalized();
  frame.col(2) = (b - a).cross(c - a).normalized();
  frame.col(1) = frame.col(2).cross(frame.col(0));
  return frame;
}

}  // namespace

void SolveP3p(const std::array<Eigen::Vector3d, 3>& rays_in_cam,
              const std::array<Eigen::Vector3d, 3>& points_in_world, std::vector<Rigid3>& poses) {
  poses.clear();
  const auto& x = points_in_world;
  const auto& y = rays_in_cam;
  const Triangle t = {(x[0] - x[1]).squaredNorm(),
                      (x[0] - x[2]).squaredNorm(),
                      (x[1] - x[2]).squaredNorm(),
                      y[0].dot(y[1]),
                      y[0].dot(y[2]),
                      y[1].dot(y[2])};
  constexpr double kCollinear = 1e-10;  // sine of the angle between the sides
  const double area = (x[1] - x[0]).cross(x[2] - x[0]).norm();
  if (!(area > kCollinear * std::sqrt(t.squared_12 * t.squared_13))) return;
  const auto planes = PlanePair(t);
  if (!planes) return;
  std::vector<Eigen::Vector3d> candidates;
  for (const Eigen::Vector3d& plane : *planes) DepthsInPlane(t, plane, candidates);
  const Eigen::Matrix3d world_frame = TriangleFrame(x[0], x[1], x[2]);
  for (const Eigen::Vector3d& depths : candidates) {
    const Eigen::Vector3d first = depths(0) * y[0];
    const Eigen::Matrix3d cam_frame = TriangleFrame(first, depths(1) * y[1], depths(2) * y[2]);
    const Eigen::Quaterniond rotation(Eigen::Matrix3d(cam_frame * world_frame.transpose()));
    if (!rotation.coeffs().allFinite() || !(depths.minCoeff() > 0)) continue;
    poses.push_back({rotation.normalized(), first - rotation.normalized() * x[0]});
  }
}

}  // namespace rotunda::sfm
