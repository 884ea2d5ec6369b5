#include <Eigen/Dense>
#include <array>

#include "sfm/polynomial_roots.h"
#include "sfm/two_view_solvers.h"

namespace rotunda::sfm {
namespace {

/// Exponents of x, y and z.
struct Monomial {
  int x, y, z;
  constexpr bool operator==(const Monomial&) const = default;
};

constexpr std::array<Monomial, 4> kLinear = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0}}};
constexpr std::array<Monomial, 10> kQuadratic = {{{2, 0, 0},
                                                  {1, 1, 0},
                                                  {1, 0, 1},
                                                  {1, 0, 0},
                                                  {0, 2, 0},
                                                  {0, 1, 1},
                                                  {0, 1, 0},
                                                  {0, 0, 2},
                                                  {0, 0, 1},
                                                  {0, 0, 0}}};
/// Nister's order: ten to be eliminated, then x, y and 1 times powers of z.
constexpr std::array<Monomial, 20> kCubic = {
    {{3, 0, 0}, {0, 3, 0}, {2, 1, 0}, {1, 2, 0}, {2, 0, 1}, {2, 0, 0}, {0, 2, 1},
     {0, 2, 0}, {1, 1, 1}, {1, 1, 0}, {1, 0, 2}, {1, 0, 1}, {1, 0, 0}, {0, 1, 2},
     {0, 1, 1}, {0, 1, 0}, {0, 0, 3}, {0, 0, 2}, {0, 0, 1}, {0, 0, 0}}};

/// Place in `products` of a[i] * b[j].
template <size_t A, size_t B, size_t P>
constexpr std::array<std::array<int, B>, A> ProductPlaces(const std::array<Monomial, A>& a,
                                                          const std::array<Monomial, B>& b,
                                                          const std::array<Monomial, P>& products) {
  std::array<std::array<int, B>, A> places{};
  for (size_t i = 0; i < A; ++i) {
    for (size_t j = 0; j < B; ++j) {
      const Monomial product{a[i].x + b[j].x, a[i].y + b[j].y, a[i].z + b[j].z};
      for (size_t p = 0; p < P; ++p) {
        if (products[p] == product) places[i][j] = static_cast<int>(p);
      }
    }
  }
  return places;
}
constexpr auto kLinearTimesLinear = ProductPlaces(kLinear, kLinear, kQuadratic);
constexpr auto kQuadraticTimesLinear = ProductPlaces(kQuadratic, kLinear, kCubic);

using Linear = Eigen::Vector4d;
using Quadratic = Eigen::Matrix<double, 10, 1>;
using Cubic = Eigen::Matrix<double, 20, 1>;

void AddProduct(const Linear& a, const Linear& b, double factor, Quadratic& sum) {
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) sum[kLinearTimesLinear[i][j]] += factor * a[i] * b[j];
  }
}

void AddProduct(const Quadratic& a, const Linear& b, Cubic& sum) {
  for (int i = 0; i < 10; ++i) {
    for (int j = 0; j < 4; ++j) sum[kQuadraticTimesLinear[i][j]] += a[i] * b[j];
  }
}

/// Entries of E = x X + y Y + z Z + W as linear forms, row by row.
using EssentialForm = std::array<Linear, 9>;

/// Null space of the epipolar equations.
EssentialForm NullSpace(std::span<const Correspondence, 5> sample) {
  Eigen::Matrix<double, 9, 5> equations;
  for (int i = 0; i < 5; ++i) {
    const Eigen::Vector3d a = sample[i].first.homogeneous(), b = sample[i].second.homogeneous();
    equations.col(i) << b.x() * a, b.y() * a, b.z() * a;
  }
  const Eigen::HouseholderQR<Eigen::Matrix<double, 9, 5>> qr(equations);
  Eigen::Matrix<double, 9, 4> basis = Eigen::Matrix<double, 9, 4>::Zero();
  basis.bottomRows<4>().setIdentity();
  basis.applyOnTheLeft(qr.householderQ());
  EssentialForm form;
  for (int i = 0; i < 9; ++i) form[i] = basis.row(i).transpose();
  return form;
}

