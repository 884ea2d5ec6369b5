#include "sfm/model_fusion.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace rotunda::sfm {
namespace {

constexpr double kMaxDuplicate_px = 4.0;
constexpr double kFocal_px = 1000.0;
constexpr double kDepth = 2.0;

/// Five cameras side by side that look along z; 0 to 2 make the source, 2 to 4 the target, so that
/// camera 2 is common. A point is given by where it is at depth kDepth.
class ModelFusionTest : public ::testing::Test {
 protected:
  void SetUp() override {
    for (size_t i = 0; i < 5; ++i) {
      cameras_.push_back(
          {Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.2 * static_cast<double>(i), 0, 0)});
      features_.images.push_back({1200, 1600, {}, {}, {}});
      source_.intrinsics.lenses.push_back(DefaultIntrinsics(1200, 1600, kFocal_px));
      source_.intrinsics.lens_of_image.push_back(i);
    }
    target_.intrinsics = source_.intrinsics;
    source_.cam_from_model = {cameras_[0], cameras_[1], cameras_[2], {}, {}};
    target_.cam_from_model = {{}, {}, cameras_[2], cameras_[3], cameras_[4]};
  }

  /// A keypoint `off_px` to the right of where the point is seen.
  Observation See(size_t image, const Eigen::Vector3d& position, double off_px = 0.0) {
    const auto pixel = *source_.intrinsics.of(ImageId(image)).Project(cameras_[image] * position);
    auto& keypoints = features_.images[image].keypoints;
    keypoints.push_back(
        {static_cast<float>(pixel.x() + off_px), static_cast<float>(pixel.y()), 2.0f, 0.0f});
    return {ImageId(image), KeypointId(keypoints.size() - 1)};
  }
  /// To the right by pixels.
  static Eigen::Vector3d Shifted(const Eigen::Vector3d& position, double px) {
    return position + Eigen::Vector3d(px * kDepth / kFocal_px, 0, 0);
  }

  Reconstruction Fuse(const std::vector<bool>& agrees = {true}) {
    const PointIndex source_index(features_, source_), target_index(features_, target_);
    const TwoViews two_views;
    const ViewGraph graph;
    const auto links =
        LinkModels({features_, two_views, graph}, {source_, source_index}, {target_, target_index});
    EXPECT_EQ(links.size(), agrees.size());
    return FuseModels({features_, source_, target_, links, agrees}, kMaxDuplicate_px);
  }

  std::vector<Rigid3> cameras_;
  Features features_;
  Reconstruction source_, target_;
  const Eigen::Vector3d point_ = {-0.4, 0.1, kDepth};
};

TEST_F(ModelFusionTest, FusesPointsOfOneKeypointThatLieTogether) {
  const Observation common = See(2, point_);
  source_.points = {{point_, {See(0, point_), See(1, point_), common}, {}}};
  target_.points = {{Shifted(point_, 3.0), {common, See(3, point_)}, {}}};
  const Reconstruction fused = Fuse();
  ASSERT_EQ(fused.points.size(), 1u);
  EXPECT_EQ(fused.points[0].observations.size(), 4u);
  // The mean, weighted by the observations.
  EXPECT_NEAR((fused.points[0].position - Shifted(point_, 3.0 * 2 / 5)).norm(), 0.0, 1e-12);
  EXPECT_EQ(RegisteredCount(fused), 5u);
}

TEST_F(ModelFusionTest, AKeypointOfTwoPlacesStaysWithTheBetterSupportedPoint) {
  const Observation common = See(2, point_);
  source_.points = {{point_, {See(0, point_), See(1, point_), common}, {}}};
  const Eigen::Vector3d wrong = Shifted(point_, 30.0);
  target_.points = {{wrong, {common, See(3, wrong), See(4, wrong, 9.0)}, {}}};
  const Reconstruction fused = Fuse();
  ASSERT_EQ(fused.points.size(), 2u);
  EXPECT_EQ(fused.points[0].position, wrong);
  EXPECT_EQ(fused.points[0].observations.size(), 2u);
  EXPECT_EQ(fused.points[1].observations, source_.points[0].observations);
  // With two observations it is gone altogether.
  target_.points[0].observations.pop_back();
  ASSERT_EQ(Fuse().points.size(), 1u);
  EXPECT_EQ(Fuse().points[0].position, point_);
}

TEST_F(ModelFusionTest, ACommonCameraKeepsThePoseWithTheSmallerStandardError) {
  // In the source the camera stands 2 px off, on two observations; in the target it stands right.
  source_.cam_from_model[2]->translation += Eigen::Vector3d(2.0 * kDepth / kFocal_px, 0, 0);
  for (size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d x = point_ + Eigen::Vector3d(0, 0.05 * static_cast<double>(k), 0);
    const Observation common = See(2, x, 0.1);
    if (k < 2) source_.points.push_back({x, {See(0, x), common}, {}});
    target_.points.push_back({x, {common, See(3, x)}, {}});
  }
  source_.intrinsics.lenses[2].params[0] = target_.intrinsics.lenses[2].params[0] + 5.0;
  Reconstruction fused = Fuse();
  EXPECT_EQ(fused.cam_from_model[2]->translation, target_.cam_from_model[2]->translation);
  EXPECT_EQ(fused.intrinsics.lenses[2].params, target_.intrinsics.lenses[2].params);
  EXPECT_EQ(fused.points.size(), 4u);
  // The other way around.
  std::swap(source_, target_);
  fused = Fuse();
  EXPECT_EQ(fused.cam_from_model[2]->translation, source_.cam_from_model[2]->translation);
  EXPECT_EQ(fused.intrinsics.lenses[2].params, source_.intrinsics.lenses[2].params);
}

TEST_F(ModelFusionTest, AContradictoryCameraLosesWhatItSawFromTheOtherPose) {
  const Observation common = See(2, point_);
  target_.points = {{point_, {common, See(3, point_)}, {}}};
  source_.cam_from_model[2]->translation.y() += 0.5;
  const Eigen::Vector3d other = point_ + Eigen::Vector3d(0, 0.3, 0);
  source_.points = {{other, {See(0, other), See(1, other), See(2, other, 20.0)}, {}},
                    {other, {See(0, other), See(2, other, 20.0)}, {}}};
  const Reconstruction fused = Fuse({false});
  EXPECT_EQ(fused.cam_from_model[2]->translation, target_.cam_from_model[2]->translation);
  ASSERT_EQ(fused.points.size(), 2u);
  EXPECT_EQ(fused.points[0].observations, target_.points[0].observations);
  EXPECT_EQ(fused.points[1].observations.size(), 2u);
}

}  // namespace
}  // namespace rotunda::sfm
