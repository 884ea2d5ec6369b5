#include "sfm/core/camera.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <array>
#include <cmath>

namespace rotunda {
namespace {

struct ModelRow {
  CameraModel model;
  std::string_view name;
  int colmap_id;
  size_t params;
};

constexpr std::array<ModelRow, 6> kModels = {{
    {CameraModel::kSimplePinhole, "SIMPLE_PINHOLE", 0, 3},
    {CameraModel::kPinhole, "PINHOLE", 1, 4},
    {CameraModel::kSimpleRadial, "SIMPLE_RADIAL", 2, 4},
    {CameraModel::kRadial, "RADIAL", 3, 5},
    {CameraModel::kOpencv, "OPENCV", 4, 8},
    {CameraModel::kFullOpencv, "FULL_OPENCV", 6, 12},
}};

const ModelRow& RowOf(CameraModel model) {
  for (const ModelRow& row : kModels) {
    if (row.model == model) return row;
  }
  std::abort();
}

bool HasTwoFocals(CameraModel model) {
  return model == CameraModel::kPinhole || model == CameraModel::kOpencv ||
         model == CameraModel::kFullOpencv;
}

/// A number that carries its derivatives by u and v: the Jacobian of DistortToPixel.
struct Dual {
  double value = 0, du = 0, dv = 0;
  Dual(double v) : value(v) {}
  Dual(double v, double a, double b) : value(v), du(a), dv(b) {}
};
Dual operator+(const Dual& a, const Dual& b) {
  return {a.value + b.value, a.du + b.du, a.dv + b.dv};
}
Dual operator*(const Dual& a, const Dual& b) {
  return {a.value * b.value, a.du * b.value + a.value * b.du, a.dv * b.value + a.value * b.dv};
}
Dual operator/(const Dual& a, const Dual& b) {
  const double q = a.value / b.value;
  return {q, (a.du - q * b.du) / b.value, (a.dv - q * b.dv) / b.value};
}

/// Every model as OpenCV's full one, and where each coefficient stands among the model's
/// parameters; -1: the model does not have it and it is zero.
struct FullModel {
  double fx = 1, fy = 1, cx = 0, cy = 0;
  std::array<double, 6> k = {};  // radial: k1-k3 above, k4-k6 below the fraction bar
  std::array<double, 2> p = {};
};
struct FullModelPlaces {
  int fx, fy, cx, cy;
  std::array<int, 6> k;
  std::array<int, 2> p;
};

const FullModelPlaces& PlacesOf(CameraModel model) {
  static constexpr std::array<FullModelPlaces, 6> kPlaces = {{
      {0, 0, 1, 2, {-1, -1, -1, -1, -1, -1}, {-1, -1}},
      {0, 1, 2, 3, {-1, -1, -1, -1, -1, -1}, {-1, -1}},
      {0, 0, 1, 2, {3, -1, -1, -1, -1, -1}, {-1, -1}},
      {0, 0, 1, 2, {3, 4, -1, -1, -1, -1}, {-1, -1}},
      {0, 1, 2, 3, {4, 5, -1, -1, -1, -1}, {6, 7}},
      {0, 1, 2, 3, {4, 5, 8, 9, 10, 11}, {6, 7}},
  }};
  return kPlaces[static_cast<size_t>(model)];
}

FullModel UnpackParams(const FullModelPlaces& places, const double* params) {
  FullModel full;
  full.fx = params[places.fx];
  full.fy = params[places.fy];
  full.cx = params[places.cx];
  full.cy = params[places.cy];
  for (size_t i = 0; i < full.k.size(); ++i) {
    if (places.k[i] >= 0) full.k[i] = params[places.k[i]];
  }
  for (size_t i = 0; i < full.p.size(); ++i) {
    if (places.p[i] >= 0) full.p[i] = params[places.p[i]];
  }
  return full;
}

}  // namespace

std::string_view CameraModelName(CameraModel model) { return RowOf(model).name; }
int ColmapModelId(CameraModel model) { return RowOf(model).colmap_id; }
size_t CameraParamCount(CameraModel model) { return RowOf(model).params; }

Result<CameraModel> CameraModelFromName(std::string_view name) {
  std::string known;
  for (const ModelRow& row : kModels) {
    if (row.name == name) return row.model;
    known += (known.empty() ? "" : ", ") + std::string(row.name);
  }
  return Error{ErrorCode::kBadInput,
               "camera model '" + std::string(name) + "' is not known; known are " + known, ""};
}

Result<CameraModel> CameraModelFromColmapId(int id) {
  for (const ModelRow& row : kModels) {
    if (row.colmap_id == id) return row.model;
  }
  return Error{ErrorCode::kBadInput,
               "COLMAP camera model number " + std::to_string(id) + " is not supported", ""};
}

double CameraIntrinsics::fy_px() const { return HasTwoFocals(model) ? params[1] : params[0]; }
double CameraIntrinsics::cx_px() const { return params[HasTwoFocals(model) ? 2 : 1]; }
double CameraIntrinsics::cy_px() const { return params[HasTwoFocals(model) ? 3 : 2]; }

Eigen::Vector2d CameraIntrinsics::PixelFromNormalized(const Eigen::Vector2d& normalized) const {
  Eigen::Vector2d pixel;
  DistortToPixel(model, params.data(), normalized.x(), normalized.y(), &pixel.x(), &pixel.y());
  return pixel;
}

std::optional<Eigen::Vector2d> CameraIntrinsics::Project(const Eigen::Vector3d& x_in_cam) const {
  if (!(x_in_cam.z() > 0)) return std::nullopt;
  return PixelFromNormalized(x_in_cam.hnormalized());
}

std::optional<Eigen::Vector2d> CameraIntrinsics::NormalizedFromPixel(
    const Eigen::Vector2d& pixel) const {
  constexpr int kMaxIterations = 30;
  constexpr double kTolerance = 1e-10;
  std::array<Dual, 12> dual_params = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
  for (size_t i = 0; i < params.size(); ++i) dual_params[i] = params[i];
  Eigen::Vector2d normalized((pixel.x() - cx_px()) / fx_px(), (pixel.y() - cy_px()) / fy_px());
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    Dual x(0), y(0);
    DistortToPixel(model, dual_params.data(), Dual(normalized.x(), 1, 0),
                   Dual(normalized.y(), 0, 1), &x, &y);
    Eigen::Matrix2d jacobian;
    jacobian << x.du, x.dv, y.du, y.dv;
    const Eigen::Vector2d step = jacobian.inverse() * (pixel - Eigen::Vector2d(x.value, y.value));
    if (!step.allFinite()) return std::nullopt;
    normalized += step;
    if (step.norm() < kTolerance) return normalized;
  }
  return std::nullopt;
}

