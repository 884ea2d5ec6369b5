#include "sfm/two_view_solvers.h"

#include <Eigen/Dense>
#include <array>
#include <cmath>

#include "sfm/polynomial_roots.h"

namespace rotunda::sfm {
namespace {

/// Coefficients of the epipolar equation in F's entries, row by row.
Eigen::Matrix<double, 9, 1> EpipolarEquation(const Eigen::Vector3d& first,
                                             const Eigen::Vector3d& second) {
  Eigen::Matrix<double, 9, 1> equation;
  equation << second.x() * first, second.y() * first, second.z() * first;
  return equation;
}

Eigen::Matrix3d MatrixFromRows(const Eigen::Matrix<double, 9, 1>& entries) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(entries.data());
}

/// Moves points to their centroid and scales their mean distance from it to sqrt(2).
struct Conditioning {
  Eigen::Matrix3d first = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d second = Eigen::Matrix3d::Identity();
};

Eigen::Matrix3d ConditioningOf(std::span<const Correspondence> data,
                               Eigen::Vector2d Correspondence::*side) {
  Eigen::Vector2d centroid = Eigen::Vector2d::Zero();
  for (const Correspondence& c : data) centroid += c.*side;
  centroid /= static_cast<double>(data.size());
  double distance = 0;
  for (const Correspondence& c : data) distance += (c.*side - centroid).norm();
  distance /= static_cast<double>(data.size());
  const double scale = distance > 0 ? std::sqrt(2.0) / distance : 1.0;
  Eigen::Matrix3d matrix;
  matrix << scale, 0, -scale * centroid.x(), 0, scale, -scale * centroid.y(), 0, 0, 1;
  return matrix;
}

Conditioning ConditioningOf(std::span<const Correspondence> data) {
  return {ConditioningOf(data, &Correspondence::first),
          ConditioningOf(data, &Correspondence::second)};
}

using Gram = Eigen::Matrix<double, 9, 9>;

}  // namespace

void SolveSevenPoint(std::span<const Correspondence, 7> sample,
                     std::vector<Eigen::Matrix3d>& solutions) {
  solutions.clear();
  Eigen::Matrix<double, 9, 7> equations;
  for (int i = 0; i < 7; ++i) {
    equations.col(i) =
        EpipolarEquation(sample[i].first.homogeneous(), sample[i].second.homogeneous());
  }
  const Eigen::HouseholderQR<Eigen::Matrix<double, 9, 7>> qr(equations);
  Eigen::Matrix<double, 9, 2> basis = Eigen::Matrix<double, 9, 2>::Zero();
  basis.bottomRows<2>().setIdentity();
  basis.applyOnTheLeft(qr.householderQ());
  const Eigen::Matrix3d f1 = MatrixFromRows(basis.col(0)), f2 = MatrixFromRows(basis.col(1));

  // det(F1 + a F2), a cubic in a, through its values at 0, 1 and -1 and its leading coefficient.
  const double c0 = f1.determinant(), c3 = f2.determinant();
  const double at_plus = (f1 + f2).determinant(), at_minus = (f1 - f2).determinant();
  const double c2 = 0.5 * (at_plus + at_minus) - c0;
  const double c1 = 0.5 * (at_plus - at_minus) - c3;
  std::vector<double> roots;
  SturmSolver<3>::Solve({c0, c1, c2, c3}, roots);
  for (double a : roots) solutions.push_back((f1 + a * f2).normalized());
}

std::optional<Eigen::Matrix3d> FitFundamental(std::span<const Correspondence> data,
                                              std::span<const double> weights) {
  if (data.size() < 8) return std::nullopt;
  const Conditioning conditioning = ConditioningOf(data);
  Gram gram = Gram::Zero();
  for (size_t i = 0; i < data.size(); ++i) {
    const Eigen::Matrix<double, 9, 1> equation =
        EpipolarEquation(conditioning.first * data[i].first.homogeneous(),
                         conditioning.second * data[i].second.homogeneous());
    gram.selfadjointView<Eigen::Lower>().rankUpdate(equation, weights[i]);
  }
  const Eigen::SelfAdjointEigenSolver<Gram> eigen(gram);
  const Eigen::Matrix3d full = MatrixFromRows(eigen.eigenvectors().col(0));
  // F (I - v v^T), v the right singular vector of the smallest singular value: the nearest matrix
  // of rank two.
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> right(full.transpose() * full);
  const Eigen::Vector3d epipole = right.eigenvectors().col(0);
  const Eigen::Matrix3d rank_two = full - full * epipole * epipole.transpose();
  return (conditioning.second.transpose() * rank_two * conditioning.first).normalized();
}

std::optional<Eigen::Matrix3d> FitHomography(std::span<const Correspondence> data) {
  // Second-smallest over largest eigenvalue of the normal equations below which a second solution
  // fits as well: the square of the relative accuracy of the coordinates.
  constexpr double kDegenerate = 1e-12;
  if (data.size() < 4) return std::nullopt;
  const Conditioning conditioning = ConditioningOf(data);
  Gram gram = Gram::Zero();
  for (const Correspondence& c : data) {
    const Eigen::Vector3d a = conditioning.first * c.first.homogeneous();
    const Eigen::Vector3d b = conditioning.second * c.second.homogeneous();
    Eigen::Matrix<double, 9, 2> equations;
    equations.col(0) << a, Eigen::Vector3d::Zero(), -b.x() * a;
    equations.col(1) << Eigen::Vector3d::Zero(), a, -b.y() * a;
    gram.noalias() += equations * equations.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Gram> eigen(gram);
  if (!(eigen.eigenvalues()[1] > kDegenerate * eigen.eigenvalues()[8])) return std::nullopt;
  const Eigen::Matrix3d conditioned = MatrixFromRows(eigen.eigenvectors().col(0));
  return (conditioning.second.inverse() * conditioned * conditioning.first).normalized();
}

}  // namespace rotunda::sfm
