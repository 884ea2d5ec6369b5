#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <random>
#include <vector>

#include "sfm/core/camera.h"
#include "sfm/core/rigid3.h"
#include "sfm/features.h"
#include "sfm/intrinsics.h"
#include "sfm/matching.h"

namespace rotunda::test {

/// Uniform in [low, high): the same on every standard library.
inline double Uniform(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random() >> 11) * 0x1.0p-53;
}

/// Standard normal (Box & Muller).
inline double Normal(std::mt19937_64& random) {
  const double radius = std::sqrt(-2.0 * std::log(1.0 - Uniform(random, 0, 1)));
  return radius * std::cos(2.0 * kPi * Uniform(random, 0, 1));
}

enum class SceneShape {
  kVolume,        // points between 3 and 7 units in front
  kNearlyPlanar,  // a plane with relief of 0.4 % of its distance
  kPlane,
  kRotationOnly,  // no baseline
};

struct SceneOptions {
  SceneShape shape = SceneShape::kVolume;
  size_t points = 200;
  double noise_px = 0;
  double outlier_share = 0;  // of the points: their second keypoint is anywhere in the picture
  uint64_t seed = 0;
};

/// Two pictures of random points, with the truth beside them.
struct TwoViewScene {
  Rigid3 second_from_first;  // |translation| = 1, or 0
  sfm::Intrinsics intrinsics;
  sfm::Features features;
  sfm::Matches matches;
  std::vector<bool> is_outlier;
};

/// Size, focal length and distortion of a rig camera.
inline CameraIntrinsics SceneLens() {
  return {CameraModel::kOpencv, 1200, 1600, {1500, 1510, 610, 790, -0.12, 0.05, 1e-3, -5e-4}};
}

inline TwoViewScene MakeTwoViewScene(const SceneOptions& options) {
  std::mt19937_64 random(options.seed);
  const auto symmetric = [&](double bound) { return Uniform(random, -bound, bound); };
  TwoViewScene scene;
  scene.intrinsics = {{SceneLens(), SceneLens()}, {0, 1}, true};
  // The second camera stands aside by 15 to 35 degrees and looks at the first one's scene.
  const double turn = RadFromDeg(Uniform(random, 15, 35)) * (random() % 2 == 0 ? 1 : -1);
  const Eigen::Vector3d axis = Eigen::Vector3d(symmetric(0.3), 1.0, symmetric(0.3)).normalized();
  const Eigen::Quaterniond rotation(Eigen::AngleAxisd(turn, axis));
  const Eigen::Vector3d middle(0, 0, 5);
  const bool rotation_only = options.shape == SceneShape::kRotationOnly;
  scene.second_from_first.rotation =
      rotation_only ? Eigen::Quaterniond(Eigen::AngleAxisd(0.2 * turn, axis)) : rotation;
  const Eigen::Vector3d translation = middle - rotation * middle;
  const Eigen::Vector3d plane_slope(symmetric(0.4), symmetric(0.4), 0);

  sfm::ImageFeatures first, second;
  first.width_px = second.width_px = SceneLens().width_px;
  first.height_px = second.height_px = SceneLens().height_px;
  sfm::PairMatches pair{{ImageId(0), ImageId(1)}, {}};
  while (first.keypoints.size() < options.points) {
    Eigen::Vector3d x(symmetric(2), symmetric(2.5), 5);
    if (options.shape == SceneShape::kVolume || rotation_only) x.z() += symmetric(2);
    if (options.shape == SceneShape::kPlane || options.shape == SceneShape::kNearlyPlanar) {
      x.z() += plane_slope.dot(x);
    }
    if (options.shape == SceneShape::kNearlyPlanar) x.z() += symmetric(0.02);
    const Eigen::Vector3d in_second = scene.second_from_first.rotation * x +
                                      (rotation_only ? Eigen::Vector3d::Zero() : translation);
    const auto a = SceneLens().Project(x), b = SceneLens().Project(in_second);
    if (!a || !b || !SceneLens().Contains(*a) || !SceneLens().Contains(*b)) continue;
    const bool outlier = Uniform(random, 0, 1) < options.outlier_share;
    const Eigen::Vector2d shift_a(Normal(random), Normal(random));
    const Eigen::Vector2d shift_b(Normal(random), Normal(random));
    const Eigen::Vector2d anywhere(Uniform(random, 0, second.width_px),
                                   Uniform(random, 0, second.height_px));
    const Eigen::Vector2d at_a = *a + options.noise_px * shift_a;
    const Eigen::Vector2d at_b =
        outlier ? anywhere : Eigen::Vector2d(*b + options.noise_px * shift_b);
    const size_t id = first.keypoints.size();
    first.keypoints.push_back({float(at_a.x()), float(at_a.y()), 2.0F, 0.0F});
    second.keypoints.push_back({float(at_b.x()), float(at_b.y()), 2.0F, 0.0F});
    pair.matches.push_back({KeypointId(id), KeypointId(id)});
    scene.is_outlier.push_back(outlier);
  }
  scene.second_from_first.translation =
      rotation_only ? Eigen::Vector3d::Zero() : translation.normalized();
  scene.features.images = {first, second};
  scene.matches.pairs = {pair};
  return scene;
}

}  // namespace rotunda::test