void ProjectWithJacobian(CameraModel model, const double* params, const Eigen::Vector3d& x_in_cam,
                         bool with_params, ProjectionJacobian& out) {
  const FullModelPlaces& places = PlacesOf(model);
  const FullModel c = UnpackParams(places, params);
  const double inverse_z = 1.0 / x_in_cam.z();
  const double u = x_in_cam.x() * inverse_z;
  const double v = x_in_cam.y() * inverse_z;
  const double r2 = u * u + v * v;
  const double above = 1.0 + (c.k[0] + (c.k[1] + c.k[2] * r2) * r2) * r2;
  const double inverse_below = 1.0 / (1.0 + (c.k[3] + (c.k[4] + c.k[5] * r2) * r2) * r2);
  const double radial = above * inverse_below;
  const double above_by_r2 = c.k[0] + (2.0 * c.k[1] + 3.0 * c.k[2] * r2) * r2;
  const double below_by_r2 = c.k[3] + (2.0 * c.k[4] + 3.0 * c.k[5] * r2) * r2;
  const double radial_by_r2 = (above_by_r2 - radial * below_by_r2) * inverse_below;
  const double x = u * radial + 2.0 * c.p[0] * u * v + c.p[1] * (r2 + 2.0 * u * u);
  const double y = v * radial + 2.0 * c.p[1] * u * v + c.p[0] * (r2 + 2.0 * v * v);
  out.pixel = {c.fx * x + c.cx, c.fy * y + c.cy};

  const double cross = 2.0 * (radial_by_r2 * u * v + c.p[0] * u + c.p[1] * v);
  const double x_by_u = radial + 2.0 * radial_by_r2 * u * u + 2.0 * c.p[0] * v + 6.0 * c.p[1] * u;
  const double y_by_v = radial + 2.0 * radial_by_r2 * v * v + 2.0 * c.p[1] * u + 6.0 * c.p[0] * v;
  out.by_point << c.fx * x_by_u, c.fx * cross, -c.fx * (x_by_u * u + cross * v),  //
      c.fy * cross, c.fy * y_by_v, -c.fy * (cross * u + y_by_v * v);
  out.by_point *= inverse_z;

  if (!with_params) return;
  out.by_params.setZero();
  out.by_params(0, places.fx) = x;
  out.by_params(1, places.fy) = y;
  out.by_params(0, places.cx) = 1.0;
  out.by_params(1, places.cy) = 1.0;
  double power = inverse_below;
  for (size_t i = 0; i < c.k.size(); ++i) {
    if (i == 3) power = -radial * inverse_below;
    power *= r2;
    if (places.k[i] < 0) continue;
    out.by_params.col(places.k[i]) << c.fx * u * power, c.fy * v * power;
  }
  if (places.p[0] < 0) return;
  out.by_params.col(places.p[0]) << c.fx * 2.0 * u * v, c.fy * (r2 + 2.0 * v * v);
  out.by_params.col(places.p[1]) << c.fx * (r2 + 2.0 * u * u), c.fy * 2.0 * u * v;
}

