#include "sfm/core/evaluate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

namespace rotunda {
namespace {

constexpr uint64_t kSeed = 3;

double Uniform(std::mt19937_64& random) { return static_cast<double>(random() >> 11) * 0x1p-53; }

double Normal(std::mt19937_64& random) {
  const double radius = std::sqrt(-2.0 * std::log(1.0 - Uniform(random)));
  return radius * std::cos(2.0 * kPi * Uniform(random));
}

Eigen::Vector3d Normal3(std::mt19937_64& random) {
  return {Normal(random), Normal(random), Normal(random)};
}

/// `count` cameras on a ring of radius 1.7 m.
Calibration Ring(size_t count) {
  Calibration ring;
  for (size_t i = 0; i < count; ++i) {
    const double azimuth = 2 * kPi * static_cast<double>(i) / static_cast<double>(count);
    CalibratedCamera camera;
    camera.camera = std::to_string(1000 + i);
    camera.intrinsics = DefaultIntrinsics(1200, 1600, 1840);
    camera.cam_from_rig.rotation = Eigen::AngleAxisd(kPi / 2, Eigen::Vector3d::UnitX()) *
                                   Eigen::AngleAxisd(kPi / 2 - azimuth, Eigen::Vector3d::UnitZ());
    const Eigen::Vector3d centre(1.7 * std::cos(azimuth), 1.7 * std::sin(azimuth),
                                 0.3 * static_cast<double>(i % 6));
    camera.cam_from_rig.translation = -(camera.cam_from_rig.rotation * centre);
    ring.cameras.push_back(camera);
  }
  return ring;
}

PoseSet PosesOf(const Calibration& calibration, const Sim3& model_from_rig) {
  PoseSet poses;
  for (const CalibratedCamera& camera : calibration.cameras) {
    CameraPose pose;
    pose.camera = camera.camera;
    pose.registered = true;
    pose.intrinsics = camera.intrinsics;
    pose.cam_from_rig = TransformPose(model_from_rig, camera.cam_from_rig);
    poses.cameras.push_back(pose);
  }
  return poses;
}

Sim3 Somewhere(double scale) {
  return {scale,
          Eigen::Quaterniond(Eigen::AngleAxisd(2.1, Eigen::Vector3d(1, 2, -1).normalized())),
          {4, -3, 0.5}};
}

void Turn(Rigid3& cam_from_rig, double angle_deg, const Eigen::Vector3d& axis) {
  const Eigen::Vector3d centre = cam_from_rig.OriginInSource();
  cam_from_rig.rotation =
      Eigen::Quaterniond(Eigen::AngleAxisd(RadFromDeg(angle_deg), axis)) * cam_from_rig.rotation;
  cam_from_rig.translation = -(cam_from_rig.rotation * centre);
}

TEST(EvaluatePoses, ASimilarityOfTheTruthHasNoError) {
  const Calibration truth = Ring(12);
  for (const double scale : {0.02, 1.0, 30.0}) {
    const auto evaluation = EvaluatePoses(PosesOf(truth, Somewhere(scale)), truth);
    ASSERT_TRUE(evaluation.ok()) << evaluation.error().ToString();
    EXPECT_EQ(evaluation->registered, 12u);
    EXPECT_EQ(evaluation->of, 12u);
    EXPECT_LT(evaluation->max_rotation_deg, 1e-10);
    EXPECT_LT(evaluation->max_position_mm, 1e-9);
    EXPECT_FALSE(evaluation->folded);
    EXPECT_FALSE(evaluation->rotation_error_over_sigma);
    EXPECT_FALSE(evaluation->position_error_over_sigma);
  }
}

TEST(EvaluatePoses, MeasuresATurnedCamera) {
  const Calibration truth = Ring(12);
  PoseSet poses = PosesOf(truth, Somewhere(0.5));
  Turn(poses.cameras[4].cam_from_rig, 9.0, Eigen::Vector3d::UnitY());
  const auto evaluation = EvaluatePoses(poses, truth);
  ASSERT_TRUE(evaluation.ok());
  EXPECT_NEAR(evaluation->max_rotation_deg, 9.0, 1e-9);
  EXPECT_NEAR(evaluation->mean_rotation_deg, 0.75, 1e-9);
  EXPECT_LT(evaluation->median_rotation_deg, 1e-9);
  EXPECT_NEAR(evaluation->cameras[4].rotation_deg, 9.0, 1e-9);
  EXPECT_LT(evaluation->max_position_mm, 1e-9);
  EXPECT_FALSE(evaluation->folded);
  Turn(poses.cameras[4].cam_from_rig, 1.5, Eigen::Vector3d::UnitY());
  EXPECT_TRUE(EvaluatePoses(poses, truth)->folded);
}

TEST(EvaluatePoses, NamesCamerasThatTheTruthLacks) {
  Calibration truth = Ring(12);
  const PoseSet poses = PosesOf(truth, Somewhere(0.5));
  const std::string lacking = truth.cameras[3].camera;
  EXPECT_TRUE(EvaluatePoses(poses, truth)->not_in_truth.empty());
  truth.cameras.erase(truth.cameras.begin() + 3);
  const auto evaluation = EvaluatePoses(poses, truth);
  ASSERT_TRUE(evaluation.ok()) << evaluation.error().ToString();
  EXPECT_EQ(evaluation->registered, 12u);
  EXPECT_EQ(evaluation->not_in_truth, std::vector<std::string>{lacking});
  EXPECT_NE(EvaluationToJson(*evaluation).find("not_in_truth"), std::string::npos);
}

TEST(EvaluatePoses, MeasuresAMovedCameraInMillimetres) {
  // Of many cameras one moves by 1 mm: the fit follows it by about 1 mm / 90.
  const Calibration truth = Ring(90);
  PoseSet poses = PosesOf(truth, Somewhere(0.5));
  Rigid3& pose = poses.cameras[10].cam_from_rig;
  pose.translation += Eigen::Vector3d(0, 0.001 * 0.5, 0);
  const auto evaluation = EvaluatePoses(poses, truth);
  ASSERT_TRUE(evaluation.ok());
  EXPECT_NEAR(evaluation->max_position_mm, 1.0, 0.1);
  EXPECT_EQ(evaluation->cameras[10].position_mm, evaluation->max_position_mm);
  EXPECT_LT(evaluation->median_position_mm, 0.05);
}

TEST(EvaluatePoses, CountsOnlyWhatIsRegisteredAndInTheTruth) {
  Calibration truth = Ring(8);
  PoseSet poses = PosesOf(truth, Somewhere(2.0));
  poses.cameras[2].registered = false;
  poses.cameras[2].cam_from_rig = Rigid3();
  truth.cameras.erase(truth.cameras.begin() + 5);
  const auto evaluation = EvaluatePoses(poses, truth);
  ASSERT_TRUE(evaluation.ok());
  EXPECT_EQ(evaluation->registered, 7u);
  EXPECT_EQ(evaluation->of, 8u);
  EXPECT_EQ(evaluation->cameras.size(), 6u);
  EXPECT_LT(evaluation->max_position_mm, 1e-9);
}

TEST(EvaluatePoses, SigmasThatPredictTheErrorGiveARatioOfOne) {
  constexpr double kScale = 0.25;  // model units a metre: sigmas are in the model's unit
  constexpr double kRotationSigma_deg = 0.02;
  constexpr double kPositionSigma_m = 0.001;
  std::mt19937_64 random(kSeed);
  const Calibration truth = Ring(900);
  PoseSet poses = PosesOf(truth, Somewhere(kScale));
  for (CameraPose& camera : poses.cameras) {
    const Eigen::Vector3d turn_deg = kRotationSigma_deg / std::sqrt(3.0) * Normal3(random);
    const Eigen::Vector3d shift = kScale * kPositionSigma_m / std::sqrt(3.0) * Normal3(random);
    const Eigen::Vector3d centre = camera.cam_from_rig.OriginInSource() + shift;
    camera.cam_from_rig.translation = -(camera.cam_from_rig.rotation * centre);
    Turn(camera.cam_from_rig, turn_deg.norm(), turn_deg.normalized());
    camera.sigma = PoseSigma{kRotationSigma_deg, 1000 * kScale * kPositionSigma_m, std::nullopt};
  }
  const auto evaluation = EvaluatePoses(poses, truth);
  ASSERT_TRUE(evaluation.ok());
  // Chi-square with 2700 degrees of freedom: the root of its mean has deviation 0.0136.
  EXPECT_NEAR(*evaluation->rotation_error_over_sigma, 1.0, 4 * 0.0136) << "seed " << kSeed;
  EXPECT_NEAR(*evaluation->position_error_over_sigma, 1.0, 4 * 0.0136) << "seed " << kSeed;
}

TEST(EvaluatePoses, SaysWhenThereIsTooLittleToCompare) {
  const Calibration truth = Ring(12);
  PoseSet poses = PosesOf(truth, Somewhere(1.0));
  poses.cameras.resize(2);
  const auto two = EvaluatePoses(poses, truth);
  ASSERT_FALSE(two.ok());
  EXPECT_EQ(two.error().message,
            "expected at least 3 cameras that have a pose and are in the truth, found 2");
  poses = PosesOf(truth, Somewhere(1.0));
  for (CameraPose& camera : poses.cameras) camera.camera += "-other";
  EXPECT_EQ(EvaluatePoses(poses, truth).error().message,
            "expected at least 3 cameras that have a pose and are in the truth, found 0");
  poses = PosesOf(truth, Somewhere(1.0));
  for (CameraPose& camera : poses.cameras) camera.cam_from_rig.translation.setZero();
  EXPECT_EQ(EvaluatePoses(poses, truth).error().ToString(),
            "camera centres: the points lie on one line");
}

TEST(EvaluateCalibration, ScaleCounts) {
  const Calibration truth = Ring(12);
  Calibration calibration = truth;
  for (CalibratedCamera& camera : calibration.cameras) {
    camera.cam_from_rig = TransformPose(Somewhere(1.0), camera.cam_from_rig);
  }
  const auto moved = EvaluateCalibration(calibration, truth);
  ASSERT_TRUE(moved.ok());
  EXPECT_LT(moved->max_position_mm, 1e-9);
  EXPECT_EQ(moved->registered, 12u);
  EXPECT_EQ(moved->of, 12u);

  calibration = truth;
  for (CalibratedCamera& camera : calibration.cameras) camera.cam_from_rig.translation *= 1.01;
  const auto grown = EvaluateCalibration(calibration, truth);
  ASSERT_TRUE(grown.ok());
  EXPECT_GT(grown->mean_position_mm, 16.0);  // a hundredth of 1.7 m and more
  EXPECT_LT(grown->mean_position_mm, 20.0);
  EXPECT_LT(grown->max_rotation_deg, 1e-9);
}

TEST(EvaluateCalibration, CountsAgainstTheTruth) {
  const Calibration truth = Ring(12);
  Calibration calibration = truth;
  calibration.cameras.resize(9);
  const auto evaluation = EvaluateCalibration(calibration, truth);
  ASSERT_TRUE(evaluation.ok());
  EXPECT_EQ(evaluation->registered, 9u);
  EXPECT_EQ(evaluation->of, 12u);
}

TEST(EvaluationToJson, HasTheKeysOfTheCommand) {
  Evaluation evaluation;
  evaluation.measured_id = "person";
  evaluation.truth_id = "world";
  evaluation.registered = 1;
  evaluation.of = 2;
  evaluation.mean_rotation_deg = 0.25;
  evaluation.position_error_over_sigma = 1.5;
  evaluation.cameras = {{"a", 0.25, 3.0}};
  EXPECT_EQ(EvaluationToJson(evaluation), R"({
 "measured": "person",
 "truth": "world",
 "registered": 1,
 "of": 2,
 "mean_rotation_deg": 0.25,
 "median_rotation_deg": 0.0,
 "max_rotation_deg": 0.0,
 "mean_position_mm": 0.0,
 "median_position_mm": 0.0,
 "max_position_mm": 0.0,
 "folded": false,
 "position_error_over_sigma": 1.5,
 "cameras": [
  {
   "camera": "a",
   "rotation_deg": 0.25,
   "position_mm": 3.0
  }
 ]
}
)");
}

}  // namespace
}  // namespace rotunda
