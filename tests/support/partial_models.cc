#include "tests/support/partial_models.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "sfm/bundle_adjustment.h"
#include "sfm/view_graph.h"

namespace rotunda::test {

std::vector<ImageId> Columns(size_t first, size_t columns) {
  std::vector<ImageId> images;
  for (size_t k = 0; k < 2 * columns; ++k) images.push_back(ImageId((2 * first + k) % kRingImages));
  return images;
}

sfm::Reconstruction MakePartialModel(const SyntheticWorld& world,
                                     const std::vector<ImageId>& images, uint64_t seed,
                                     RunContext& context) {
  sfm::Reconstruction model = TrueReconstruction(world);
  const auto inside = [&](ImageId image) {
    return std::find(images.begin(), images.end(), image) != images.end();
  };
  for (size_t i = 0; i < model.cam_from_model.size(); ++i) {
    if (!inside(ImageId(i))) model.cam_from_model[i].reset();
  }
  for (sfm::Point3& point : model.points) {
    std::erase_if(point.observations, [&](const Observation& o) { return !inside(o.image); });
  }
  std::erase_if(model.points, [](const sfm::Point3& p) { return p.observations.size() < 2; });
  (void)AdjustBundle(model, world.features, images, {}, context);
  NormalRandom random(seed);
  const double scale = std::exp(std::log(5.0) * (2.0 * random.Uniform() - 1.0));
  const Eigen::Quaterniond rotation(random.Normal(), random.Normal(), random.Normal(),
                                    random.Normal());
  const Eigen::Vector3d translation_m(random.Normal(), random.Normal(), random.Normal());
  return Transformed(model, {scale, rotation.normalized(), 3.0 * translation_m});
}

void EstimateTwoViews(SyntheticWorld& world, RunContext& context) {
  sfm::Matches matches;
  for (const sfm::TwoView& pair : world.two_views.pairs) {
    matches.pairs.push_back({pair.pair, pair.inliers});
  }
  auto estimated = sfm::BuildTwoViews(world.features, world.intrinsics, matches, {}, context);
  world.two_views = estimated ? *std::move(estimated) : sfm::TwoViews{};
  world.view_graph = BuildViewGraph(world.features, world.two_views);
}

void KeepPairs(SyntheticWorld& world, const std::function<bool(const ImagePair&)>& keep) {
  std::erase_if(world.two_views.pairs, [&](const sfm::TwoView& pair) { return !keep(pair.pair); });
  world.view_graph = BuildViewGraph(world.features, world.two_views);
}

bool AddLookAlikePair(SyntheticWorld& world, ImageId first, ImageId second) {
  constexpr double kNear_px = 40.0;
  constexpr double kPrintCenter_m = 0.9, kPrintHeight_m = 0.36;
  constexpr size_t kMinMatches = 15;
  const Rigid3 half_turn = {Eigen::Quaterniond(Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitZ())),
                            Eigen::Vector3d::Zero()};
  const Rigid3 second_from_world = world.cam_from_world[second.index()] * half_turn;
  sfm::TwoView pair;
  pair.pair = {first, second};
  pair.second_from_first = second_from_world * world.cam_from_world[first.index()].Inverse();
  pair.second_from_first.translation.normalize();
  const auto& keypoints = world.features.image(second).keypoints;
  for (size_t k = 0; k < world.point_of_keypoint[first.index()].size(); ++k) {
    const Eigen::Vector3d& x = world.points[world.point_of_keypoint[first.index()][k]];
    const auto pixel = world.intrinsics.of(second).Project(second_from_world * x);
    if (!pixel || std::abs(x.z() - kPrintCenter_m) > 0.5 * kPrintHeight_m) continue;
    const auto distance_px = [&](const sfm::Keypoint& keypoint) {
      return std::hypot(keypoint.x_px - pixel->x(), keypoint.y_px - pixel->y());
    };
    const auto nearest = std::min_element(keypoints.begin(), keypoints.end(),
                                          [&](const sfm::Keypoint& a, const sfm::Keypoint& b) {
                                            return distance_px(a) < distance_px(b);
                                          });
    if (nearest == keypoints.end() || distance_px(*nearest) > kNear_px) continue;
    pair.inliers.push_back(
        {KeypointId(k), KeypointId(static_cast<size_t>(nearest - keypoints.begin()))});
  }
  if (pair.inliers.size() < kMinMatches) return false;
  std::erase_if(world.two_views.pairs,
                [&](const sfm::TwoView& old) { return old.pair == pair.pair; });
  const auto place = std::lower_bound(
      world.two_views.pairs.begin(), world.two_views.pairs.end(), pair,
      [](const sfm::TwoView& a, const sfm::TwoView& b) { return a.pair < b.pair; });
  world.two_views.pairs.insert(place, std::move(pair));
  return true;
}

}  // namespace rotunda::test
