#include "sfm/core/rigid3.h"

#include <gtest/gtest.h>

#include <random>

#include "sfm/core/camera.h"

namespace rotunda {
namespace {

constexpr uint64_t kSeed = 20240607;

double Uniform(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
}

Eigen::Vector3d RandomVector(std::mt19937_64& random, double size) {
  return {Uniform(random, -size, size), Uniform(random, -size, size), Uniform(random, -size, size)};
}

Rigid3 RandomRigid3(std::mt19937_64& random) {
  const Eigen::Vector3d axis = RandomVector(random, 1.0).normalized();
  return {Eigen::Quaterniond(Eigen::AngleAxisd(Uniform(random, -kPi, kPi), axis)),
          RandomVector(random, 3.0)};
}

TEST(Rigid3, LettersCancel) {
  std::mt19937_64 random(kSeed);
  for (int i = 0; i < 50; ++i) {
    const Rigid3 b_from_a = RandomRigid3(random);
    const Rigid3 c_from_b = RandomRigid3(random);
    const Eigen::Vector3d x_in_a = RandomVector(random, 5.0);
    const Eigen::Vector3d x_in_c = c_from_b * (b_from_a * x_in_a);
    EXPECT_LT(((c_from_b * b_from_a) * x_in_a - x_in_c).norm(), 1e-13);
    const Rigid3 a_from_c = (c_from_b * b_from_a).Inverse();
    EXPECT_LT((a_from_c * x_in_c - x_in_a).norm(), 1e-13);
    EXPECT_LT((b_from_a.Matrix() * x_in_a.homogeneous() - b_from_a * x_in_a).norm(), 1e-13);
  }
}

TEST(Rigid3, OriginInSourceIsTheCentre) {
  std::mt19937_64 random(kSeed);
  const Rigid3 cam_from_rig = RandomRigid3(random);
  EXPECT_LT((cam_from_rig * cam_from_rig.OriginInSource()).norm(), 1e-14);
}

TEST(Rigid3, RotationAngleIsTheAngleBetween) {
  std::mt19937_64 random(kSeed);
  for (const double angle : {0.0, 1e-9, 1e-4, 0.5, 2.0, kPi}) {
    const Eigen::Quaterniond a = RandomRigid3(random).rotation;
    const Eigen::Vector3d axis = RandomVector(random, 1.0).normalized();
    const Eigen::Quaterniond b = a * Eigen::Quaterniond(Eigen::AngleAxisd(angle, axis));
    EXPECT_NEAR(RotationAngle_rad(a, b), angle, 1e-15 + 1e-12 * angle);
    const Eigen::Quaterniond same_b(-b.w(), -b.x(), -b.y(), -b.z());
    EXPECT_NEAR(RotationAngle_rad(a, same_b), angle, 1e-15 + 1e-12 * angle);
  }
}

TEST(Rigid3, CrossMatrixIsTheCrossProduct) {
  std::mt19937_64 random(kSeed);
  const Eigen::Vector3d v = RandomVector(random, 2.0);
  const Eigen::Vector3d w = RandomVector(random, 2.0);
  EXPECT_LT((CrossMatrix(v) * w - v.cross(w)).norm(), 1e-15);
}

TEST(Sim3, InverseCancels) {
  std::mt19937_64 random(kSeed);
  const Rigid3 motion = RandomRigid3(random);
  const Sim3 b_from_a{2.5, motion.rotation, motion.translation};
  const Eigen::Vector3d x_in_a = RandomVector(random, 4.0);
  EXPECT_LT((b_from_a.Inverse() * (b_from_a * x_in_a) - x_in_a).norm(), 1e-13);
}

TEST(Sim3, TransformPoseKeepsThePicture) {
  std::mt19937_64 random(kSeed);
  const CameraIntrinsics lens{
      CameraModel::kOpencv, 1200, 1600, {1840, 1842, 600, 800, -0.05, 0.01, 1e-4, -2e-4}};
  for (int i = 0; i < 20; ++i) {
    const Rigid3 cam_from_a = RandomRigid3(random);
    const Rigid3 motion = RandomRigid3(random);
    const Sim3 b_from_a{Uniform(random, 0.1, 10.0), motion.rotation, motion.translation};
    const Rigid3 cam_from_b = TransformPose(b_from_a, cam_from_a);
    const Eigen::Vector3d x_in_cam(Uniform(random, -0.3, 0.3), Uniform(random, -0.4, 0.4), 1.5);
    const Eigen::Vector3d x_in_a = cam_from_a.Inverse() * x_in_cam;
    const auto before = lens.Project(cam_from_a * x_in_a);
    const auto after = lens.Project(cam_from_b * (b_from_a * x_in_a));
    ASSERT_TRUE(before && after);
    EXPECT_LT((*before - *after).norm(), 1e-9);
    const Eigen::Vector3d centre_in_b = b_from_a * cam_from_a.OriginInSource();
    EXPECT_LT((cam_from_b.OriginInSource() - centre_in_b).norm(), 1e-12);
  }
}

}  // namespace
}  // namespace rotunda
