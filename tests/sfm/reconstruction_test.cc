#include "sfm/reconstruction.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "tests/support/reconstruction_near.h"
#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

/// Two cameras a metre apart that look along z, and one point four metres away, seen 3 px to the
/// right of where it is in the first and 4 px below in the second.
struct Pair {
  Reconstruction model;
  Features features;
};

Pair MakePair() {
  Pair pair;
  pair.model.intrinsics.lenses = {{CameraModel::kSimplePinhole, 1000, 1000, {1000, 500, 500}}};
  pair.model.intrinsics.lens_of_image = {0, 0, 0};
  pair.model.cam_from_model = {Rigid3{}, Rigid3{{1, 0, 0, 0}, {-1, 0, 0}}, std::nullopt};
  Point3 point;
  point.position = {0, 0, 4};
  point.observations = {{ImageId(0), KeypointId(0)}, {ImageId(1), KeypointId(0)}};
  pair.model.points = {point};
  pair.features.images.resize(3);
  pair.features.images[0].keypoints = {{503, 500, 2, 0}};
  pair.features.images[1].keypoints = {{250, 504, 2, 0}};
  pair.features.images[0].colors_rgb = {{10, 20, 30}};
  pair.features.images[1].colors_rgb = {{20, 21, 255}};
  return pair;
}

TEST(Reconstruction, MeasuresReprojectionErrors) {
  const auto [model, features] = MakePair();
  const Point3& point = model.points[0];
  EXPECT_NEAR(*ReprojectionError_px(model, features, point, point.observations[0]), 3.0, 1e-9);
  EXPECT_NEAR(*ReprojectionError_px(model, features, point, point.observations[1]), 4.0, 1e-9);
  const ReprojectionSummary summary = SummarizeReprojection(model, features);
  EXPECT_EQ(summary.observations, 2u);
  EXPECT_NEAR(summary.rms_px, std::sqrt(12.5), 1e-9);
  EXPECT_NEAR(summary.mean_over_points_px, 3.5, 1e-9);
  EXPECT_NEAR(summary.images[1].rms_px, 4.0, 1e-9);
  EXPECT_EQ(summary.images[2].observations, 0u);
  EXPECT_EQ(RegisteredCount(model), 2u);
}

TEST(Reconstruction, GivesNoErrorBehindACameraOrForAnUnregisteredImage) {
  auto [model, features] = MakePair();
  model.points[0].position.z() = -4;
  EXPECT_FALSE(
      ReprojectionError_px(model, features, model.points[0], model.points[0].observations[0]));
  EXPECT_FALSE(ReprojectionError_px(model, features, model.points[0], {ImageId(2), KeypointId(0)}));
}

TEST(Reconstruction, LooksTheSameInAnotherFrame) {
  const test::SyntheticWorld world = test::MakeSyntheticWorld({});
  const Reconstruction here = test::TrueReconstruction(world);
  const Sim3 to_other = {
      0.3, Eigen::Quaterniond(Eigen::AngleAxisd(2.0, Eigen::Vector3d(1, -2, 3).normalized())),
      Eigen::Vector3d(5, -2, 8)};
  const Reconstruction there = Transformed(here, to_other);
  const ReprojectionSummary a = SummarizeReprojection(here, world.features);
  const ReprojectionSummary b = SummarizeReprojection(there, world.features);
  EXPECT_EQ(a.observations, b.observations);
  EXPECT_NEAR(a.rms_px, b.rms_px, 1e-9);
  EXPECT_EQ(test::NotNear(there, world.cam_from_world, 1e-9, 1e-9), "");
}

TEST(Reconstruction, ColorsArePointwiseMeans) {
  const auto [model, features] = MakePair();
  const Reconstruction colored = WithColors(model, features);
  EXPECT_EQ(colored.points[0].color_rgb, (std::array<uint8_t, 3>{15, 21, 143}));
}

}  // namespace
}  // namespace rotunda::sfm
