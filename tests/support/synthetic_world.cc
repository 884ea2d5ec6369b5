#include "tests/support/synthetic_world.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "sfm/tracks.h"
#include "sfm/view_graph.h"

namespace rotunda::test {
namespace {

constexpr int kWidth_px = 1200, kHeight_px = 1600;
constexpr size_t kMinMatches = 15;
const Eigen::Vector3d kBodyCenter_m(0.0, 0.0, 0.9);
const Eigen::Vector3d kBodyHalfSize_m(0.30, 0.25, 0.55);

Rigid3 LookAt(const Eigen::Vector3d& center, const Eigen::Vector3d& target) {
  Eigen::Matrix3d world_from_cam;
  const Eigen::Vector3d forward = (target - center).normalized();
  const Eigen::Vector3d right = forward.cross(Eigen::Vector3d::UnitZ()).normalized();
  world_from_cam << right, forward.cross(right), forward;
  const Eigen::Quaterniond rotation(Eigen::Matrix3d(world_from_cam.transpose()));
  return {rotation, -(rotation * center)};
}

CameraIntrinsics MakeLens(const SyntheticOptions& options, NormalRandom& random) {
  CameraIntrinsics lens;
  lens.model = options.model;
  lens.width_px = kWidth_px;
  lens.height_px = kHeight_px;
  lens.params.assign(CameraParamCount(options.model), 0.0);
  constexpr double kFocalSpread = 0.01;
  const double focal_px = options.focal_px * (1.0 + kFocalSpread * random.Normal());
  size_t after = 0;
  for (size_t p = 0; p < lens.params.size(); ++p) {
    if (IsFocal(options.model, p)) lens.params[p] = focal_px, after = p + 3;
  }
  lens.params[after - 2] = 0.5 * kWidth_px + 5.0 * random.Normal();
  lens.params[after - 1] = 0.5 * kHeight_px + 5.0 * random.Normal();
  constexpr std::array<double, 4> kDistortion = {-0.06, 0.03, 0.0005, -0.0005};
  for (size_t p = after; p < std::min(lens.params.size(), after + kDistortion.size()); ++p) {
    lens.params[p] = kDistortion[p - after];
  }
  return lens;
}

void PlaceCameras(const SyntheticOptions& options, NormalRandom& random, SyntheticWorld& world) {
  constexpr double kJitter_m = 0.03;
  const auto jitter = [&] {
    return Eigen::Vector3d(kJitter_m * random.Normal(), kJitter_m * random.Normal(),
                           kJitter_m * random.Normal());
  };
  for (size_t column = 0; column < options.columns; ++column) {
    for (size_t row = 0; row < options.rows; ++row) {
      const double azimuth = 2.0 * kPi * static_cast<double>(column) / options.columns;
      const double height = 0.4 + 1.2 * (static_cast<double>(row) + 0.5) / options.rows;
      const Eigen::Vector3d center(options.radius_m * std::cos(azimuth),
                                   options.radius_m * std::sin(azimuth), height);
      world.cam_from_world.push_back(LookAt(center + jitter(), kBodyCenter_m + jitter()));
      if (!options.shared_lens || world.intrinsics.lenses.empty()) {
        world.intrinsics.lenses.push_back(MakeLens(options, random));
      }
      world.intrinsics.lens_of_image.push_back(world.intrinsics.lenses.size() - 1);
    }
  }
  world.intrinsics.known = true;
}

/// Points on an ellipsoid with relief, and its normals.
std::vector<Eigen::Vector3d> PlacePoints(const SyntheticOptions& options, NormalRandom& random,
                                         SyntheticWorld& world) {
  std::vector<Eigen::Vector3d> normals;
  constexpr double kRelief = 0.05;
  for (size_t p = 0; p < options.points; ++p) {
    const Eigen::Vector3d direction =
        Eigen::Vector3d(random.Normal(), random.Normal(), random.Normal()).normalized();
    const double scale = 1.0 + kRelief * random.Normal();
    world.points.push_back(kBodyCenter_m + scale * direction.cwiseProduct(kBodyHalfSize_m));
    normals.push_back(direction.cwiseQuotient(kBodyHalfSize_m).normalized());
  }
  return normals;
}

void ProjectPoints(const SyntheticOptions& options, const std::vector<Eigen::Vector3d>& normals,
                   NormalRandom& random, SyntheticWorld& world) {
  const double min_cosine = std::cos(RadFromDeg(options.max_view_angle_deg));
  for (size_t i = 0; i < world.cam_from_world.size(); ++i) {
    sfm::ImageFeatures image;
    image.width_px = kWidth_px;
    image.height_px = kHeight_px;
    std::vector<size_t> seen;
    const Eigen::Vector3d center = world.cam_from_world[i].OriginInSource();
    for (size_t p = 0; p < world.points.size(); ++p) {
      const double found = random.Uniform();
      const double dx_px = options.noise_px * random.Normal();
      const double dy_px = options.noise_px * random.Normal();
      if ((center - world.points[p]).normalized().dot(normals[p]) < min_cosine) continue;
      if (found >= options.detection_share) continue;
      const CameraIntrinsics& lens = world.intrinsics.of(ImageId(i));
      const auto pixel = lens.Project(world.cam_from_world[i] * world.points[p]);
      if (!pixel || !lens.Contains(*pixel)) continue;
      image.keypoints.push_back({static_cast<float>(pixel->x() + dx_px),
                                 static_cast<float>(pixel->y() + dy_px), kKeypointScale_px, 0.0f});
      seen.push_back(p);
    }
    world.features.images.push_back(std::move(image));
    world.point_of_keypoint.push_back(std::move(seen));
  }
}

std::vector<sfm::Match> TrueMatches(const SyntheticWorld& world, size_t a, size_t b) {
  std::vector<sfm::Match> matches;
  size_t j = 0;
  const auto& of_b = world.point_of_keypoint[b];
  for (size_t i = 0; i < world.point_of_keypoint[a].size(); ++i) {
    while (j < of_b.size() && of_b[j] < world.point_of_keypoint[a][i]) ++j;
    if (j < of_b.size() && of_b[j] == world.point_of_keypoint[a][i]) {
      matches.push_back({KeypointId(i), KeypointId(j)});
    }
  }
  return matches;
}

double MedianAngle_rad(const SyntheticWorld& world, const sfm::TwoView& pair) {
  std::vector<double> angles;
  const Eigen::Vector3d a = world.cam_from_world[pair.pair.first.index()].OriginInSource();
  const Eigen::Vector3d b = world.cam_from_world[pair.pair.second.index()].OriginInSource();
  for (const sfm::Match& match : pair.inliers) {
    const size_t point = world.point_of_keypoint[pair.pair.first.index()][match.first.index()];
    const Eigen::Vector3d& x = world.points[point];
    angles.push_back(std::acos((a - x).normalized().dot((b - x).normalized())));
  }
  std::nth_element(angles.begin(), angles.begin() + angles.size() / 2, angles.end());
  return angles[angles.size() / 2];
}

void MatchPairs(const SyntheticOptions& options, NormalRandom& random, SyntheticWorld& world) {
  for (size_t a = 0; a < world.cam_from_world.size(); ++a) {
    for (size_t b = a + 1; b < world.cam_from_world.size(); ++b) {
      sfm::TwoView pair;
      pair.pair = {ImageId(a), ImageId(b)};
      pair.inliers = TrueMatches(world, a, b);
      if (pair.inliers.size() < kMinMatches) continue;
      pair.second_from_first = world.cam_from_world[b] * world.cam_from_world[a].Inverse();
      pair.second_from_first.translation.normalize();
      pair.median_angle_rad = MedianAngle_rad(world, pair);
      for (sfm::Match& match : pair.inliers) {
        if (random.Uniform() >= options.wrong_match_share) continue;
        match.second = KeypointId(random.Index(world.point_of_keypoint[b].size()));
      }
      world.two_views.pairs.push_back(std::move(pair));
    }
  }
}

void BuildGraphAndTracks(SyntheticWorld& world) {
  world.view_graph = sfm::BuildViewGraph(world.features, world.two_views);
  world.tracks = sfm::BuildTracks(world.features, world.two_views, world.view_graph);
}

}  // namespace

double NormalRandom::Uniform() {
  return static_cast<double>(DeriveSeed(state_, draws_++) >> 11) * 0x1.0p-53;
}

double NormalRandom::Normal() {
  const double radius = std::sqrt(-2.0 * std::log(1.0 - Uniform()));
  return radius * std::cos(2.0 * kPi * Uniform());
}

SyntheticWorld MakeSyntheticWorld(const SyntheticOptions& options) {
  // Scene, lenses and noise are drawn apart, so that one can vary while the others stay.
  NormalRandom scene(DeriveSeed(options.seed, 0));
  NormalRandom noise(DeriveSeed(options.seed, 1));
  NormalRandom mismatch(DeriveSeed(options.seed, 2));
  SyntheticWorld world;
  PlaceCameras(options, scene, world);
  const std::vector<Eigen::Vector3d> normals = PlacePoints(options, scene, world);
  ProjectPoints(options, normals, noise, world);
  MatchPairs(options, mismatch, world);
  BuildGraphAndTracks(world);
  return world;
}

void Disconnect(SyntheticWorld& world, const std::vector<ImageId>& first) {
  const auto inside = [&](ImageId image) {
    return std::find(first.begin(), first.end(), image) != first.end();
  };
  std::erase_if(world.two_views.pairs, [&](const sfm::TwoView& pair) {
    return inside(pair.pair.first) != inside(pair.pair.second);
  });
  BuildGraphAndTracks(world);
}

sfm::Reconstruction TrueReconstruction(const SyntheticWorld& world) {
  sfm::Reconstruction truth;
  truth.intrinsics = world.intrinsics;
  for (const Rigid3& pose : world.cam_from_world) truth.cam_from_model.push_back(pose);
  truth.points.resize(world.points.size());
  for (size_t i = 0; i < world.point_of_keypoint.size(); ++i) {
    for (size_t k = 0; k < world.point_of_keypoint[i].size(); ++k) {
      truth.points[world.point_of_keypoint[i][k]].observations.push_back(
          {ImageId(i), KeypointId(k)});
    }
  }
  for (size_t p = 0; p < truth.points.size(); ++p) truth.points[p].position = world.points[p];
  std::erase_if(truth.points, [](const sfm::Point3& p) { return p.observations.size() < 2; });
  return truth;
}

}  // namespace rotunda::test
