#include "rig/calibration_comparison.h"

#include <gtest/gtest.h>

#include "rig/rig_model.h"
#include "rig/sim/calibrated_rig.h"
#include "rig/sim/rig_options.h"

namespace rotunda::rig {
namespace {

/// Calibrations of a rig of 90 cameras with independent errors of 0.005 deg and 0.15 mm, in frames
/// of their own.
Calibration Draw(uint64_t seed) {
  Calibration calibration = sim::DrawCalibration(sim::DrawRig({}, 1, 90, 1.0), seed);
  const Rigid3 rig_from_new = {RotationOf({0.01, -0.02, 0.5 * static_cast<double>(seed)}),
                               Eigen::Vector3d(0.01, 0.02, -0.03)};
  for (CalibratedCamera& camera : calibration.cameras) {
    camera.cam_from_rig = camera.cam_from_rig * rig_from_new;
  }
  return calibration;
}

void Shift(CalibratedCamera& camera, const Eigen::Vector3d& by_m, const Eigen::Vector3d& turn_rad) {
  const Eigen::Vector3d centre = camera.cam_from_rig.OriginInSource() + by_m;
  camera.cam_from_rig.rotation = RotationOf(turn_rad) * camera.cam_from_rig.rotation;
  camera.cam_from_rig.translation = -(camera.cam_from_rig.rotation * centre);
}

TEST(CalibrationComparison, NoFalseAlarmInTwentyRuns) {
  for (uint64_t run = 0; run < 20; ++run) {
    const auto comparison = CompareCalibrations(Draw(2 * run), Draw(2 * run + 1), {});
    ASSERT_TRUE(comparison.ok());
    ASSERT_EQ(comparison->cameras.size(), 90u);
    EXPECT_LT(comparison->inflation, 1.3);
    for (const CameraChange& change : comparison->cameras) {
      EXPECT_FALSE(change.moved) << "run " << run << " " << change.camera << " " << change.sigmas;
    }
  }
}

TEST(CalibrationComparison, AMovedCameraIsNamedWithHowFar) {
  for (uint64_t run = 0; run < 20; ++run) {
    Calibration after = Draw(2 * run + 1);
    const size_t which = (7 * run) % 90;
    const bool turned = run % 2 == 1;
    Shift(after.cameras[which], turned ? Eigen::Vector3d::Zero() : Eigen::Vector3d(0, 1e-3, 0),
          turned ? Eigen::Vector3d(RadFromDeg(0.1), 0, 0) : Eigen::Vector3d::Zero());
    const auto comparison = CompareCalibrations(Draw(2 * run), after, {});
    ASSERT_TRUE(comparison.ok());
    for (size_t c = 0; c < 90; ++c) {
      const CameraChange& change = comparison->cameras[c];
      EXPECT_EQ(change.moved, c == which) << "run " << run << " " << change.camera;
      if (c != which) continue;
      EXPECT_NEAR(change.position_mm, turned ? 0.0 : 1.0, 0.6);
      EXPECT_NEAR(change.rotation_deg, turned ? 0.1 : 0.0, 0.02);
    }
  }
}

TEST(CalibrationComparison, ManyMovedCamerasDoNotDragTheFrame) {
  const Calibration before = Draw(1);
  Calibration after = before;
  for (size_t c = 0; c < 36; ++c) Shift(after.cameras[c], {0, 0.02, 0}, {0, 0, 0});
  const auto alignment = AlignRigs(before, after, {});
  ASSERT_TRUE(alignment.ok());
  EXPECT_LT(alignment->translation.norm(), 2e-5);
  const auto comparison = CompareCalibrations(before, after, {});
  ASSERT_TRUE(comparison.ok());
  for (size_t c = 0; c < 90; ++c) EXPECT_EQ(comparison->cameras[c].moved, c < 36) << c;
}

TEST(CalibrationComparison, MissingAndNewCamerasAndOtherSerialsAreListed) {
  Calibration before = Draw(1), after = Draw(2);
  before.cameras.pop_back();
  after.cameras.erase(after.cameras.begin());
  after.cameras[3].serial = "other";
  const auto comparison = CompareCalibrations(before, after, {});
  ASSERT_TRUE(comparison.ok());
  EXPECT_EQ(comparison->only_before, std::vector<std::string>{"c00r0"});
  EXPECT_EQ(comparison->only_after, std::vector<std::string>{"c14r5"});
  for (const CameraChange& change : comparison->cameras) {
    EXPECT_EQ(change.other_serial, change.camera == after.cameras[3].camera);
  }
}

TEST(CalibrationComparison, TooFewCommonCamerasAreRefused) {
  Calibration after = Draw(2);
  after.cameras.resize(2);
  const auto comparison = CompareCalibrations(Draw(1), after, {});
  ASSERT_FALSE(comparison.ok());
  EXPECT_NE(comparison.error().message.find("at least 3"), std::string::npos);
}

}  // namespace
}  // namespace rotunda::rig
