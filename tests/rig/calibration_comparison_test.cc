#include "rig/calibration_comparison.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "rig/rig_model.h"
#include "rig/sim/calibrated_rig.h"
#include "rig/sim/noise.h"
#include "rig/sim/rig_options.h"
#include "sfm/core/statistics.h"

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

TEST(CalibrationComparison, AnotherRigsCalibrationIsToldAndNotCountedAway) {
  const Calibration other = sim::DrawCalibration(sim::DrawRig({}, 2, 90, 1.0), 1);
  const auto comparison = CompareCalibrations(Draw(1), other, {});
  ASSERT_TRUE(comparison.ok()) << comparison.error().ToString();
  const std::vector<std::string> changes = ChangesIn(*comparison);
  ASSERT_FALSE(changes.empty());
  EXPECT_NE(changes[0].find("not of the same rig"), std::string::npos) << changes[0];
  // The sigmas are those of the calibrations, and not counted down by the scatter.
  std::vector<double> sigmas;
  for (const CameraChange& change : comparison->cameras) {
    sigmas.push_back(change.sigmas);
    EXPECT_EQ(change.moved, change.sigmas > comparison->sigmas_limit) << change.camera;
  }
  EXPECT_NEAR(Median(sigmas), comparison->inflation, 0.1 * comparison->inflation);
  for (const std::string& change : ChangesIn(*CompareCalibrations(Draw(1), Draw(2), {}))) {
    EXPECT_EQ(change.find("not of the same rig"), std::string::npos) << change;
  }
}

TEST(CalibrationComparison, AnotherSquareIsTheReasonWhenAllStandFartherApart) {
  Calibration after = Draw(2);
  for (CalibratedCamera& camera : after.cameras) camera.cam_from_rig.translation *= 61.0 / 60;
  const auto comparison = CompareCalibrations(Draw(1), after, {});
  ASSERT_TRUE(comparison.ok());
  EXPECT_FALSE(comparison->SameRig());
  EXPECT_NEAR(comparison->growth, 1.0 / 60, 1e-4);
  const std::string told = ChangesIn(*comparison)[0];
  EXPECT_NE(told.find("1.67 % farther apart"), std::string::npos) << told;
  EXPECT_NE(told.find("square_mm"), std::string::npos) << told;
  EXPECT_EQ(CompareCalibrations(Draw(1), Draw(2), {})->growth, 0);
}

TEST(CalibrationComparison, TwoBoardFilesAreTheReasonWhenTheCamerasScatter) {
  const auto with_rows = [](Calibration calibration, int rows) {
    CalibratedFace& face = calibration.board.emplace_back();
    face.face = "front";
    face.print = FacePrint{7, rows, 60, 45, "APRILTAG_36h11", 0, false};
    return calibration;
  };
  const Calibration before = with_rows(Draw(1), 25);
  const Calibration other = sim::DrawCalibration(sim::DrawRig({}, 2, 90, 1.0), 1);
  const auto comparison = CompareCalibrations(before, with_rows(other, 23), {});
  ASSERT_TRUE(comparison.ok());
  EXPECT_NE(ChangesIn(*comparison)[0].find("rows of face 'front': 25 before, 23 after"),
            std::string::npos)
      << ChangesIn(*comparison)[0];
  // Another target that gives the same rig is nothing to tell.
  EXPECT_TRUE(ChangesIn(*CompareCalibrations(before, with_rows(Draw(2), 23), {})).empty());
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
  auto comparison = CompareCalibrations(before, after, {});
  ASSERT_TRUE(comparison.ok());
  EXPECT_EQ(comparison->only_before, std::vector<std::string>{"c00r0"});
  EXPECT_EQ(comparison->only_after, std::vector<std::string>{"c14r5"});
  const auto said = [&](const std::string& text) {
    const std::vector<std::string> changes = ChangesIn(*comparison);
    return std::find(changes.begin(), changes.end(), text) != changes.end();
  };
  EXPECT_TRUE(said("c00r0 is only in the earlier calibration"));
  EXPECT_TRUE(said("c14r5 is only in the later calibration"));
  comparison->not_calibrated = {"c00r0"};
  EXPECT_TRUE(said("c00r0 was not calibrated this time"));
  for (const CameraChange& change : comparison->cameras) {
    EXPECT_EQ(change.other_serial, change.camera == after.cameras[3].camera);
  }
}

