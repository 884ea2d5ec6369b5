#pragma once

#include <cstdint>
#include <vector>

#include "sfm/core/calibration.h"
#include "sfm/core/result.h"

namespace rotunda::sim {

/// Where the cameras stand: columns evenly around the axis, the same rows in each.
struct RigGeometry {
  int columns = 15;
  int rows = 6;
  double radius_mm = 1700;
  double lowest_mm = 250;        // height of the lowest row
  double highest_mm = 1950;      // and of the highest
  double aim_lowest_mm = 560;    // height on the axis that the lowest row looks at
  double aim_highest_mm = 1270;  // and the highest row
};

/// The lens and sensor every camera nominally has; portrait.
struct RigCamera {
  int width_px = 1200;
  int height_px = 1600;
  double focal_px = 1840;
  double k1 = -0.085;  // OPENCV model
  double k2 = 0.045;
  double p1 = 0.0;
  double p2 = 0.0;
};

/// How far real cameras are from nominal: one standard deviation each.
struct RigJitter {
  double position_mm = 6;
  double aim_deg = 0.7;
  double roll_deg = 0.9;
  double focal_percent = 0.5;
  double principal_point_px = 7;
  double radial_percent = 8;   // of k1 and k2
  double tangential = 0.0003;  // of p1 and p2
};

struct RigSensor {
  double vignetting = 0.22;        // loss of light in the corners, 0..1
  double gain_spread_percent = 4;  // between cameras
  double colour_spread_percent = 1.5;
  double full_well_e = 10500;  // electrons at white: sets the shot noise
  double read_noise_e = 9;
  double blur_px = 0.45;  // standard deviation of the lens's spot
  double exposure_us = 4000;
};

struct RigOptions {
  RigGeometry geometry;
  RigCamera camera;
  RigJitter jitter;
  RigSensor sensor;

  /// kInvalidArgument naming the field, what it is and what it may be.
  Status Validate() const;
};

/// "c07r2": column 7, row 2.
std::string CameraName(int column, int row);

/// The true cameras of a rig with this seed, sorted by name, pictures scaled by `picture_scale`.
/// `count` of columns x rows are kept, spread evenly over both; a camera that is kept is the same
/// for any count. The id is the caller's to give.
Calibration DrawRig(const RigOptions& options, uint64_t seed, int count, double picture_scale);

}  // namespace rotunda::sim
