#include "sfm/triangulation.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

constexpr double kFocal_px = 1840.0;
const Eigen::Vector3d kPoint(0.1, -0.05, 0.2);

/// A camera at `azimuth_deg` on a circle of 1.7 m around the origin that looks at the origin, and
/// its view of `point`, `offset_px` beside the truth.
TriangulationView View(double azimuth_deg, const Eigen::Vector3d& point,
                       const Eigen::Vector2d& offset_px = Eigen::Vector2d::Zero()) {
  const double a = RadFromDeg(azimuth_deg);
  const Eigen::Vector3d forward(-std::cos(a), 0.0, -std::sin(a));
  Eigen::Matrix3d rotation;
  rotation << Eigen::Vector3d::UnitY().cross(forward).transpose(), Eigen::RowVector3d::UnitY(),
      forward.transpose();
  const Rigid3 pose = {Eigen::Quaterniond(rotation), Eigen::Vector3d(0, 0, 1.7)};
  const Eigen::Vector3d x = pose * point;
  return MakeTriangulationView(pose, x.hnormalized() + offset_px / kFocal_px, kFocal_px);
}

TEST(Triangulate, IsExactOnExactViews) {
  const std::vector<TriangulationView> views = {View(0, kPoint), View(20, kPoint),
                                                View(50, kPoint)};
  const auto point = Triangulate(views, {});
  ASSERT_TRUE(point);
  EXPECT_LT((point->position - kPoint).norm(), 1e-12);
  EXPECT_EQ(point->inliers, (std::vector<size_t>{0, 1, 2}));
}

TEST(Triangulate, RefusesAnglesBelowTheLimit) {
  const TriangulationOptions options = {4.0, RadFromDeg(1.5)};
  // The point is about as far from the cameras as the centre they circle.
  const std::vector<TriangulationView> narrow = {View(0, kPoint), View(1.2, kPoint)};
  EXPECT_FALSE(Triangulate(narrow, options));
  const std::vector<TriangulationView> wide = {View(0, kPoint), View(2.0, kPoint)};
  EXPECT_TRUE(Triangulate(wide, options));
}

TEST(Triangulate, RefusesPointsBehindACamera) {
  // The rays meet behind the cameras.
  const Rigid3 left = {Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.5, 0, 0)};
  const Rigid3 right = {Eigen::Quaterniond::Identity(), Eigen::Vector3d(-0.5, 0, 0)};
  const std::vector<TriangulationView> views = {
      MakeTriangulationView(left, {-0.25, 0.0}, kFocal_px),
      MakeTriangulationView(right, {0.25, 0.0}, kFocal_px)};
  EXPECT_FALSE(Triangulate(views, {}));
}

TEST(Triangulate, LeavesMismatchesOut) {
  // Five of twelve views are of something else.
  std::vector<TriangulationView> views;
  std::vector<size_t> right;
  for (size_t i = 0; i < 12; ++i) {
    const bool wrong = i % 5 == 1 || i % 5 == 3;
    const double sign = i % 2 == 0 ? 1.0 : -1.0;
    const double side_px = 40.0 + 17.0 * static_cast<double>(i);
    views.push_back(
        View(12.0 * static_cast<double>(i), kPoint,
             wrong ? Eigen::Vector2d(sign * side_px, 60.0 - side_px) : Eigen::Vector2d::Zero()));
    if (!wrong) right.push_back(i);
  }
  const auto point = Triangulate(views, {});
  ASSERT_TRUE(point);
  EXPECT_EQ(point->inliers, right);
  EXPECT_LT((point->position - kPoint).norm(), 1e-12);
}

TEST(Triangulate, ErrorIsWhatTheNoiseAllows) {
  constexpr uint64_t kSeed = 5;
  constexpr double kNoise_px = 0.5;
  constexpr int kTrials = 400;
  test::NormalRandom random(kSeed);
  const std::vector<double> azimuths_deg = {0, 15, 30, 45};
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  for (const double azimuth : azimuths_deg) {
    const TriangulationView view = View(azimuth, kPoint);
    const Eigen::Vector3d x = view.cam_from_model * kPoint.homogeneous();
    Eigen::Matrix<double, 2, 3> by_x;
    by_x << 1, 0, -x.x() / x.z(), 0, 1, -x.y() / x.z();
    const Eigen::Matrix<double, 2, 3> jacobian =
        kFocal_px / x.z() / kNoise_px * by_x * view.cam_from_model.leftCols<3>();
    information += jacobian.transpose() * jacobian;
  }
  double sum = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    std::vector<TriangulationView> views;
    for (const double azimuth : azimuths_deg) {
      const double dx = kNoise_px * random.Normal(), dy = kNoise_px * random.Normal();
      views.push_back(View(azimuth, kPoint, {dx, dy}));
    }
    const auto point = Triangulate(views, {});
    ASSERT_TRUE(point);
    const Eigen::Vector3d error = point->position - kPoint;
    sum += error.dot(information * error);
  }
  // Chi-square of 3 * 400 degrees of freedom: standard deviation sqrt(2 * 1200) = 49.
  EXPECT_NEAR(sum, 3.0 * kTrials, 4.0 * 49.0) << "seed " << kSeed;
}

TEST(Triangulate, NeedsTwoViews) {
  EXPECT_FALSE(Triangulate(std::vector<TriangulationView>{View(0, kPoint)}, {}));
  EXPECT_FALSE(Triangulate({}, {}));
}

}  // namespace
}  // namespace rotunda::sfm