/// What calibrations of these lenses leave uncertain: the principal point goes with the decentring,
/// k1 against k2.
Eigen::MatrixXd LensCovariance() {
  Eigen::VectorXd sigma(8);  // fx fy cx cy k1 k2 p1 p2
  sigma << 0.3, 0.3, 0.5, 0.5, 4e-4, 2e-3, 5e-5, 5e-5;
  Eigen::MatrixXd correlation = Eigen::MatrixXd::Identity(8, 8);
  const auto set = [&](int i, int j, double value) {
    correlation(i, j) = correlation(j, i) = value;
  };
  set(0, 1, 0.9);
  set(2, 7, 0.8);
  set(3, 6, 0.8);
  set(4, 5, -0.95);
  return sigma.asDiagonal() * correlation * sigma.asDiagonal();
}

/// As Draw, with lenses that are off by what the covariances say, `times` as much.
Calibration DrawWithLenses(uint64_t seed, double times = 1) {
  Calibration calibration = Draw(seed);
  const Eigen::MatrixXd covariance = LensCovariance();
  const Eigen::MatrixXd root = covariance.llt().matrixL();
  sim::Random random(seed);
  for (CalibratedCamera& camera : calibration.cameras) {
    Eigen::VectorXd normal(8);
    for (double& value : normal) value = times * random.Normal();
    Eigen::Map<Eigen::VectorXd>(camera.intrinsics.params.data(), 8) += root * normal;
    camera.covariance = Eigen::MatrixXd::Identity(14, 14);
    camera.covariance->topLeftCorner<3, 3>() *= std::pow(RadFromDeg(0.005), 2) / 3;
    camera.covariance->block<3, 3>(3, 3) *= std::pow(0.15e-3, 2) / 3;
    camera.covariance->bottomRightCorner(8, 8) = covariance;
    camera.sigma->focal_px = 0.3;
  }
  return calibration;
}

TEST(CalibrationComparison, ALensThatChangedIsNamedAndNoOther) {
  double squares = 0;
  for (uint64_t run = 0; run < 20; ++run) {
    Calibration after = DrawWithLenses(2 * run + 1);
    const size_t which = (7 * run) % 90;
    std::vector<double>& params = after.cameras[which].intrinsics.params;
    if (run % 2 == 0) {
      params[0] *= 1.004;
      params[1] *= 1.004;
    } else {
      params[2] += 6;  // knocked: the principal point alone
    }
    const auto comparison = CompareCalibrations(DrawWithLenses(2 * run), after, {});
    ASSERT_TRUE(comparison.ok());
    EXPECT_LT(comparison->lens_inflation, 1.3);
    for (size_t c = 0; c < 90; ++c) {
      const CameraChange& change = comparison->cameras[c];
      EXPECT_EQ(change.lens_changed, c == which) << "run " << run << " " << *change.lens_sigmas;
      EXPECT_FALSE(change.moved) << change.camera;
      if (c != which) squares += *change.lens_sigmas * *change.lens_sigmas / (20 * 89);
    }
    EXPECT_EQ(VerdictOn(comparison->cameras[which]), "lens changed");
    const std::vector<std::string> told = ChangesIn(*comparison);
    ASSERT_EQ(told.size(), 1u);
    EXPECT_TRUE(told[0].starts_with(comparison->cameras[which].camera)) << told[0];
  }
  // 1780 means of 8 squared normal deviates each: 1 +- 0.012; the inflation of half of the runs
  // takes a little away.
  EXPECT_NEAR(squares, 1, 0.08);
}

