#include "sfm/pairs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "sfm/core/rigid3.h"

namespace rotunda::sfm {
namespace {

constexpr size_t kColumns = 12;

/// A ring of upright cameras that look at the axis from 1.7 m, at half a person's height.
Calibration Ring() {
  Calibration calibration;
  for (size_t i = 0; i < kColumns; ++i) {
    const double azimuth_rad = 2 * kPi * i / kColumns;
    const Eigen::Vector3d outward(std::cos(azimuth_rad), std::sin(azimuth_rad), 0);
    Eigen::Matrix3d cam_from_rig;
    cam_from_rig.row(2) = -outward;
    cam_from_rig.row(1) = -Eigen::Vector3d::UnitZ();
    cam_from_rig.row(0) = cam_from_rig.row(1).cross(cam_from_rig.row(2));
    CalibratedCamera& camera = calibration.cameras.emplace_back();
    camera.camera = "c" + std::to_string(10 + i);
    camera.intrinsics = DefaultIntrinsics(1200, 1600, 1840);
    camera.cam_from_rig.rotation = Eigen::Quaterniond(cam_from_rig);
    camera.cam_from_rig.translation =
        -(cam_from_rig * (1.7 * outward + Eigen::Vector3d(0, 0, 0.95)));
  }
  return calibration;
}

FrameSet SetOf(const Calibration& calibration) {
  FrameSet set;
  for (const CalibratedCamera& camera : calibration.cameras) {
    set.frames.emplace_back().camera = camera.camera;
  }
  return set;
}

TEST(Pairs, ExhaustiveHasEveryPairOnceInOrder) {
  const std::vector<ImagePair> pairs = ExhaustivePairs(5);
  EXPECT_EQ(pairs.size(), 10U);
  EXPECT_TRUE(std::is_sorted(pairs.begin(), pairs.end()));
  for (const ImagePair& pair : pairs) EXPECT_LT(pair.first, pair.second);
  EXPECT_TRUE(ExhaustivePairs(0).empty());
}

TEST(Pairs, NeighboursAreThoseWhoseViewsOverlap) {
  const Calibration calibration = Ring();
  const auto pairs = NeighbourPairs(SetOf(calibration), calibration);
  ASSERT_TRUE(pairs.ok()) << pairs.error().ToString();
  for (const ImagePair& pair : ExhaustivePairs(kColumns)) {
    const size_t apart = pair.second.index() - pair.first.index();
    const size_t columns = std::min(apart, kColumns - apart);
    const bool found = std::find(pairs->begin(), pairs->end(), pair) != pairs->end();
    if (columns == 1) {
      EXPECT_TRUE(found) << "30 degrees apart: " << pair.first.index();
    }
    if (columns >= 3) {
      EXPECT_FALSE(found) << "90 degrees or more apart: " << pair.first.index();
    }
  }
}

TEST(Pairs, ACameraThatTheCalibrationLacksIsNamed) {
  Calibration calibration = Ring();
  const FrameSet set = SetOf(calibration);
  calibration.cameras.erase(calibration.cameras.begin() + 3);
  const auto pairs = NeighbourPairs(set, calibration);
  ASSERT_FALSE(pairs.ok());
  EXPECT_NE(pairs.error().ToString().find("c13"), std::string::npos);
}

}  // namespace
}  // namespace rotunda::sfm