bool IsPrincipalPoint(CameraModel model, size_t param) {
  const FullModelPlaces& places = PlacesOf(model);
  return static_cast<int>(param) == places.cx || static_cast<int>(param) == places.cy;
}

bool IsFocal(CameraModel model, size_t param) {
  const FullModelPlaces& places = PlacesOf(model);
  return static_cast<int>(param) == places.fx || static_cast<int>(param) == places.fy;
}

Status CameraIntrinsics::Validate() const {
  const auto bad = [&](const std::string& what) {
    return Error{ErrorCode::kBadInput, what, std::string(CameraModelName(model))};
  };
  if (width_px <= 0 || height_px <= 0) {
    return bad("picture size " + std::to_string(width_px) + "x" + std::to_string(height_px) +
               " is not positive");
  }
  if (params.size() != CameraParamCount(model)) {
    return bad("has " + std::to_string(params.size()) + " parameters, expected " +
               std::to_string(CameraParamCount(model)));
  }
  for (double value : params) {
    if (!std::isfinite(value)) return bad("a parameter is not a finite number");
  }
  if (fx_px() <= 0 || fy_px() <= 0) return bad("the focal length is not positive");
  return {};
}

CameraIntrinsics DefaultIntrinsics(int width_px, int height_px, double focal_px) {
  return {CameraModel::kSimpleRadial,
          width_px,
          height_px,
          {focal_px, 0.5 * width_px, 0.5 * height_px, 0.0}};
}

CameraIntrinsics ScaledIntrinsics(const CameraIntrinsics& intrinsics, double factor) {
  CameraIntrinsics scaled = intrinsics;
  scaled.width_px = static_cast<int>(std::lround(intrinsics.width_px * factor));
  scaled.height_px = static_cast<int>(std::lround(intrinsics.height_px * factor));
  const size_t linear = HasTwoFocals(intrinsics.model) ? 4 : 3;
  for (size_t i = 0; i < linear; ++i) scaled.params[i] *= factor;
  return scaled;
}

}  // namespace rotunda