/// The ten cubic constraints, one a row.
Eigen::Matrix<double, 10, 20> Constraints(const EssentialForm& e) {
  Eigen::Matrix<double, 10, 20> rows;
  // E E^T less half its trace, symmetric.
  std::array<std::array<Quadratic, 3>, 3> gram;
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      gram[i][j].setZero();
      for (int k = 0; k < 3; ++k) AddProduct(e[3 * i + k], e[3 * j + k], 1.0, gram[i][j]);
    }
  }
  const Quadratic half_trace = 0.5 * (gram[0][0] + gram[1][1] + gram[2][2]);
  for (int i = 0; i < 3; ++i) gram[i][i] -= half_trace;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      Cubic sum = Cubic::Zero();
      for (int k = 0; k < 3; ++k) {
        AddProduct(gram[std::min(i, k)][std::max(i, k)], e[3 * k + j], sum);
      }
      rows.row(3 * i + j) = sum.transpose();
    }
  }
  Cubic determinant = Cubic::Zero();
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    Quadratic cofactor = Quadratic::Zero();
    AddProduct(e[3 + j], e[6 + k], 1.0, cofactor);
    AddProduct(e[3 + k], e[6 + j], -1.0, cofactor);
    AddProduct(cofactor, e[i], determinant);
  }
  rows.row(9) = determinant.transpose();
  return rows;
}

/// A polynomial in z by ascending power.
template <size_t Degree>
using Polynomial = std::array<double, Degree + 1>;

template <size_t A, size_t B>
Polynomial<A + B - 2> Product(const std::array<double, A>& a, const std::array<double, B>& b) {
  Polynomial<A + B - 2> product{};
  for (size_t i = 0; i < A; ++i) {
    for (size_t j = 0; j < B; ++j) product[i + j] += a[i] * b[j];
  }
  return product;
}

template <size_t N>
std::array<double, N> Difference(std::array<double, N> a, const std::array<double, N>& b) {
  for (size_t i = 0; i < N; ++i) a[i] -= b[i];
  return a;
}

/// One row of Nister's B(z): x * of_x + y * of_y + of_one = 0.
struct EliminatedRow {
  Polynomial<3> of_x, of_y;
  Polynomial<4> of_one;

  Eigen::Vector3d At(double z) const {
    const auto value = [z](const auto& polynomial) {
      double sum = 0;
      for (size_t i = polynomial.size(); i-- > 0;) sum = sum * z + polynomial[i];
      return sum;
    };
    return {value(of_x), value(of_y), value(of_one)};
  }
};

/// Row `upper` less z times row `lower` of the reduced system, whose leading monomials differ by
/// the factor z and cancel (eq. 20-22).
EliminatedRow Eliminate(const Eigen::Matrix<double, 10, 10>& reduced, int upper, int lower) {
  const auto u = reduced.row(upper), l = reduced.row(lower);
  EliminatedRow row;
  row.of_x = {u[2], u[1] - l[2], u[0] - l[1], -l[0]};
  row.of_y = {u[5], u[4] - l[5], u[3] - l[4], -l[3]};
  row.of_one = {u[9], u[8] - l[9], u[7] - l[8], u[6] - l[7], -l[6]};
  return row;
}

/// det B(z), of degree ten (eq. 24-28).
Polynomial<10> Determinant(const std::array<EliminatedRow, 3>& rows) {
  Polynomial<10> determinant{};
  for (int i = 0; i < 3; ++i) {
    const EliminatedRow& a = rows[(i + 1) % 3];
    const EliminatedRow& b = rows[(i + 2) % 3];
    const Polynomial<6> minor = Difference(Product(a.of_x, b.of_y), Product(a.of_y, b.of_x));
    const Polynomial<10> term = Product(minor, rows[i].of_one);
    for (size_t k = 0; k < determinant.size(); ++k) determinant[k] += term[k];
  }
  return determinant;
}