TEST(CalibrationComparison, LensesThatScatterMoreThanTheySayAreNoAlarm) {
  const auto comparison = CompareCalibrations(DrawWithLenses(1, 3), DrawWithLenses(2, 3), {});
  ASSERT_TRUE(comparison.ok());
  EXPECT_NEAR(comparison->lens_inflation, 3, 0.4);
  for (const CameraChange& change : comparison->cameras) EXPECT_FALSE(change.lens_changed);
}

TEST(CalibrationComparison, LensesThatWereKeptAreAsTheyWere) {
  const Calibration before = DrawWithLenses(1);
  Calibration after = DrawWithLenses(2);
  for (size_t c = 0; c < 90; ++c) after.cameras[c].intrinsics = before.cameras[c].intrinsics;
  const auto comparison = CompareCalibrations(before, after, {});
  ASSERT_TRUE(comparison.ok());
  for (const CameraChange& change : comparison->cameras) {
    EXPECT_EQ(change.lens_sigmas, 0.0);
    EXPECT_FALSE(change.lens_changed);
  }
}

TEST(CalibrationComparison, WithoutCovariancesTheFocalLengthTellsOrNothing) {
  Calibration before = DrawWithLenses(1), after = DrawWithLenses(2);
  for (size_t c = 0; c < 90; ++c) {
    if (c != 4) before.cameras[c].covariance.reset();
  }
  // Another model: its distortion cannot be compared, its focal length can.
  after.cameras[4].intrinsics.model = CameraModel::kPinhole;
  after.cameras[4].intrinsics.params.resize(4);
  for (const size_t focal : {0, 1}) after.cameras[7].intrinsics.params[focal] += 4;
  before.cameras[9].sigma->focal_px.reset();
  const auto comparison = CompareCalibrations(before, after, {});
  ASSERT_TRUE(comparison.ok());
  for (size_t c = 0; c < 90; ++c) {
    const CameraChange& change = comparison->cameras[c];
    EXPECT_EQ(change.lens_sigmas.has_value(), c != 9) << change.camera;
    EXPECT_EQ(change.lens_changed, c == 7) << change.camera;
  }
}

TEST(CalibrationComparison, TheSigmasOfBothAreTold) {
  Calibration before = Draw(1);
  const Calibration after = Draw(2);
  before.cameras[3].sigma->position_mm = 0.7;
  before.cameras[4].sigma.reset();
  const auto comparison = CompareCalibrations(before, after, {});
  ASSERT_TRUE(comparison.ok());
  EXPECT_EQ(comparison->cameras[3].sigma_before->position_mm, 0.7);
  EXPECT_EQ(comparison->cameras[3].sigma_after->position_mm, after.cameras[3].sigma->position_mm);
  EXPECT_FALSE(comparison->cameras[4].sigma_before.has_value());
}

TEST(CalibrationComparison, SwappedCamerasAreToldOnceEach) {
  const Calibration before = DrawWithLenses(1);
  Calibration after = DrawWithLenses(2);
  std::swap(after.cameras[5].cam_from_rig, after.cameras[17].cam_from_rig);
  std::swap(after.cameras[5].intrinsics, after.cameras[17].intrinsics);
  const auto comparison = CompareCalibrations(before, after, {});
  ASSERT_TRUE(comparison.ok());
  const std::vector<std::string> told = ChangesIn(*comparison);
  ASSERT_EQ(told.size(), 2u) << testing::PrintToString(told);
  const std::string &a = before.cameras[5].camera, &b = before.cameras[17].camera;
  EXPECT_NE(told[0].find(a + " moved by"), std::string::npos) << told[0];
  EXPECT_NE(told[0].find("stands where " + b + " was"), std::string::npos) << told[0];
  EXPECT_NE(told[1].find("stands where " + a + " was"), std::string::npos) << told[1];
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
