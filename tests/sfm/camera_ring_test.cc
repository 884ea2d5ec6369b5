#include "sfm/camera_ring.h"

#include <gtest/gtest.h>

#include <cmath>

namespace rotunda::sfm {
namespace {

/// Cameras in `rows` rings of radius 2 about (0, 0, 1), at the given azimuths, looking at the axis
/// half way between their height and the middle, as those of a rig do.
Reconstruction Ring(const std::vector<double>& azimuths_deg, int rows, double height) {
  Reconstruction model;
  for (const double azimuth_deg : azimuths_deg) {
    for (int row = 0; row < rows; ++row) {
      const double z = 1 + (rows == 1 ? 0 : height * (double(row) / (rows - 1) - 0.5));
      const double azimuth_rad = RadFromDeg(azimuth_deg);
      const Eigen::Vector3d centre(2 * std::cos(azimuth_rad), 2 * std::sin(azimuth_rad), z);
      const Eigen::Vector3d z_axis = (Eigen::Vector3d(0, 0, 0.5 * (1 + z)) - centre).normalized();
      const Eigen::Vector3d x_axis = z_axis.cross(Eigen::Vector3d::UnitZ()).normalized();
      Eigen::Matrix3d model_from_cam;
      model_from_cam << x_axis, z_axis.cross(x_axis), z_axis;
      const Eigen::Quaterniond rotation(model_from_cam.transpose());
      model.cam_from_model.push_back(Rigid3{rotation, -(rotation * centre)});
    }
  }
  return model;
}

std::vector<double> Steps(double from_deg, double step_deg, int count) {
  std::vector<double> azimuths_deg;
  for (int i = 0; i < count; ++i) azimuths_deg.push_back(from_deg + step_deg * i);
  return azimuths_deg;
}

TEST(FindCameraRing, AWholeRingHasTheGapBetweenItsColumns) {
  for (const int rows : {1, 6}) {
    const auto ring = FindCameraRing(Ring(Steps(7, 24, 15), rows, 1.7));
    ASSERT_TRUE(ring);
    EXPECT_NEAR(DegFromRad(ring->widest_gap_rad), 24, 1e-6) << rows << " rows";
    EXPECT_NEAR(ring->axis.z(), 1, 1e-9) << "upwards";
    EXPECT_NEAR((ring->centre - Eigen::Vector3d(0, 0, 1)).norm(), 0, 1e-6);
  }
}

TEST(AzimuthsAround, GrowCounterClockwiseSeenFromAbove) {
  Reconstruction model = Ring({10, 55, 130, 250}, 1, 0);
  model.cam_from_model[2].reset();
  const auto ring = FindCameraRing(model);
  ASSERT_TRUE(ring);
  const auto azimuths_rad = AzimuthsAround(*ring, model);
  ASSERT_EQ(azimuths_rad.size(), 4u);
  EXPECT_FALSE(azimuths_rad[2]);
  const auto from_first_rad = [&](size_t i) {
    return std::remainder(*azimuths_rad[i] - *azimuths_rad[0], 2 * kPi);
  };
  EXPECT_NEAR(from_first_rad(1), RadFromDeg(45), 1e-9);
  EXPECT_NEAR(from_first_rad(3), RadFromDeg(-120), 1e-9);
}

TEST(FindCameraRing, CamerasOnTheirSideDoNotTellWhichWayIsUp) {
  Reconstruction model = Ring(Steps(7, 24, 15), 2, 1.7);
  EXPECT_TRUE(FindCameraRing(model)->upright);
  const Rigid3 rolled{Eigen::Quaterniond(Eigen::AngleAxisd(kPi / 2, Eigen::Vector3d::UnitZ())),
                      Eigen::Vector3d::Zero()};
  for (auto& cam_from_model : model.cam_from_model) cam_from_model = rolled * *cam_from_model;
  EXPECT_FALSE(FindCameraRing(model)->upright);
}

TEST(FindCameraRing, HalfARingLeavesTheOtherHalf) {
  const auto ring = FindCameraRing(Ring(Steps(-84, 12, 15), 6, 1.7));
  ASSERT_TRUE(ring);
  // The rows look at different heights, so that the centre of an arc, and with it the axis, is off.
  EXPECT_NEAR(DegFromRad(ring->widest_gap_rad), 192, 4);
}

TEST(FindCameraRing, LostColumnsAreAGap) {
  const auto ring = FindCameraRing(Ring(Steps(48, 24, 12), 6, 1.7));
  ASSERT_TRUE(ring);
  EXPECT_NEAR(DegFromRad(ring->widest_gap_rad), 96, 2);
}

TEST(FindCameraRing, SaysNothingOfOneCameraOrParallelOnes) {
  Reconstruction one = Ring({0}, 1, 0);
  EXPECT_FALSE(FindCameraRing(one));
  Reconstruction parallel;
  for (int i = 0; i < 5; ++i) {
    parallel.cam_from_model.push_back(
        Rigid3{Eigen::Quaterniond::Identity(), Eigen::Vector3d(i, 0, 0)});
  }
  EXPECT_FALSE(FindCameraRing(parallel));
}

}  // namespace
}  // namespace rotunda::sfm
