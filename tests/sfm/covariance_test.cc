#include "sfm/covariance.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <functional>

#include "sfm/bundle_adjustment.h"
#include "tests/support/reconstruction_near.h"
#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

using test::ErrorsOf;
using test::MakeSyntheticWorld;
using test::NormalRandom;
using test::SyntheticOptions;
using test::SyntheticWorld;
using test::TrueReconstruction;

constexpr uint64_t kSeed = 11;
constexpr double kNoise_px = 0.4;

SyntheticOptions SmallRing() {
  SyntheticOptions options;
  options.columns = 10;
  options.rows = 1;
  options.points = 150;
  options.noise_px = 0.0;
  options.shared_lens = true;
  options.model = CameraModel::kSimpleRadial;
  return options;
}

std::vector<ImageId> AllImages(const SyntheticWorld& world) {
  std::vector<ImageId> images;
  for (size_t i = 0; i < world.cam_from_world.size(); ++i) images.push_back(ImageId(i));
  return images;
}

SyntheticWorld WithNoise(SyntheticWorld world, uint64_t seed) {
  NormalRandom random(seed);
  for (ImageFeatures& image : world.features.images) {
    for (Keypoint& keypoint : image.keypoints) {
      keypoint.x_px += static_cast<float>(kNoise_px * random.Normal());
      keypoint.y_px += static_cast<float>(kNoise_px * random.Normal());
    }
  }
  return world;
}

/// Rotation (left tangent, camera axes) and centre of every camera after the Sim(3) fit, minus
/// truth.
std::vector<Eigen::Matrix<double, 6, 1>> PoseErrorsAfterFit(const Reconstruction& model,
                                                            const SyntheticWorld& world) {
  const Sim3 truth_from_model = ErrorsOf(model, world.cam_from_world).truth_from_model;
  std::vector<Eigen::Matrix<double, 6, 1>> errors;
  for (size_t i = 0; i < world.cam_from_world.size(); ++i) {
    const Rigid3 pose = TransformPose(truth_from_model, *model.cam_from_model[i]);
    const Eigen::AngleAxisd turn(pose.rotation * world.cam_from_world[i].rotation.conjugate());
    Eigen::Matrix<double, 6, 1> error;
    error << turn.angle() * turn.axis(),
        pose.OriginInSource() - world.cam_from_world[i].OriginInSource();
    errors.push_back(error);
  }
  return errors;
}

class CovarianceFixture : public ::testing::Test {
 protected:
  ThreadPool threads_{2};
  RunContext context_{threads_};
};
using CovarianceTest = CovarianceFixture;
class MonteCarloTest : public CovarianceFixture, public ::testing::WithParamInterface<bool> {};

/// Over draws of a world's errors: what the errors of adjusted poses are, as a share of what was
/// predicted from the same pictures.
struct Spread {
  std::vector<double> mahalanobis;         // by camera: mean squared distance
  std::vector<double> rotation, position;  // by camera: sum of squares / sum of variances
  double focal = 0.0;                      // likewise, of the first lens
  double sigma0 = 0.0;                     // mean
};

struct Experiment {
  SyntheticWorld world;
  Reconstruction truth;
  /// The world with the errors of one draw.
  std::function<SyntheticWorld(const SyntheticWorld& world, uint64_t seed)> draw;
  bool refined = false;
  Loss loss = Loss::kNone;
};

constexpr int kDraws = 200;

