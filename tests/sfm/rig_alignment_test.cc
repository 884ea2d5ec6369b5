#include "sfm/rig_alignment.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

namespace rotunda::sfm {
namespace {

constexpr size_t kCameras = 30;
constexpr uint64_t kSeed = 11;
constexpr double kNoise_m = 0.0005;
constexpr double kNoise_rad = 0.0002;

struct Problem {
  FrameSet set;
  Calibration calibration;
  Reconstruction reconstruction;  // the calibration's cameras, noisy, in another frame
  PoseCovariances covariances;
};

double Noise(std::mt19937_64& random, double sigma) {
  return std::normal_distribution<double>(0.0, sigma)(random);
}

Eigen::Vector3d NoiseVector(std::mt19937_64& random, double sigma) {
  return {Noise(random, sigma), Noise(random, sigma), Noise(random, sigma)};
}

const Sim3 kModelFromRig = {
    0.37, Eigen::Quaterniond(Eigen::AngleAxisd(1.1, Eigen::Vector3d(1, 2, 3).normalized())),
    Eigen::Vector3d(4, -5, 6)};

Problem MakeProblem() {
  std::mt19937_64 random(kSeed);
  Problem problem;
  for (size_t i = 0; i < kCameras; ++i) {
    const double azimuth_rad = 2 * kPi * i / kCameras;
    CalibratedCamera camera;
    camera.camera = "c" + std::to_string(100 + i);
    camera.intrinsics = DefaultIntrinsics(600, 800, 900);
    camera.cam_from_rig.rotation =
        Eigen::Quaterniond(Eigen::AngleAxisd(azimuth_rad, Eigen::Vector3d::UnitZ()));
    const Eigen::Vector3d center_m(1.7 * std::cos(azimuth_rad), 1.7 * std::sin(azimuth_rad),
                                   0.3 * (i % 6));
    camera.cam_from_rig.translation = -(camera.cam_from_rig.rotation * center_m);
    problem.calibration.cameras.push_back(camera);
    problem.set.frames.emplace_back().camera = camera.camera;

    Rigid3 noisy = camera.cam_from_rig;
    const Eigen::Vector3d turn = NoiseVector(random, kNoise_rad);
    noisy.rotation =
        noisy.rotation * Eigen::Quaterniond(Eigen::AngleAxisd(turn.norm(), turn.normalized()));
    noisy.translation = -(noisy.rotation * (center_m + NoiseVector(random, kNoise_m)));
    problem.reconstruction.cam_from_model.push_back(TransformPose(kModelFromRig, noisy));
    PoseCovariance covariance = PoseCovariance::Identity() * kNoise_rad * kNoise_rad;
    covariance.bottomRightCorner<3, 3>() =
        Eigen::Matrix3d::Identity() * std::pow(kNoise_m * kModelFromRig.scale, 2);
    problem.covariances.images.push_back(covariance);
  }
  problem.calibration.id = "test";
  return problem;
}

void Shift(Problem& problem, size_t i) {
  problem.reconstruction.cam_from_model[i]->translation.x() += 0.020 * kModelFromRig.scale;
}

TEST(RigAlignment, BringsTheModelIntoTheRigFrame) {
  const Problem problem = MakeProblem();
  const auto aligned = AlignToCalibration(problem.reconstruction, problem.set, problem.calibration,
                                          problem.covariances, kSeed);
  ASSERT_TRUE(aligned.ok()) << aligned.error().ToString();
  EXPECT_NEAR(aligned->rig_from_model.scale, 1 / kModelFromRig.scale, 0.001 / kModelFromRig.scale);
  for (const auto& difference : aligned->vs_calibration) {
    ASSERT_TRUE(difference.has_value());
    EXPECT_LT(difference->position_mm, 5e3 * kNoise_m);
    EXPECT_LT(difference->rotation_deg, DegFromRad(5 * kNoise_rad) + 0.02);
    EXPECT_FALSE(difference->moved);
  }
}

TEST(RigAlignment, NamesMovedCamerasAndNoOther) {
  Problem problem = MakeProblem();
  Rigid3& shifted = *problem.reconstruction.cam_from_model[4];
  shifted.translation += Eigen::Vector3d(0.020 * kModelFromRig.scale, 0, 0);
  Rigid3& turned = *problem.reconstruction.cam_from_model[9];
  const Eigen::Vector3d center = turned.OriginInSource();
  turned.rotation =
      Eigen::Quaterniond(Eigen::AngleAxisd(RadFromDeg(0.5), Eigen::Vector3d::UnitY())) *
      turned.rotation;
  turned.translation = -(turned.rotation * center);
  const auto aligned = AlignToCalibration(problem.reconstruction, problem.set, problem.calibration,
                                          problem.covariances, kSeed);
  ASSERT_TRUE(aligned.ok());
  for (size_t i = 0; i < kCameras; ++i) {
    EXPECT_EQ(aligned->vs_calibration[i]->moved, i == 4 || i == 9) << i;
  }
  EXPECT_NEAR(aligned->vs_calibration[4]->position_mm, 20.0, 5e3 * kNoise_m);
  EXPECT_NEAR(aligned->vs_calibration[9]->rotation_deg, 0.5, DegFromRad(5 * kNoise_rad) + 0.02);
}

TEST(RigAlignment, AFoldedModelIsAlignedToTheSideOfMostCameras) {
  Problem problem = MakeProblem();
  const Eigen::Quaterniond half_turn(Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitZ()));
  const Rigid3 other_side = {half_turn, Eigen::Vector3d::Zero()};
  constexpr size_t kFolded = 14;  // the last ones are laid over the side opposite to theirs
  for (size_t i = kCameras - kFolded; i < kCameras; ++i) {
    problem.reconstruction.cam_from_model[i] =
        TransformPose(kModelFromRig, problem.calibration.cameras[i].cam_from_rig * other_side);
  }
  const auto aligned = AlignToCalibration(problem.reconstruction, problem.set, problem.calibration,
                                          problem.covariances, kSeed);
  ASSERT_TRUE(aligned.ok()) << aligned.error().ToString();
  for (size_t i = 0; i < kCameras; ++i) {
    const VsCalibration& off = *aligned->vs_calibration[i];
    EXPECT_EQ(off.rotation_deg > kFoldedRotation_deg, i >= kCameras - kFolded) << i;
    EXPECT_EQ(off.position_mm > aligned->far_mm, i >= kCameras - kFolded) << i;
  }
}

TEST(RigAlignment, ACameraThatCameLooseIsNotFarAway) {
  Problem problem = MakeProblem();
  Rigid3& loose = *problem.reconstruction.cam_from_model[4];
  const Eigen::Quaterniond quarter_turn(Eigen::AngleAxisd(kPi / 2, Eigen::Vector3d::UnitX()));
  const Eigen::Vector3d center = loose.OriginInSource();
  loose.rotation = quarter_turn * loose.rotation;
  loose.translation =
      -(loose.rotation * (center + Eigen::Vector3d(0.1 * kModelFromRig.scale, 0, 0)));
  const auto aligned = AlignToCalibration(problem.reconstruction, problem.set, problem.calibration,
                                          problem.covariances, kSeed);
  ASSERT_TRUE(aligned.ok()) << aligned.error().ToString();
  EXPECT_TRUE(aligned->vs_calibration[4]->moved);
  EXPECT_NEAR(aligned->vs_calibration[4]->position_mm, 100.0, 5e3 * kNoise_m);
  EXPECT_LT(aligned->vs_calibration[4]->position_mm, aligned->far_mm);
}

TEST(RigAlignment, SigmasAreOfPoseAndCalibrationTogether) {
  Problem problem = MakeProblem();
  Shift(problem, 4);
  const auto Sigmas = [&] {
    const auto aligned = AlignToCalibration(problem.reconstruction, problem.set,
                                            problem.calibration, problem.covariances, kSeed);
    return aligned.ok() ? aligned->vs_calibration[4]->sigmas : 0.0;
  };
  // The pose's own: trace of three equal variances; the spread of all cameras is smaller.
  const double own_mm = 1e3 * kNoise_m * std::sqrt(3.0);
  EXPECT_NEAR(Sigmas(), 20.0 / own_mm, 5 * std::sqrt(3.0));
  problem.calibration.cameras[4].sigma = PoseSigma{0.0, 5.0, std::nullopt};
  EXPECT_NEAR(Sigmas(), 20.0 / std::hypot(own_mm, 5.0), 5 * 1e3 * kNoise_m / 5.0);
}

/// As when the calibration knows cameras under each other's names: entry i is that of `from`. Their
/// lenses, too, are each other's, which shifts the poses found (1 cm, 0.3 deg).
void TakeEntries(Problem& problem, const std::vector<std::pair<size_t, size_t>>& from) {
  const Calibration before = problem.calibration;
  for (const auto& [i, other] : from) {
    problem.calibration.cameras[i].cam_from_rig = before.cameras[other].cam_from_rig;
    Rigid3& pose = *problem.reconstruction.cam_from_model[i];
    pose.translation += Eigen::Vector3d(0, 0, 0.010 * kModelFromRig.scale);
    const Rigid3 turn = {
        Eigen::Quaterniond(Eigen::AngleAxisd(RadFromDeg(0.3), Eigen::Vector3d::UnitX())),
        Eigen::Vector3d::Zero()};
    pose = turn * pose;
  }
}

struct Finding {
  bool moved = false;
  std::optional<std::string> swapped_with;
  bool operator==(const Finding&) const = default;
};

/// Checks that these cameras are found as they should be and all others in place.
void ExpectFindings(const Problem& problem, const std::map<size_t, Finding>& expected) {
  const auto aligned = AlignToCalibration(problem.reconstruction, problem.set, problem.calibration,
                                          problem.covariances, kSeed);
  ASSERT_TRUE(aligned.ok()) << aligned.error().ToString();
  for (size_t i = 0; i < kCameras; ++i) {
    if (!problem.reconstruction.cam_from_model[i]) continue;
    const VsCalibration& found = *aligned->vs_calibration[i];
    const auto wanted = expected.find(i);
    EXPECT_EQ((Finding{found.moved, found.swapped_with}),
              wanted == expected.end() ? Finding{} : wanted->second)
        << "camera " << i << ": moved " << found.moved << ", swapped with "
        << found.swapped_with.value_or("none");
  }
}

TEST(RigAlignment, NamesTwoSwappedCameras) {
  // Neighbours on the ring, and opposite ones.
  for (const auto& [a, b] : {std::pair<size_t, size_t>{4, 5}, {3, 18}}) {
    Problem problem = MakeProblem();
    TakeEntries(problem, {{a, b}, {b, a}});
    const std::string name_a = problem.set.frames[a].camera, name_b = problem.set.frames[b].camera;
    ExpectFindings(problem, {{a, {false, name_b}}, {b, {false, name_a}}});
  }
}

TEST(RigAlignment, ARingOfThreeNamesWhosePlaceEachHas) {
  Problem problem = MakeProblem();
  TakeEntries(problem, {{4, 11}, {11, 20}, {20, 4}});
  // Camera 11's entry is where 20 was calibrated: the place where 4 stands is now called 20.
  ExpectFindings(problem, {{4, {false, "c120"}}, {11, {false, "c104"}}, {20, {false, "c111"}}});
}

TEST(RigAlignment, AMovedCameraBesideSwappedOnesStaysMoved) {
  Problem problem = MakeProblem();
  TakeEntries(problem, {{4, 15}, {15, 4}});
  Shift(problem, 9);
  ExpectFindings(problem, {{4, {false, "c115"}}, {15, {false, "c104"}}, {9, {true, {}}}});
}

TEST(RigAlignment, WithoutTheOtherACameraIsMovedAndNotSwapped) {
  Problem problem = MakeProblem();
  TakeEntries(problem, {{4, 15}, {15, 4}});
  problem.reconstruction.cam_from_model[15].reset();
  ExpectFindings(problem, {{4, {true, {}}}});
  // Nor are two in one place that is neither's.
  problem = MakeProblem();
  problem.reconstruction.cam_from_model[4] = problem.reconstruction.cam_from_model[20];
  problem.reconstruction.cam_from_model[15] = problem.reconstruction.cam_from_model[20];
  ExpectFindings(problem, {{4, {true, {}}}, {15, {true, {}}}});
}

TEST(RigAlignment, CovariancesScaleAndTurnWithTheFrame) {
  const Problem problem = MakeProblem();
  const PoseCovariances metric = Transformed(problem.covariances, kModelFromRig.Inverse());
  const PoseSigma sigma = SigmaOf(*metric.images[0]);
  EXPECT_NEAR(sigma.position_mm, 1e3 * kNoise_m * std::sqrt(3.0), 1e-9);
  EXPECT_NEAR(sigma.rotation_deg, DegFromRad(kNoise_rad * std::sqrt(3.0)), 1e-9);
}

TEST(RigAlignment, TooFewCamerasIsAnError) {
  Problem problem = MakeProblem();
  for (size_t i = 2; i < kCameras; ++i) problem.reconstruction.cam_from_model[i].reset();
  EXPECT_FALSE(AlignToCalibration(problem.reconstruction, problem.set, problem.calibration,
                                  problem.covariances, kSeed)
                   .ok());
}

}  // namespace
}  // namespace rotunda::sfm