/// (x, y, 1) up to scale: orthogonal to all rows of B(z), taken from the two that say it best.
Eigen::Vector3d NullVector(const std::array<EliminatedRow, 3>& rows, double z) {
  const std::array<Eigen::Vector3d, 3> at = {rows[0].At(z), rows[1].At(z), rows[2].At(z)};
  Eigen::Vector3d best = at[0].cross(at[1]);
  for (int i = 1; i < 3; ++i) {
    const Eigen::Vector3d candidate = at[i].cross(at[(i + 1) % 3]);
    if (candidate.squaredNorm() > best.squaredNorm()) best = candidate;
  }
  return best;
}

/// One Gauss-Newton step of (x, y, z) on the ten constraints: brings back the digits that the
/// polynomial of degree ten loses.
Eigen::Vector3d Polished(const Eigen::Matrix<double, 10, 20>& constraints,
                         const Eigen::Vector3d& xyz) {
  std::array<Eigen::Vector4d, 3> powers;
  for (int i = 0; i < 3; ++i) {
    powers[i] << 1, xyz[i], xyz[i] * xyz[i], xyz[i] * xyz[i] * xyz[i];
  }
  Eigen::Matrix<double, 20, 4> monomials;  // value, derivatives by x, y and z
  for (int m = 0; m < 20; ++m) {
    const std::array<int, 3> e = {kCubic[m].x, kCubic[m].y, kCubic[m].z};
    const Eigen::Vector3d p(powers[0][e[0]], powers[1][e[1]], powers[2][e[2]]);
    const auto slope = [&](int i) { return e[i] == 0 ? 0.0 : e[i] * powers[i][e[i] - 1]; };
    monomials.row(m) << p[0] * p[1] * p[2], slope(0) * p[1] * p[2], p[0] * slope(1) * p[2],
        p[0] * p[1] * slope(2);
  }
  const Eigen::Matrix<double, 10, 4> values = constraints * monomials;
  const Eigen::Matrix<double, 10, 3> jacobian = values.rightCols<3>();
  const Eigen::Matrix3d normal = jacobian.transpose() * jacobian;
  const Eigen::Vector3d step = normal.ldlt().solve(jacobian.transpose() * values.col(0));
  return step.allFinite() ? Eigen::Vector3d(xyz - step) : xyz;
}

}  // namespace

void SolveFivePoint(std::span<const Correspondence, 5> sample,
                    std::vector<Eigen::Matrix3d>& solutions) {
  solutions.clear();
  const EssentialForm form = NullSpace(sample);
  const Eigen::Matrix<double, 10, 20> constraints = Constraints(form);
  const Eigen::Matrix<double, 10, 10> reduced =
      constraints.leftCols<10>().partialPivLu().solve(constraints.rightCols<10>());
  if (!reduced.allFinite()) return;
  // Leading monomials of rows 4-9: x^2 z, x^2, y^2 z, y^2, x y z, x y.
  const std::array<EliminatedRow, 3> rows = {Eliminate(reduced, 4, 5), Eliminate(reduced, 6, 7),
                                             Eliminate(reduced, 8, 9)};
  std::vector<double> roots;
  roots.reserve(10);
  SturmSolver<10>::Solve(Determinant(rows), roots);
  for (double z : roots) {
    const Eigen::Vector3d xy1 = NullVector(rows, z);
    if (xy1.z() == 0.0) continue;
    Eigen::Vector3d xyz(xy1.x() / xy1.z(), xy1.y() / xy1.z(), z);
    xyz = Polished(constraints, xyz);
    const Linear weights = xyz.homogeneous();
    Eigen::Matrix3d essential;
    for (int i = 0; i < 9; ++i) essential(i / 3, i % 3) = form[i].dot(weights);
    solutions.push_back(essential / essential.norm());
  }
}

}  // namespace rotunda::sfm
