#include "rig/sim/rig_options.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <set>

namespace rotunda::sim {
namespace {

TEST(DrawRig, CamerasStandOnTheCylinderAndLookAtTheAxis) {
  const Calibration truth = DrawRig({}, 7, 90, 1.0);
  ASSERT_EQ(truth.cameras.size(), 90u);
  for (const CalibratedCamera& camera : truth.cameras) {
    const Eigen::Vector3d centre = camera.cam_from_rig.OriginInSource();
    EXPECT_NEAR(centre.head<2>().norm(), 1.7, 0.03) << camera.camera;  // 5 sigma of 6 mm
    const Eigen::Vector3d forward =
        camera.cam_from_rig.rotation.conjugate() * Eigen::Vector3d::UnitZ();
    const Eigen::Vector3d inward = -Eigen::Vector3d(centre.x(), centre.y(), 0).normalized();
    const Eigen::Vector2d level = forward.head<2>().normalized();
    EXPECT_GT(level.dot(inward.head<2>()), std::cos(RadFromDeg(4.0))) << camera.camera;
    // Upright: the picture's downward axis points down.
    const Eigen::Vector3d down =
        camera.cam_from_rig.rotation.conjugate() * Eigen::Vector3d::UnitY();
    EXPECT_LT(down.z(), -0.85) << camera.camera;
    EXPECT_TRUE(camera.intrinsics.Validate().ok());
  }
  const Eigen::Vector3d front = truth.Find("c00r0")->cam_from_rig.OriginInSource();
  EXPECT_NEAR(front.x(), 1.7, 0.03);
  EXPECT_NEAR(front.z(), 0.25, 0.03);
  // Azimuth grows counter-clockwise seen from above.
  EXPECT_GT(truth.Find("c03r0")->cam_from_rig.OriginInSource().y(), 1.0);
}

TEST(DrawRig, FewerCamerasAreTheSameOnesAndCloseTheRing) {
  const Calibration all = DrawRig({}, 7, 90, 1.0);
  for (int count : {15, 30, 40, 60}) {
    const Calibration some = DrawRig({}, 7, count, 1.0);
    ASSERT_EQ(some.cameras.size(), static_cast<size_t>(count));
    std::set<std::string> columns;
    for (const CalibratedCamera& camera : some.cameras) {
      columns.insert(camera.camera.substr(0, 3));
      const CalibratedCamera* same = all.Find(camera.camera);
      ASSERT_NE(same, nullptr);
      EXPECT_EQ(camera.cam_from_rig.translation, same->cam_from_rig.translation);
      EXPECT_EQ(camera.intrinsics.params, same->intrinsics.params);
    }
    EXPECT_EQ(columns.size(), 15u) << count;
  }
}

TEST(DrawRig, SeedsGiveOtherRigs) {
  EXPECT_NE(DrawRig({}, 1, 90, 1.0).cameras[4].cam_from_rig.translation,
            DrawRig({}, 2, 90, 1.0).cameras[4].cam_from_rig.translation);
}

TEST(DrawRig, SmallerPicturesScaleTheIntrinsics) {
  const Calibration full = DrawRig({}, 7, 15, 1.0), half = DrawRig({}, 7, 15, 0.5);
  EXPECT_EQ(half.cameras[3].intrinsics.width_px, 600);
  EXPECT_EQ(half.cameras[3].intrinsics.height_px, 800);
  const Eigen::Vector3d point(0.05, -0.1, 1.2);
  const Eigen::Vector2d at =
      *full.cameras[3].intrinsics.Project(full.cameras[3].cam_from_rig * point);
  const Eigen::Vector2d at_half =
      *half.cameras[3].intrinsics.Project(half.cameras[3].cam_from_rig * point);
  EXPECT_LT((0.5 * at - at_half).norm(), 1e-9);
}

}  // namespace
}  // namespace rotunda::sim
