#include "sfm/covariance.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "sfm/bundle_adjustment.h"

namespace rotunda::sfm {
namespace {

/// Partial sums of the normal equations. Fixed, so that the sum does not depend on the number of
/// threads.
constexpr size_t kChunks = 8;
constexpr Eigen::Index kPoseSize = 6;
constexpr Eigen::Index kGaugeSize = 7;
/// Keypoints of one picture that are nearer, as a share of its longer side, show the same texture,
/// if not the same corner at two scales: their errors are alike. Measured on rendered captures:
/// correlation 0.3 to 0.4 within 0.4 %, 0.02 up to 2 %, under 0.01 beyond.
constexpr double kAlikeWithin = 0.02;
/// Standard deviations at which residuals are cut off, so that a few gross ones, of little weight
/// in the adjustment, do not make the spread or the correlation.
constexpr double kCut = 3.0;

/// Where each pose and lens stands among the unknowns that remain once the points are eliminated.
struct Layout {
  std::vector<Eigen::Index> pose;                      // by ImageId; -1: not registered
  std::vector<Eigen::Index> lens;                      // by lens; -1: fixed or not used
  std::vector<std::vector<Eigen::Index>> lens_params;  // by lens: which parameters are refined
  Eigen::Index size = 0;
};

Layout MakeLayout(const Reconstruction& reconstruction, bool intrinsics_refined) {
  Layout layout;
  const Intrinsics& intrinsics = reconstruction.intrinsics;
  layout.pose.assign(reconstruction.cam_from_model.size(), -1);
  layout.lens.assign(intrinsics.lenses.size(), -1);
  layout.lens_params.resize(intrinsics.lenses.size());
  for (size_t i = 0; i < layout.pose.size(); ++i) {
    if (!reconstruction.cam_from_model[i]) continue;
    layout.pose[i] = layout.size;
    layout.size += kPoseSize;
  }
  if (!intrinsics_refined) return layout;
  for (size_t i = 0; i < layout.pose.size(); ++i) {
    const size_t l = intrinsics.lens_of_image[i];
    if (layout.pose[i] < 0 || layout.lens[l] >= 0) continue;
    layout.lens[l] = layout.size;
    for (size_t p = 0; p < intrinsics.lenses[l].params.size(); ++p) {
      if (IsPrincipalPoint(intrinsics.lenses[l].model, p)) continue;
      layout.lens_params[l].push_back(static_cast<Eigen::Index>(p));
    }
    layout.size += static_cast<Eigen::Index>(layout.lens_params[l].size());
  }
  return layout;
}

/// Unknowns that stand together: of one pose or one lens.
struct Segment {
  Eigen::Index place;   // of the first among all unknowns
  Eigen::Index column;  // of the first in the row's Jacobian
  Eigen::Index size;
};

/// One observation's weighted residual and its derivatives by pose and lens, and by the point.
struct Row {
  Eigen::Vector2d residual;
  Eigen::Matrix<double, 2, 3> by_point;
  Eigen::Matrix<double, 2, Eigen::Dynamic, 0, 2, kPoseSize + kMaxCameraParams> by_unknowns;
  Segment pose, lens;
};

Row MakeRow(const Reconstruction& reconstruction, const Features& features, const Layout& layout,
            const Point3& point, const Observation& observation) {
  const size_t image = observation.image.index();
  const size_t l = reconstruction.intrinsics.lens_of_image[image];
  const CameraIntrinsics& lens = reconstruction.intrinsics.lenses[l];
  const Rigid3& cam_from_model = *reconstruction.cam_from_model[image];
  const Keypoint& keypoint =
      features.image(observation.image).keypoints[observation.keypoint.index()];
  const Eigen::Vector3d x = cam_from_model * point.position;
  const bool with_lens = layout.lens[l] >= 0;
  ProjectionJacobian projection;
  ProjectWithJacobian(lens.model, lens.params.data(), x, with_lens, projection);
  const double weight = 1.0 / KeypointSigma_px(keypoint);
  Row row;
  row.residual = weight * (projection.pixel - Eigen::Vector2d(keypoint.x_px, keypoint.y_px));
  const Eigen::Matrix<double, 2, 3> by_x = weight * projection.by_point;
  row.by_point = by_x * cam_from_model.RotationMatrix();
  const auto& params = layout.lens_params[l];
  const auto lens_size = static_cast<Eigen::Index>(params.size());
  row.pose = {layout.pose[image], 0, kPoseSize};
  row.lens = {layout.lens[l], kPoseSize, lens_size};
  row.by_unknowns.resize(2, kPoseSize + lens_size);
  row.by_unknowns.leftCols<3>() = -by_x * CrossMatrix(x);
  row.by_unknowns.middleCols<3>(3) = -row.by_point;
  for (Eigen::Index p = 0; p < lens_size; ++p) {
    row.by_unknowns.col(kPoseSize + p) =
        weight * projection.by_params.col(params[static_cast<size_t>(p)]);
  }
  return row;
}

/// The lower triangle of the reduced normal matrix, and the residuals.
struct Normal {
  Eigen::MatrixXd matrix;
  Eigen::VectorXd redundancy;  // by registered image: what its points leave of its residuals
  double squares = 0;
  size_t observations = 0;
  size_t points = 0;
};

/// matrix += a^T b at the places of the rows' unknowns, on and below the diagonal blocks.
template <typename Reduced>
void AddProduct(const Reduced& a, const Row& rows, const Reduced& b, const Row& columns,
                Eigen::MatrixXd& matrix) {
  if (rows.pose.place >= columns.pose.place) {
    matrix.block<kPoseSize, kPoseSize>(rows.pose.place, columns.pose.place).noalias() +=
        a.template leftCols<kPoseSize>().transpose() * b.template leftCols<kPoseSize>();
  }
  for (const Segment& r : {rows.pose, rows.lens}) {
    for (const Segment& c : {columns.pose, columns.lens}) {
      if (r.place < c.place || r.size == 0 || c.size == 0) continue;
      if (r.column == 0 && c.column == 0) continue;
      matrix.block(r.place, c.place, r.size, c.size).noalias() +=
          a.middleCols(r.column, r.size).transpose() * b.middleCols(c.column, c.size);
    }
  }
}

/// The rows E (unknowns) and P (point) of one point, and L^-1 P^T E with L L^T = P^T P: what of the
/// unknowns the point takes up.
struct ReducedPoint {
  using Reduced = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kPoseSize + kMaxCameraParams>;
  std::vector<Row> rows;
  std::vector<Reduced> reduced;    // by row
  Eigen::Matrix3d inverse_factor;  // L^-1
};

/// nullopt: fewer than two images, or all in one line with the point.
std::optional<ReducedPoint> ReducePoint(const Reconstruction& reconstruction,
                                        const Features& features, const Layout& layout,
                                        const Point3& point) {
  ReducedPoint out;
  Eigen::Matrix3d point_normal = Eigen::Matrix3d::Zero();
  for (const Observation& observation : point.observations) {
    if (!reconstruction.Registered(observation.image)) continue;
    out.rows.push_back(MakeRow(reconstruction, features, layout, point, observation));
    point_normal += out.rows.back().by_point.transpose() * out.rows.back().by_point;
  }
  const Eigen::LLT<Eigen::Matrix3d> cholesky(point_normal);
  if (out.rows.size() < 2 || cholesky.info() != Eigen::Success) return std::nullopt;
  out.inverse_factor = cholesky.matrixL().solve(Eigen::Matrix3d(Eigen::Matrix3d::Identity()));
  for (const Row& row : out.rows) {
    out.reduced.push_back(out.inverse_factor * row.by_point.transpose() * row.by_unknowns);
  }
  return out;
}

/// S += E^T E - E^T P (P^T P)^-1 P^T E.
void AddNormal(const ReducedPoint& point, Normal& normal) {
  ++normal.points;
  for (size_t i = 0; i < point.rows.size(); ++i) {
    const Row& row = point.rows[i];
    normal.squares += row.residual.squaredNorm();
    ++normal.observations;
    const double taken_by_point = (point.inverse_factor * row.by_point.transpose()).squaredNorm();
    normal.redundancy[row.pose.place / kPoseSize] += 2.0 - taken_by_point;
    AddProduct(row.by_unknowns, row, row.by_unknowns, row, normal.matrix);
    for (size_t j = 0; j < point.rows.size(); ++j) {
      AddProduct(ReducedPoint::Reduced(-point.reduced[i]), row, point.reduced[j], point.rows[j],
                 normal.matrix);
    }
  }
}

/// How a point's residuals enter its gradient.
struct ResidualRule {
  double cut;             // longer ones are cut off there
  Eigen::VectorXd scale;  // by registered image: makes up for what its own pose has taken
};

/// M += g g^T with the gradient g = E^T r - E^T P (P^T P)^-1 P^T r of half the point's squared
/// residuals r.
void AddGradients(const ReducedPoint& point, const ResidualRule& rule, Eigen::MatrixXd& matrix) {
  using Gradient =
      Eigen::Matrix<double, 1, Eigen::Dynamic, Eigen::RowMajor, 1, kPoseSize + kMaxCameraParams>;
  std::vector<Eigen::Vector2d> residuals;
  Eigen::Vector3d taken_up = Eigen::Vector3d::Zero();
  for (const Row& row : point.rows) {
    const double length = std::max(row.residual.norm(), 1e-12);
    residuals.push_back(row.residual * std::min(1.0, rule.cut / length) *
                        rule.scale[row.pose.place / kPoseSize]);
    taken_up += point.inverse_factor * row.by_point.transpose() * residuals.back();
  }
  std::vector<Gradient> gradients;
  for (size_t i = 0; i < point.rows.size(); ++i) {
    gradients.push_back(residuals[i].transpose() * point.rows[i].by_unknowns -
                        taken_up.transpose() * point.reduced[i]);
  }
  for (size_t i = 0; i < gradients.size(); ++i) {
    for (size_t j = 0; j < gradients.size(); ++j) {
      AddProduct(gradients[i], point.rows[i], gradients[j], point.rows[j], matrix);
    }
  }
}

/// One per chunk of the points; `add` gets each reduced point with the sum of its chunk.
template <typename Sum, typename Add>
std::vector<Sum> SumOverPoints(const Reconstruction& reconstruction, const Features& features,
                               const Layout& layout, const Sum& zero, const Add& add,
                               RunContext& context) {
  std::vector<Sum> partial(kChunks, zero);
  const size_t count = reconstruction.points.size();
  context.threads.ParallelFor(kChunks, [&](size_t chunk) {
    for (size_t p = chunk * count / kChunks; p < (chunk + 1) * count / kChunks; ++p) {
      const auto point = ReducePoint(reconstruction, features, layout, reconstruction.points[p]);
      if (point) add(*point, partial[chunk]);
    }
  });
  return partial;
}

Normal SumNormal(const Reconstruction& reconstruction, const Features& features,
                 const Layout& layout, RunContext& context) {
  Normal sum;
  sum.matrix = Eigen::MatrixXd::Zero(layout.size, layout.size);
  sum.redundancy =
      Eigen::VectorXd::Zero(static_cast<Eigen::Index>(RegisteredCount(reconstruction)));
  for (const Normal& partial :
       SumOverPoints(reconstruction, features, layout, sum, AddNormal, context)) {
    sum.matrix += partial.matrix;
    sum.redundancy += partial.redundancy;
    sum.squares += partial.squares;
    sum.observations += partial.observations;
    sum.points += partial.points;
  }
  sum.matrix.triangularView<Eigen::StrictlyUpper>() = sum.matrix.transpose();
  return sum;
}

/// Of all points: the spread of the gradient of the cost, whatever the residuals of one point have
/// in common.
Eigen::MatrixXd SumGradients(const Reconstruction& reconstruction, const Features& features,
                             const Layout& layout, const ResidualRule& rule, RunContext& context) {
  const auto add = [&rule](const ReducedPoint& point, Eigen::MatrixXd& matrix) {
    AddGradients(point, rule, matrix);
  };
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(layout.size, layout.size);
  for (const Eigen::MatrixXd& partial :
       SumOverPoints(reconstruction, features, layout, sum, add, context)) {
    sum += partial;
  }
  sum.triangularView<Eigen::StrictlyUpper>() = sum.transpose();
  return sum;
}

/// sqrt(r / (r - 6)) for the redundancy r of each image (HC1 of MacKinnon & White 1985, image by
/// image): an image that few points hold has fitted its pose to their errors.
Eigen::VectorXd ScaleForOwnPose(const Eigen::VectorXd& redundancy) {
  const auto own = static_cast<double>(kPoseSize);
  return (redundancy.array() / (redundancy.array() - own).max(1.0)).sqrt();
}

/// The seven directions the data cannot see (columns of `free`: three shifts, three turns and the
/// scale, about the centroid of the centres, of unit length over all centres), and what they do to
/// the centres alone (rows of `fit`): fit * change = 0 says that the Sim(3) fit finds nothing.
struct Gauge {
  Eigen::MatrixXd free;
  Eigen::MatrixXd fit;
};

Gauge MakeGauge(const Reconstruction& reconstruction, const Layout& layout) {
  Gauge gauge = {Eigen::MatrixXd::Zero(layout.size, kGaugeSize),
                 Eigen::MatrixXd::Zero(kGaugeSize, layout.size)};
  Eigen::Vector3d centroid = Eigen::Vector3d::Zero();
  double count = 0;
  for (const auto& pose : reconstruction.cam_from_model) {
    if (!pose) continue;
    centroid += pose->OriginInSource();
    count += 1;
  }
  centroid /= count;
  for (size_t i = 0; i < layout.pose.size(); ++i) {
    if (layout.pose[i] < 0) continue;
    const Rigid3& pose = *reconstruction.cam_from_model[i];
    const Eigen::Vector3d arm = pose.OriginInSource() - centroid;
    auto by_rotation = gauge.free.middleRows<3>(layout.pose[i]);
    auto by_center = gauge.free.middleRows<3>(layout.pose[i] + 3);
    by_center.leftCols<3>().setIdentity();
    by_center.middleCols<3>(3) = -CrossMatrix(arm);
    by_center.col(6) = arm;
    by_rotation.middleCols<3>(3) = -pose.RotationMatrix();
    gauge.fit.middleCols<3>(layout.pose[i] + 3) = by_center.transpose();
  }
  for (Eigen::Index g = 0; g < kGaugeSize; ++g) {
    const double length = gauge.fit.row(g).norm();
    gauge.free.col(g) /= length;
    gauge.fit.row(g) /= length;
  }
  return gauge;
}

/// (S + w G^T G)^-1 is one covariance for some gauge; H = I - N (G N)^-1 G takes any gauge to that
/// of the fit.
Result<Eigen::MatrixXd> ConstrainedInverse(const Eigen::MatrixXd& normal, const Gauge& gauge) {
  const Error unsolvable = {ErrorCode::kFailed, "the normal equations do not determine the poses",
                            "covariance"};
  const double weight = normal.diagonal().mean();
  const Eigen::MatrixXd held = normal + weight * gauge.fit.transpose() * gauge.fit;
  // Angles, lengths and distortion coefficients differ by orders: equilibrate before factorising.
  const Eigen::VectorXd scale = held.diagonal().cwiseSqrt().cwiseInverse();
  if (!scale.allFinite()) return unsolvable;
  const Eigen::LLT<Eigen::MatrixXd> cholesky(scale.asDiagonal() * held * scale.asDiagonal());
  if (cholesky.info() != Eigen::Success) return unsolvable;
  const Eigen::Index size = normal.rows();
  const Eigen::MatrixXd inverse = scale.asDiagonal() *
                                  cholesky.solve(Eigen::MatrixXd::Identity(size, size)) *
                                  scale.asDiagonal();
  const Eigen::MatrixXd to_fit = Eigen::MatrixXd::Identity(size, size) -
                                 gauge.free * (gauge.fit * gauge.free).inverse() * gauge.fit;
  Eigen::MatrixXd covariance = to_fit * inverse * to_fit.transpose();
  if (!covariance.allFinite() || covariance.diagonal().minCoeff() < 0) return unsolvable;
  return covariance;
}

/// One observation's error: in standard deviations of its keypoint over kCut, cut off at length 1.
struct PlacedResidual {
  Eigen::Vector2d pixel;
  Eigen::Vector2d residual;
};

/// By ImageId.
std::vector<std::vector<PlacedResidual>> ResidualsByImage(const Reconstruction& reconstruction,
                                                          const Features& features, double sigma0) {
  std::vector<std::vector<PlacedResidual>> residuals(reconstruction.cam_from_model.size());
  for (const Point3& point : reconstruction.points) {
    for (const Observation& observation : point.observations) {
      const size_t image = observation.image.index();
      const auto& pose = reconstruction.cam_from_model[image];
      if (!pose) continue;
      const auto projected =
          reconstruction.intrinsics.of(observation.image).Project(*pose * point.position);
      if (!projected) continue;
      const Keypoint& keypoint =
          features.image(observation.image).keypoints[observation.keypoint.index()];
      const Eigen::Vector2d pixel(keypoint.x_px, keypoint.y_px);
      const Eigen::Vector2d residual =
          (*projected - pixel) / (KeypointSigma_px(keypoint) * kCut * sigma0);
      residuals[image].push_back({pixel, residual / std::max(1.0, residual.norm())});
    }
  }
  return residuals;
}

/// Sum of the products of all ordered pairs of residuals of one picture that are within `reach_px`,
/// each with itself too.
double SumOfNearProducts(std::vector<PlacedResidual> residuals, double reach_px) {
  std::sort(residuals.begin(), residuals.end(),
            [](const PlacedResidual& a, const PlacedResidual& b) {
              return std::pair(a.pixel.x(), a.pixel.y()) < std::pair(b.pixel.x(), b.pixel.y());
            });
  double sum = 0;
  for (size_t i = 0; i < residuals.size(); ++i) {
    sum += residuals[i].residual.squaredNorm();
    for (size_t j = i + 1; j < residuals.size(); ++j) {
      if (residuals[j].pixel.x() - residuals[i].pixel.x() > reach_px) break;
      if ((residuals[j].pixel - residuals[i].pixel).squaredNorm() > reach_px * reach_px) continue;
      sum += 2 * residuals[i].residual.dot(residuals[j].residual);
    }
  }
  return sum;
}

/// By how much the variance exceeds that of independent errors, >= 1: the sum of the correlations
/// of one error with itself (1) and its neighbours, sum over near pairs of e_i . e_j / sum over all
/// of e_i . e_i (the effective sample size of spatial statistics; Clifford, Richardson & Hemon
/// 1989).
double CorrelationInflation(const Reconstruction& reconstruction, const Features& features,
                            double sigma0) {
  double products = 0, squares = 0;
  std::vector<std::vector<PlacedResidual>> residuals =
      ResidualsByImage(reconstruction, features, sigma0);
  for (size_t i = 0; i < residuals.size(); ++i) {
    const CameraIntrinsics& lens = reconstruction.intrinsics.of(ImageId(i));
    for (const PlacedResidual& one : residuals[i]) squares += one.residual.squaredNorm();
    products += SumOfNearProducts(std::move(residuals[i]),
                                  kAlikeWithin * std::max(lens.width_px, lens.height_px));
  }
  return squares > 0 ? std::max(1.0, products / squares) : 1.0;
}

}  // namespace

Result<PoseCovariances> BuildPoseCovariances(const Reconstruction& reconstruction,
                                             const Features& features, bool intrinsics_refined,
                                             RunContext& context) {
  if (RegisteredCount(reconstruction) < 3) {
    return Error{ErrorCode::kInvalidArgument,
                 std::to_string(RegisteredCount(reconstruction)) +
                     " registered images; a similarity fit needs 3",
                 "covariance"};
  }
  const Layout layout = MakeLayout(reconstruction, intrinsics_refined);
  const Normal normal = SumNormal(reconstruction, features, layout, context);
  const double redundancy = 2.0 * static_cast<double>(normal.observations) -
                            3.0 * static_cast<double>(normal.points) -
                            static_cast<double>(layout.size - kGaugeSize);
  if (!(redundancy > 0)) {
    return Error{ErrorCode::kFailed, "fewer observations than unknowns", "covariance"};
  }
  ROTUNDA_ASSIGN_OR_RETURN(Eigen::MatrixXd covariance,
                           ConstrainedInverse(normal.matrix, MakeGauge(reconstruction, layout)));
  PoseCovariances out;
  out.sigma0 = std::sqrt(normal.squares / redundancy);
  const ResidualRule rule{kCut * out.sigma0, ScaleForOwnPose(normal.redundancy)};
  covariance = CorrelationInflation(reconstruction, features, out.sigma0) * covariance *
               SumGradients(reconstruction, features, layout, rule, context) * covariance;
  for (const Eigen::Index place : layout.pose) {
    out.images.push_back(place < 0 ? std::nullopt
                                   : std::optional<PoseCovariance>(
                                         covariance.block<kPoseSize, kPoseSize>(place, place)));
  }
  for (const Eigen::Index place : layout.lens) {  // a model's first parameter is a focal length
    out.focal_sigma_px.push_back(
        place < 0 ? std::nullopt : std::optional<double>(std::sqrt(covariance(place, place))));
  }
  return out;
}

PoseSigma SigmaOf(const PoseCovariance& covariance) {
  PoseSigma sigma;
  sigma.rotation_deg = DegFromRad(std::sqrt(covariance.topLeftCorner<3, 3>().trace()));
  sigma.position_mm = 1000.0 * std::sqrt(covariance.bottomRightCorner<3, 3>().trace());
  return sigma;
}

}  // namespace rotunda::sfm
