#include <gtest/gtest.h>

#include <array>

#include "sfm/core/camera.h"

namespace rotunda {
namespace {

struct Case {
  CameraModel model;
  std::vector<double> params;
};

class ProjectionJacobianTest : public ::testing::TestWithParam<Case> {};

constexpr double kStep = 1e-5;
const Eigen::Vector3d kPoint(0.31, -0.47, 1.6);

TEST_P(ProjectionJacobianTest, PixelIsThatOfProject) {
  const auto& [model, params] = GetParam();
  const CameraIntrinsics lens = {model, 1200, 1600, params};
  ProjectionJacobian projection;
  ProjectWithJacobian(model, params.data(), kPoint, true, projection);
  EXPECT_LT((projection.pixel - *lens.Project(kPoint)).norm(), 1e-10);
}

TEST_P(ProjectionJacobianTest, DerivativesAreThoseOfCentralDifferences) {
  const auto& [model, params] = GetParam();
  ProjectionJacobian projection, above, below;
  ProjectWithJacobian(model, params.data(), kPoint, true, projection);
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(i);
    ProjectWithJacobian(model, params.data(), kPoint + step, false, above);
    ProjectWithJacobian(model, params.data(), kPoint - step, false, below);
    const Eigen::Vector2d difference = (above.pixel - below.pixel) / (2.0 * kStep);
    EXPECT_LT((projection.by_point.col(i) - difference).norm(), 1e-5) << "coordinate " << i;
  }
  for (size_t p = 0; p < kMaxCameraParams; ++p) {
    Eigen::Vector2d difference = Eigen::Vector2d::Zero();
    if (p < params.size()) {
      std::vector<double> moved = params;
      moved[p] = params[p] + kStep;
      ProjectWithJacobian(model, moved.data(), kPoint, false, above);
      moved[p] = params[p] - kStep;
      ProjectWithJacobian(model, moved.data(), kPoint, false, below);
      difference = (above.pixel - below.pixel) / (2.0 * kStep);
    }
    EXPECT_LT((projection.by_params.col(p) - difference).norm(), 1e-5) << "parameter " << p;
  }
}

TEST_P(ProjectionJacobianTest, FocalAndPrincipalPointAreTold) {
  const auto& [model, params] = GetParam();
  for (size_t p = 0; p < params.size(); ++p) {
    EXPECT_EQ(IsFocal(model, p), params[p] > 1000.0) << "parameter " << p;
    EXPECT_EQ(IsPrincipalPoint(model, p), params[p] > 500.0 && params[p] < 1000.0)
        << "parameter " << p;
  }
}

INSTANTIATE_TEST_SUITE_P(
    AllModels, ProjectionJacobianTest,
    ::testing::Values(Case{CameraModel::kSimplePinhole, {1840, 601, 803}},
                      Case{CameraModel::kPinhole, {1840, 1835, 601, 803}},
                      Case{CameraModel::kSimpleRadial, {1840, 601, 803, -0.11}},
                      Case{CameraModel::kRadial, {1840, 601, 803, -0.11, 0.07}},
                      Case{CameraModel::kOpencv, {1840, 1835, 601, 803, -0.11, 0.07, 2e-3, -1e-3}},
                      Case{CameraModel::kFullOpencv,
                           {1840, 1835, 601, 803, -0.11, 0.07, 2e-3, -1e-3, 0.03, 0.05, -0.02,
                            0.01}}),
    [](const auto& info) { return std::string(CameraModelName(info.param.model)); });

}  // namespace
}  // namespace rotunda