/// Sums up one draw; `variances` has the sums of the predicted ones where `spread` has squares.
void AddDraw(const Experiment& experiment, uint64_t seed, RunContext& context, Spread& spread,
             Spread& variances) {
  const SyntheticWorld noisy = experiment.draw(experiment.world, seed);
  BundleAdjustmentOptions options;
  options.refine_intrinsics = experiment.refined;
  options.loss = experiment.loss;
  options.function_tolerance = 1e-9;
  Reconstruction model = experiment.truth;
  ASSERT_TRUE(AdjustBundle(model, noisy.features, AllImages(noisy), options, context));
  const auto predicted = BuildPoseCovariances(model, noisy.features, experiment.refined, context);
  ASSERT_TRUE(predicted) << predicted.error().ToString();
  ASSERT_EQ(predicted->focal_sigma_px[0].has_value(), experiment.refined);
  const auto errors = PoseErrorsAfterFit(model, experiment.world);
  for (size_t c = 0; c < errors.size(); ++c) {
    const PoseCovariance& covariance = *predicted->images[c];
    spread.mahalanobis[c] += errors[c].dot(covariance.ldlt().solve(errors[c])) / kDraws;
    spread.rotation[c] += errors[c].head<3>().squaredNorm();
    spread.position[c] += errors[c].tail<3>().squaredNorm();
    variances.rotation[c] += covariance.topLeftCorner<3, 3>().trace();
    variances.position[c] += covariance.bottomRightCorner<3, 3>().trace();
  }
  spread.sigma0 += predicted->sigma0 / kDraws;
  const auto focal_px = [](const Intrinsics& of) { return of.lenses[0].params[0]; };
  spread.focal += std::pow(focal_px(model.intrinsics) - focal_px(noisy.intrinsics), 2);
  variances.focal += std::pow(predicted->focal_sigma_px[0].value_or(1.0), 2);
}

Spread SpreadOf(const Experiment& experiment, RunContext& context) {
  const std::vector<double> none(experiment.world.cam_from_world.size(), 0.0);
  Spread spread{none, none, none}, variances = spread;
  for (int i = 0; i < kDraws && !testing::Test::HasFatalFailure(); ++i) {
    AddDraw(experiment, DeriveSeed(kSeed, i), context, spread, variances);
  }
  for (size_t c = 0; c < none.size(); ++c) {
    spread.rotation[c] /= variances.rotation[c];
    spread.position[c] /= variances.position[c];
  }
  spread.focal /= variances.focal;
  return spread;
}

/// A trace ratio of 200 draws has at most the relative standard deviation sqrt(2 / 200) = 0.1; four
/// of them, over ten cameras.
constexpr double kOfATrace = 0.4;

void ExpectAsPredicted(const Spread& spread) {
  for (size_t i = 0; i < spread.mahalanobis.size(); ++i) {
    // Chi-square of 6 * 200 degrees of freedom: sqrt(2 / 1200) = 0.041.
    EXPECT_NEAR(spread.mahalanobis[i] / 6.0, 1.0, 4 * 0.041) << "camera " << i << " seed " << kSeed;
    EXPECT_NEAR(spread.rotation[i], 1.0, kOfATrace) << "camera " << i;
    EXPECT_NEAR(spread.position[i], 1.0, kOfATrace) << "camera " << i;
  }
}

/// The spread is estimated from what the points of one picture show.
SyntheticOptions RingOfManyPoints() {
  SyntheticOptions options = SmallRing();
  options.points = 1200;
  return options;
}

TEST_P(MonteCarloTest, IsTheSpreadOfAdjustmentsOfNoisyPictures) {
  const SyntheticWorld world = MakeSyntheticWorld(RingOfManyPoints());
  const Spread spread =
      SpreadOf({world, TrueReconstruction(world), WithNoise, GetParam()}, context_);
  ExpectAsPredicted(spread);
  const double sigma0 = kNoise_px / KeypointSigma_px(world.features.images[0].keypoints[0]);
  EXPECT_NEAR(spread.sigma0, sigma0, 0.03 * sigma0) << "seed " << kSeed;
  EXPECT_NEAR(spread.focal, GetParam() ? 1.0 : 0.0, kOfATrace);
}

INSTANTIATE_TEST_SUITE_P(Lenses, MonteCarloTest, ::testing::Values(false, true),
                         [](const auto& info) { return info.param ? "Refined" : "Fixed"; });

