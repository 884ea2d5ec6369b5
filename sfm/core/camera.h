#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "sfm/core/result.h"

namespace rotunda {

/// Pictures and cameras with a longer side are refused by every reader.
inline constexpr int kMaxPictureSide_px = 100000;

/// COLMAP's models, with COLMAP's parameter order and meaning (src/base/camera_models.h of 3.8).
/// Pixel (0.5, 0.5) is the centre of the top-left pixel.
enum class CameraModel {
  kSimplePinhole,  // f cx cy
  kPinhole,        // fx fy cx cy
  kSimpleRadial,   // f cx cy k
  kRadial,         // f cx cy k1 k2
  kOpencv,         // fx fy cx cy k1 k2 p1 p2
  kFullOpencv,     // fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6
};

std::string_view CameraModelName(CameraModel model);
Result<CameraModel> CameraModelFromName(std::string_view name);
/// COLMAP's number of the model, as in cameras.bin and database.db.
int ColmapModelId(CameraModel model);
Result<CameraModel> CameraModelFromColmapId(int id);
size_t CameraParamCount(CameraModel model);

struct CameraIntrinsics {
  CameraModel model = CameraModel::kOpencv;
  int width_px = 0;
  int height_px = 0;
  std::vector<double> params;  // CameraParamCount(model) of them, in COLMAP's order

  double fx_px() const { return params[0]; }
  double fy_px() const;
  double cx_px() const;
  double cy_px() const;
  double MeanFocal_px() const { return 0.5 * (fx_px() + fy_px()); }

  /// Pixel of a point in the camera frame; nullopt when it is not in front (z <= 0).
  std::optional<Eigen::Vector2d> Project(const Eigen::Vector3d& x_in_cam) const;

  /// Distorted normalised coordinates (x/z, y/z) -> pixel, without the check for z.
  Eigen::Vector2d PixelFromNormalized(const Eigen::Vector2d& normalized) const;

  /// Ray through a pixel as normalised, undistorted coordinates (x/z, y/z). Newton iterations on
  /// the distortion (analytic Jacobian); nullopt when they do not converge to 1e-10.
  std::optional<Eigen::Vector2d> NormalizedFromPixel(const Eigen::Vector2d& pixel) const;

  bool Contains(const Eigen::Vector2d& pixel) const {
    return pixel.x() >= 0 && pixel.y() >= 0 && pixel.x() < width_px && pixel.y() < height_px;
  }

  /// Parameter count, positive size and focal length, finite values.
  Status Validate() const;
};

/// SIMPLE_RADIAL with the given focal length and the principal point in the middle.
CameraIntrinsics DefaultIntrinsics(int width_px, int height_px, double focal_px);

/// The same camera for a picture resized by `factor` (pixels-per-pixel, e.g. 0.5 for half size).
CameraIntrinsics ScaledIntrinsics(const CameraIntrinsics& intrinsics, double factor);

inline constexpr size_t kMaxCameraParams = 12;

/// A projection and its derivatives.
struct ProjectionJacobian {
  Eigen::Vector2d pixel;
  Eigen::Matrix<double, 2, 3> by_point;  // by x_in_cam
  /// By the parameters, in their order; columns from CameraParamCount(model) on are zero.
  Eigen::Matrix<double, 2, kMaxCameraParams> by_params;
};

/// Pixel of `x_in_cam` (z > 0 is the caller's business) with analytic derivatives by the point and,
/// when `with_params`, by the parameters; else `by_params` is not written.
void ProjectWithJacobian(CameraModel model, const double* params, const Eigen::Vector3d& x_in_cam,
                         bool with_params, ProjectionJacobian& out);

/// True for parameters that are neither focal length nor distortion: the principal point.
bool IsPrincipalPoint(CameraModel model, size_t param);
/// True for focal lengths.
bool IsFocal(CameraModel model, size_t param);

/// Distortion of every model brought to one form, and the projection as a template, so that the
/// optimiser's Jacobians (ceres::Jet) and Project run the same code. `params` as in
/// CameraIntrinsics; `u, v` are x/z and y/z.
template <typename T>
void DistortToPixel(CameraModel model, const T* params, const T& u, const T& v, T* x_px, T* y_px) {
  const T r2 = u * u + v * v;
  switch (model) {
    case CameraModel::kSimplePinhole:
      *x_px = params[0] * u + params[1];
      *y_px = params[0] * v + params[2];
      return;
    case CameraModel::kPinhole:
      *x_px = params[0] * u + params[2];
      *y_px = params[1] * v + params[3];
      return;
    case CameraModel::kSimpleRadial: {
      const T radial = T(1) + params[3] * r2;
      *x_px = params[0] * u * radial + params[1];
      *y_px = params[0] * v * radial + params[2];
      return;
    }
    case CameraModel::kRadial: {
      const T radial = T(1) + (params[3] + params[4] * r2) * r2;
      *x_px = params[0] * u * radial + params[1];
      *y_px = params[0] * v * radial + params[2];
      return;
    }
    case CameraModel::kOpencv:
    case CameraModel::kFullOpencv: {
      T radial = T(1) + (params[4] + params[5] * r2) * r2;
      if (model == CameraModel::kFullOpencv) {
        radial = (radial + params[8] * r2 * r2 * r2) /
                 (T(1) + (params[9] + (params[10] + params[11] * r2) * r2) * r2);
      }
      const T du = T(2) * params[6] * u * v + params[7] * (r2 + T(2) * u * u);
      const T dv = T(2) * params[7] * u * v + params[6] * (r2 + T(2) * v * v);
      *x_px = params[0] * (u * radial + du) + params[2];
      *y_px = params[1] * (v * radial + dv) + params[3];
      return;
    }
  }
}

}  // namespace rotunda
