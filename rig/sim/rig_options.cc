#include "rig/sim/rig_options.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>

#include "rig/sim/noise.h"
#include "sfm/core/run_context.h"

namespace rotunda::sim {
namespace {

struct Bound {
  const char* field;
  double value;
  double low;
  double high;
};

Status CheckBounds(const std::vector<Bound>& bounds) {
  for (const Bound& bound : bounds) {
    if (bound.value >= bound.low && bound.value <= bound.high) continue;
    std::ostringstream text;
    text << "is " << bound.value << ", allowed is " << bound.low << " to " << bound.high;
    return Error{ErrorCode::kInvalidArgument, text.str(), bound.field};
  }
  return {};
}

/// A camera at `position` that looks at `target`, upright, then rolled about its axis.
Rigid3 LookAt(const Eigen::Vector3d& position, const Eigen::Vector3d& target, double roll_rad) {
  const Eigen::Vector3d forward = (target - position).normalized();
  const Eigen::Vector3d right = forward.cross(Eigen::Vector3d::UnitZ()).normalized();
  Eigen::Matrix3d cam_from_rig;
  cam_from_rig << right.transpose(), forward.cross(right).transpose(), forward.transpose();
  const Eigen::Quaterniond rolled(
      Eigen::AngleAxisd(roll_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix() * cam_from_rig);
  return {rolled.normalized(), -(rolled.normalized() * position)};
}

CalibratedCamera DrawCamera(const RigOptions& options, int column, int row, Random random) {
  const RigGeometry& g = options.geometry;
  const RigCamera& c = options.camera;
  const RigJitter& j = options.jitter;
  const auto normal = [&] { return std::clamp(random.Normal(), -3.0, 3.0); };
  const double azimuth_rad = 2 * kPi * column / g.columns;
  const double up = g.rows > 1 ? static_cast<double>(row) / (g.rows - 1) : 0.5;
  const double height_m = 1e-3 * (g.lowest_mm + (g.highest_mm - g.lowest_mm) * up);
  const double aim_m = 1e-3 * (g.aim_lowest_mm + (g.aim_highest_mm - g.aim_lowest_mm) * up);
  const double radius_m = 1e-3 * g.radius_mm;
  Eigen::Vector3d position(radius_m * std::cos(azimuth_rad), radius_m * std::sin(azimuth_rad),
                           height_m);
  for (int axis = 0; axis < 3; ++axis) position[axis] += 1e-3 * j.position_mm * normal();
  Eigen::Vector3d target(0, 0, aim_m);
  const double aim_error_m = radius_m * RadFromDeg(j.aim_deg);
  target +=
      aim_error_m * normal() * Eigen::Vector3d(-std::sin(azimuth_rad), std::cos(azimuth_rad), 0);
  target.z() += aim_error_m * normal();
  CalibratedCamera camera;
  camera.camera = CameraName(column, row);
  char serial[16];
  std::snprintf(serial, sizeof(serial), "SIM%05d", 100 * (column + 1) + row);
  camera.serial = serial;
  camera.cam_from_rig = LookAt(position, target, RadFromDeg(j.roll_deg) * normal());
  const double focal = c.focal_px * (1 + 0.01 * j.focal_percent * normal());
  const double radial = 1 + 0.01 * j.radial_percent * normal();
  const double cx = 0.5 * c.width_px + j.principal_point_px * normal();
  const double cy = 0.5 * c.height_px + j.principal_point_px * normal();
  camera.intrinsics = {CameraModel::kOpencv,
                       c.width_px,
                       c.height_px,
                       {focal, focal * (1 + 2e-4 * normal()), cx, cy, c.k1 * radial, c.k2 * radial,
                        c.p1 + j.tangential * normal(), c.p2 + j.tangential * normal()}};
  return camera;
}

/// Which cameras stay: the same number in each column as nearly as possible, columns that get more
/// alternate, and rows shift from column to column so that all heights are used.
std::vector<std::pair<int, int>> ChooseCameras(const RigGeometry& g, int count) {
  const int columns = std::min(g.columns, count);
  std::vector<std::pair<int, int>> chosen;
  for (int i = 0; i < columns; ++i) {
    const int column = i * g.columns / columns;
    const int in_column = (i + 1) * count / columns - i * count / columns;
    for (int k = 0; k < in_column; ++k) {
      const double phase = in_column == g.rows ? 0.5 : (i % 2 == 0 ? 0.3 : 0.7);
      const int row = static_cast<int>((k + phase) * g.rows / in_column);
      chosen.emplace_back(column, std::clamp(row, 0, g.rows - 1));
    }
  }
  return chosen;
}

}  // namespace

Status RigOptions::Validate() const {
  const RigGeometry& g = geometry;
  const RigCamera& c = camera;
  return CheckBounds({
      {"rig.columns", 1.0 * g.columns, 3, 99},
      {"rig.rows", 1.0 * g.rows, 1, 10},
      {"rig.radius_mm", g.radius_mm, 800, 10000},
      {"rig.lowest_mm", g.lowest_mm, 0, 5000},
      {"rig.highest_mm", g.highest_mm, g.lowest_mm, 5000},
      {"rig.aim_lowest_mm", g.aim_lowest_mm, 0, 5000},
      {"rig.aim_highest_mm", g.aim_highest_mm, 0, 5000},
      {"camera.width_px", 1.0 * c.width_px, 64, 8192},
      {"camera.height_px", 1.0 * c.height_px, 64, 8192},
      {"camera.focal_px", c.focal_px, 0.5 * std::max(c.width_px, c.height_px), 100000},
      {"camera.k1", c.k1, -0.5, 0.5},
      {"camera.k2", c.k2, -0.5, 0.5},
      {"camera.p1", c.p1, -0.01, 0.01},
      {"camera.p2", c.p2, -0.01, 0.01},
      {"jitter.position_mm", jitter.position_mm, 0, 50},
      {"jitter.aim_deg", jitter.aim_deg, 0, 5},
      {"jitter.roll_deg", jitter.roll_deg, 0, 10},
      {"jitter.focal_percent", jitter.focal_percent, 0, 5},
      {"jitter.principal_point_px", jitter.principal_point_px, 0, 100},
      {"jitter.radial_percent", jitter.radial_percent, 0, 30},
      {"jitter.tangential", jitter.tangential, 0, 0.002},
      {"sensor.vignetting", sensor.vignetting, 0, 0.9},
      {"sensor.gain_spread_percent", sensor.gain_spread_percent, 0, 30},
      {"sensor.colour_spread_percent", sensor.colour_spread_percent, 0, 30},
      {"sensor.full_well_e", sensor.full_well_e, 100, 1e6},
      {"sensor.read_noise_e", sensor.read_noise_e, 0, 1000},
      {"sensor.blur_px", sensor.blur_px, 0, 1.0},
      {"sensor.exposure_us", sensor.exposure_us, 1, 1e6},
  });
}

std::string CameraName(int column, int row) {
  char name[32];
  std::snprintf(name, sizeof(name), "c%02dr%d", column, row);
  return name;
}

Calibration DrawRig(const RigOptions& options, uint64_t seed, int count, double picture_scale) {
  Calibration truth;
  truth.created_at = "2000-01-01T00:00:00Z";
  truth.source = CalibrationSource::kTruth;
  for (const auto& [column, row] : ChooseCameras(options.geometry, count)) {
    const uint64_t index = static_cast<uint64_t>(column) * 16 + static_cast<uint64_t>(row);
    truth.cameras.push_back(DrawCamera(options, column, row, Random(DeriveSeed(seed, index))));
    CameraIntrinsics& intrinsics = truth.cameras.back().intrinsics;
    intrinsics = ScaledIntrinsics(intrinsics, picture_scale);
  }
  std::sort(truth.cameras.begin(), truth.cameras.end(),
            [](const auto& a, const auto& b) { return a.camera < b.camera; });
  return truth;
}

}  // namespace rotunda::sim