/// Noise, and each point drifts down or up the picture the higher the camera stands, as a blob on a
/// curved surface does.
SyntheticWorld WithDriftingPoints(const SyntheticWorld& world, uint64_t seed) {
  constexpr double kDrift = 5;  // times the noise, a metre
  SyntheticWorld noisy = WithNoise(world, seed);
  NormalRandom random(DeriveSeed(seed, 1));
  for (const Point3& point : TrueReconstruction(world).points) {
    const double drift_px = kDrift * kNoise_px * random.Normal();
    for (const Observation& observation : point.observations) {
      const size_t image = observation.image.index();
      const double height_m = world.cam_from_world[image].OriginInSource().z();
      noisy.features.images[image].keypoints[observation.keypoint.index()].y_px +=
          static_cast<float>(drift_px * height_m);
    }
  }
  return noisy;
}

TEST_F(CovarianceTest, ErrorsThatImagesOfAPointHaveInCommonDoNotCountAsIndependent) {
  SyntheticOptions options = RingOfManyPoints();
  options.columns = 8;
  options.rows = 3;
  options.detection_share = 1.0;
  const SyntheticWorld world = MakeSyntheticWorld(options);
  const Spread spread = SpreadOf({world, TrueReconstruction(world), WithDriftingPoints}, context_);
  for (size_t i = 0; i < spread.rotation.size(); ++i) {
    EXPECT_NEAR(spread.rotation[i], 1.0, kOfATrace) << "camera " << i << " seed " << kSeed;
    EXPECT_NEAR(spread.position[i], 1.0, kOfATrace) << "camera " << i << " seed " << kSeed;
  }
}

/// Noise, and one keypoint in fifty is somewhere else, as after a wrong match.
SyntheticWorld WithGrossErrors(const SyntheticWorld& world, uint64_t seed) {
  constexpr double kShare = 0.02;
  constexpr double kGross_px = 15 * kNoise_px;
  SyntheticWorld noisy = WithNoise(world, seed);
  NormalRandom random(DeriveSeed(seed, 1));
  for (ImageFeatures& image : noisy.features.images) {
    for (Keypoint& keypoint : image.keypoints) {
      const double angle_rad = 2.0 * M_PI * random.Uniform();
      if (random.Uniform() >= kShare) continue;
      keypoint.x_px += static_cast<float>(kGross_px * std::cos(angle_rad));
      keypoint.y_px += static_cast<float>(kGross_px * std::sin(angle_rad));
    }
  }
  return noisy;
}

TEST_F(CovarianceTest, AFewGrossErrorsCountAsLittleAsInTheAdjustment) {
  const SyntheticWorld world = MakeSyntheticWorld(RingOfManyPoints());
  const Spread spread =
      SpreadOf({world, TrueReconstruction(world), WithGrossErrors, false, Loss::kCauchy}, context_);
  for (size_t i = 0; i < spread.rotation.size(); ++i) {
    EXPECT_NEAR(spread.rotation[i], 1.0, kOfATrace) << "camera " << i << " seed " << kSeed;
    EXPECT_NEAR(spread.position[i], 1.0, kOfATrace) << "camera " << i << " seed " << kSeed;
  }
}

TEST_F(CovarianceTest, AnImageThatFewPointsHoldIsNoSurerThanItIs) {
  const SyntheticWorld world = MakeSyntheticWorld(RingOfManyPoints());
  Reconstruction truth = TrueReconstruction(world);
  int held_by = 0;
  for (Point3& point : truth.points) {
    std::erase_if(point.observations, [&](const Observation& observation) {
      return observation.image == ImageId(0) && ++held_by > 20;
    });
  }
  const Spread spread = SpreadOf({world, truth, WithNoise}, context_);
  // Of six errors of like size: half of kOfATrace, which is for one that outweighs the others.
  EXPECT_NEAR(spread.rotation[0], 1.0, kOfATrace / 2) << "seed " << kSeed;
  EXPECT_NEAR(spread.position[0], 1.0, kOfATrace / 2) << "seed " << kSeed;
}

