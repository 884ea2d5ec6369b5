#include "sfm/core/camera.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <opencv2/calib3d.hpp>

namespace rotunda {
namespace {

/// One lens of every model, with distortion that moves the corners of the picture by tens of
/// pixels.
std::vector<CameraIntrinsics> Lenses() {
  return {
      {CameraModel::kSimplePinhole, 1200, 1600, {1840, 611, 793}},
      {CameraModel::kPinhole, 1200, 1600, {1840, 1835, 611, 793}},
      {CameraModel::kSimpleRadial, 1200, 1600, {1840, 611, 793, -0.08}},
      {CameraModel::kRadial, 1200, 1600, {1840, 611, 793, -0.08, 0.03}},
      {CameraModel::kOpencv, 1200, 1600, {1840, 1835, 611, 793, -0.08, 0.03, 8e-4, -5e-4}},
      {CameraModel::kFullOpencv,
       1200,
       1600,
       {1840, 1835, 611, 793, -0.06, 0.03, 8e-4, -5e-4, 0.01, 0.02, -0.01, 0.004}},
  };
}

std::vector<Eigen::Vector3d> PointsInFront() {
  std::vector<Eigen::Vector3d> points;
  for (double z : {0.4, 1.7, 30.0}) {
    for (int row = -4; row <= 4; ++row) {
      for (int column = -3; column <= 3; ++column) {
        points.push_back({0.1 * column * z, 0.1 * row * z, z});
      }
    }
  }
  return points;
}

std::string NameOf(const CameraIntrinsics& lens) {
  return std::string(CameraModelName(lens.model));
}

TEST(Camera, ModelsHaveColmapsNamesAndNumbers) {
  // src/base/camera_models.h of COLMAP 3.8.
  const std::vector<std::tuple<CameraModel, std::string, int, size_t>> table = {
      {CameraModel::kSimplePinhole, "SIMPLE_PINHOLE", 0, 3},
      {CameraModel::kPinhole, "PINHOLE", 1, 4},
      {CameraModel::kSimpleRadial, "SIMPLE_RADIAL", 2, 4},
      {CameraModel::kRadial, "RADIAL", 3, 5},
      {CameraModel::kOpencv, "OPENCV", 4, 8},
      {CameraModel::kFullOpencv, "FULL_OPENCV", 6, 12}};
  for (const auto& [model, name, id, params] : table) {
    EXPECT_EQ(CameraModelName(model), name);
    EXPECT_EQ(*CameraModelFromName(name), model);
    EXPECT_EQ(ColmapModelId(model), id);
    EXPECT_EQ(*CameraModelFromColmapId(id), model);
    EXPECT_EQ(CameraParamCount(model), params);
  }
  EXPECT_FALSE(CameraModelFromColmapId(5).ok());
  EXPECT_NE(CameraModelFromName("FOV").error().message.find("'FOV'"), std::string::npos);
}

TEST(Camera, UnprojectingAProjectionGivesTheRay) {
  for (const CameraIntrinsics& lens : Lenses()) {
    for (const Eigen::Vector3d& point : PointsInFront()) {
      const auto pixel = lens.Project(point);
      ASSERT_TRUE(pixel) << NameOf(lens);
      const auto normalized = lens.NormalizedFromPixel(*pixel);
      ASSERT_TRUE(normalized) << NameOf(lens);
      EXPECT_LT((*normalized - point.hnormalized()).norm(), 1e-12) << NameOf(lens);
    }
  }
}

TEST(Camera, ProjectsLikeOpencv) {
  for (const CameraIntrinsics& lens : Lenses()) {
    if (lens.model != CameraModel::kOpencv && lens.model != CameraModel::kFullOpencv) continue;
    const cv::Matx33d k(lens.params[0], 0, lens.params[2], 0, lens.params[1], lens.params[3], 0, 0,
                        1);
    const std::vector<double> distortion(lens.params.begin() + 4, lens.params.end());
    std::vector<cv::Point3d> points;
    for (const Eigen::Vector3d& p : PointsInFront()) points.emplace_back(p.x(), p.y(), p.z());
    std::vector<cv::Point2d> expected;
    cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), k, distortion, expected);
    for (size_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector2d pixel = *lens.Project(PointsInFront()[i]);
      EXPECT_NEAR(pixel.x(), expected[i].x, 1e-9) << NameOf(lens);
      EXPECT_NEAR(pixel.y(), expected[i].y, 1e-9) << NameOf(lens);
    }
  }
}

TEST(Camera, SimplerModelsAreSpecialCasesOfOpencv) {
  const CameraIntrinsics radial = Lenses()[3];
  const CameraIntrinsics opencv{
      CameraModel::kOpencv, 1200, 1600, {1840, 1840, 611, 793, -0.08, 0.03, 0, 0}};
  const CameraIntrinsics simple_radial = Lenses()[2];
  const CameraIntrinsics one_term{
      CameraModel::kOpencv, 1200, 1600, {1840, 1840, 611, 793, -0.08, 0, 0, 0}};
  for (const Eigen::Vector3d& point : PointsInFront()) {
    EXPECT_LT((*radial.Project(point) - *opencv.Project(point)).norm(), 1e-10);
    EXPECT_LT((*simple_radial.Project(point) - *one_term.Project(point)).norm(), 1e-10);
  }
}

TEST(Camera, APointBehindHasNoPixel) {
  for (const CameraIntrinsics& lens : Lenses()) {
    EXPECT_FALSE(lens.Project({0.1, 0.1, -1.0}));
    EXPECT_FALSE(lens.Project({0.1, 0.1, 0.0}));
  }
}

TEST(Camera, NoRayGoesThroughAPixelThatIsNoNumber) {
  for (const CameraIntrinsics& lens : Lenses()) {
    EXPECT_FALSE(lens.NormalizedFromPixel({NAN, 800}));
    EXPECT_FALSE(lens.NormalizedFromPixel({600, INFINITY}));
  }
}

TEST(Camera, ScalingThePictureScalesThePixels) {
  for (const CameraIntrinsics& lens : Lenses()) {
    const CameraIntrinsics half = ScaledIntrinsics(lens, 0.5);
    EXPECT_EQ(half.width_px, 600);
    EXPECT_EQ(half.height_px, 800);
    for (const Eigen::Vector3d& point : PointsInFront()) {
      EXPECT_LT((*half.Project(point) - 0.5 * *lens.Project(point)).norm(), 1e-10) << NameOf(lens);
    }
  }
}

TEST(Camera, DefaultLooksThroughTheMiddle) {
  const CameraIntrinsics lens = DefaultIntrinsics(1200, 1600, 1920);
  EXPECT_TRUE(lens.Validate().ok());
  EXPECT_LT((*lens.Project({0, 0, 1}) - Eigen::Vector2d(600, 800)).norm(), 1e-12);
  EXPECT_TRUE(lens.Contains({0, 0}));
  EXPECT_TRUE(lens.Contains({1199.9, 1599.9}));
  EXPECT_FALSE(lens.Contains({1200, 10}));
  EXPECT_FALSE(lens.Contains({-0.1, 10}));
}

TEST(Camera, ValidateNamesWhatIsWrong) {
  const auto message = [](const CameraIntrinsics& lens) {
    const Status status = lens.Validate();
    return status.ok() ? std::string("ok") : status.error().message;
  };
  CameraIntrinsics lens = Lenses()[4];
  EXPECT_EQ(message(lens), "ok");
  lens.params.pop_back();
  EXPECT_EQ(message(lens), "has 7 parameters, expected 8");
  lens = Lenses()[4];
  lens.params[0] = -5;
  EXPECT_NE(message(lens).find("focal length"), std::string::npos);
  lens.params[0] = NAN;
  EXPECT_NE(message(lens).find("finite"), std::string::npos);
  lens = Lenses()[4];
  lens.width_px = 0;
  EXPECT_NE(message(lens).find("0x1600"), std::string::npos);
}

}  // namespace
}  // namespace rotunda