TEST_F(CovarianceTest, DoesNotDependOnTheFrameOfTheModel) {
  const SyntheticWorld world = WithNoise(MakeSyntheticWorld(SmallRing()), kSeed);
  const Reconstruction truth = TrueReconstruction(world);
  const Sim3 to_other = {
      3.0, Eigen::Quaterniond(Eigen::AngleAxisd(1.0, Eigen::Vector3d(1, 2, 3).normalized())),
      Eigen::Vector3d(5, -2, 8)};
  const auto here = BuildPoseCovariances(truth, world.features, false, context_);
  const auto there =
      BuildPoseCovariances(Transformed(truth, to_other), world.features, false, context_);
  ASSERT_TRUE(here && there);
  const Eigen::Matrix3d turn = to_other.rotation.toRotationMatrix();
  for (size_t i = 0; i < here->images.size(); ++i) {
    const PoseCovariance& a = *here->images[i];
    const PoseCovariance& b = *there->images[i];
    const Eigen::Matrix3d rotation = a.topLeftCorner<3, 3>();
    const Eigen::Matrix3d center = 9.0 * turn * a.bottomRightCorner<3, 3>() * turn.transpose();
    EXPECT_LT((b.topLeftCorner<3, 3>() - rotation).norm(), 1e-6 * rotation.norm());
    EXPECT_LT((b.bottomRightCorner<3, 3>() - center).norm(), 1e-6 * center.norm());
  }
}

/// Every corner found twice, as at two scales: the second time tells nothing new.
TEST_F(CovarianceTest, KeypointsOnTheSameCornerCountOnce) {
  SyntheticOptions options = SmallRing();
  options.points = 1000;  // so many that the poses' part in the redundancy does not count
  const SyntheticWorld world = WithNoise(MakeSyntheticWorld(options), kSeed);
  const Reconstruction once = TrueReconstruction(world);
  Features features = world.features;
  std::vector<size_t> count;
  for (ImageFeatures& image : features.images) {
    count.push_back(image.keypoints.size());
    const std::vector<Keypoint> corners = image.keypoints;
    image.keypoints.insert(image.keypoints.end(), corners.begin(), corners.end());
  }
  Reconstruction twice = once;
  for (Point3 point : once.points) {
    for (Observation& observation : point.observations) {
      observation.keypoint =
          KeypointId(observation.keypoint.index() + count[observation.image.index()]);
    }
    twice.points.push_back(point);
  }
  const auto expected = BuildPoseCovariances(once, world.features, false, context_);
  const auto found = BuildPoseCovariances(twice, features, false, context_);
  ASSERT_TRUE(expected && found);
  for (size_t i = 0; i < expected->images.size(); ++i) {
    const double a = SigmaOf(*expected->images[i]).position_mm;
    EXPECT_NEAR(SigmaOf(*found->images[i]).position_mm, a, 0.03 * a) << "camera " << i;
  }
}

TEST_F(CovarianceTest, SigmasAreRootsOfTheTraces) {
  PoseCovariance covariance = PoseCovariance::Zero();
  covariance.diagonal() << 1e-8, 2e-8, 6e-8, 1e-6, 1e-6, 2e-6;
  const PoseSigma sigma = SigmaOf(covariance);
  EXPECT_NEAR(sigma.rotation_deg, DegFromRad(3e-4), 1e-12);
  EXPECT_NEAR(sigma.position_mm, 2.0, 1e-12);
}

TEST_F(CovarianceTest, NeedsThreeImages) {
  const SyntheticWorld world = MakeSyntheticWorld(SmallRing());
  Reconstruction model = TrueReconstruction(world);
  for (size_t i = 2; i < model.cam_from_model.size(); ++i) model.cam_from_model[i].reset();
  const auto refused = BuildPoseCovariances(model, world.features, false, context_);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kInvalidArgument);
}

}  // namespace
}  // namespace rotunda::sfm
