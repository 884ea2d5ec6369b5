#include "tests/support/look_alike_world.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "sfm/tracks.h"
#include "sfm/view_graph.h"

namespace rotunda::test {
namespace {

constexpr size_t kMinMatches = 15;
constexpr double kBodyRadius_m = 0.25, kHeadRadius_m = 0.12, kHeadHeight_m = 1.45;
constexpr double kPrintBottom_m = 0.5, kPrintTop_m = 1.25;
constexpr double kMaxViewAngle_deg = 70.0;
constexpr double kDetectionShare = 0.85;
const Eigen::Quaterniond kHalfTurn(Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitZ()));

struct SurfacePoint {
  Eigen::Vector3d position;
  Eigen::Vector3d normal;
};

std::vector<SurfacePoint> PlacePoints(const LookAlikeOptions& options, NormalRandom& random) {
  std::vector<SurfacePoint> points;
  for (size_t p = 0; p < options.print_points; ++p) {
    const double azimuth = RadFromDeg(options.print_half_width_deg) * (2 * random.Uniform() - 1);
    const double height = kPrintBottom_m + (kPrintTop_m - kPrintBottom_m) * random.Uniform();
    const double radius = kBodyRadius_m * (1.0 + 0.1 * random.Normal());
    const Eigen::Vector3d normal(std::cos(azimuth), std::sin(azimuth), 0.0);
    points.push_back({radius * normal + height * Eigen::Vector3d::UnitZ(), normal});
  }
  for (size_t p = 0; p < options.print_points; ++p) {
    points.push_back({kHalfTurn * points[p].position, kHalfTurn * points[p].normal});
  }
  for (size_t p = 0; p < options.head_points; ++p) {
    const Eigen::Vector3d normal =
        Eigen::Vector3d(random.Normal(), random.Normal(), random.Normal()).normalized();
    const double radius = kHeadRadius_m * (1.0 + 0.1 * random.Normal());
    points.push_back({kHeadHeight_m * Eigen::Vector3d::UnitZ() + radius * normal, normal});
  }
  return points;
}

void Project(const std::vector<SurfacePoint>& points, double noise_px, NormalRandom& random,
             SyntheticWorld& world) {
  const double min_cosine = std::cos(RadFromDeg(kMaxViewAngle_deg));
  for (size_t i = 0; i < world.cam_from_world.size(); ++i) {
    sfm::ImageFeatures& image = world.features.images[i];
    image.keypoints.clear();
    std::vector<size_t>& seen = world.point_of_keypoint[i];
    seen.clear();
    const CameraIntrinsics& lens = world.intrinsics.of(ImageId(i));
    const Eigen::Vector3d center = world.cam_from_world[i].OriginInSource();
    for (size_t p = 0; p < points.size(); ++p) {
      const auto& [position, normal] = points[p];
      if ((center - position).normalized().dot(normal) < min_cosine) continue;
      const auto pixel = lens.Project(world.cam_from_world[i] * position);
      if (!pixel || !lens.Contains(*pixel) || random.Uniform() >= kDetectionShare) continue;
      const double x_px = pixel->x() + noise_px * random.Normal();
      const double y_px = pixel->y() + noise_px * random.Normal();
      image.keypoints.push_back(
          {static_cast<float>(x_px), static_cast<float>(y_px), kKeypointScale_px, 0.0f});
      seen.push_back(p);
    }
  }
}

/// The look-alike on the other side; the point itself when there is none.
size_t LookAlike(size_t point, size_t print_points) {
  if (point < print_points) return point + print_points;
  return point < 2 * print_points ? point - print_points : point;
}

double MedianAngle_rad(const SyntheticWorld& world, const sfm::TwoView& pair, bool crossed) {
  std::vector<double> angles;
  const Eigen::Vector3d a = world.cam_from_world[pair.pair.first.index()].OriginInSource();
  Eigen::Vector3d b = world.cam_from_world[pair.pair.second.index()].OriginInSource();
  if (crossed) b = kHalfTurn * b;
  for (const sfm::Match& match : pair.inliers) {
    const Eigen::Vector3d& x =
        world.points[world.point_of_keypoint[pair.pair.first.index()][match.first.index()]];
    angles.push_back(std::acos((a - x).normalized().dot((b - x).normalized())));
  }
  std::nth_element(angles.begin(), angles.begin() + angles.size() / 2, angles.end());
  return angles[angles.size() / 2];
}

/// Angle under which the body sees the two cameras, the second one after half a turn if `crossed`.
double ViewAngle_deg(const SyntheticWorld& world, const ImagePair& images, bool crossed) {
  const Eigen::Vector3d middle(0, 0, 0.5 * (kPrintBottom_m + kPrintTop_m));
  const Eigen::Vector3d a = world.cam_from_world[images.first.index()].OriginInSource() - middle;
  Eigen::Vector3d b = world.cam_from_world[images.second.index()].OriginInSource() - middle;
  if (crossed) b = kHalfTurn * b;
  return DegFromRad(std::atan2(a.cross(b).norm(), a.dot(b)));
}

void MatchPair(const LookAlikeOptions& options, ImagePair images, NormalRandom& random,
               LookAlikeWorld& result) {
  SyntheticWorld& world = result.world;
  const auto& of_first = world.point_of_keypoint[images.first.index()];
  std::map<size_t, KeypointId> of_second;
  for (size_t k = 0; k < world.point_of_keypoint[images.second.index()].size(); ++k) {
    of_second[world.point_of_keypoint[images.second.index()][k]] = KeypointId(k);
  }
  const auto share = [&](bool crossed) {
    const double angle = ViewAngle_deg(world, images, crossed) / options.match_range_deg;
    return (crossed ? options.crossed_share : 1.0) * std::exp(-0.5 * angle * angle);
  };
  const double straight_share = share(false), crossed_share = share(true);
  std::vector<sfm::Match> straight, crossing;
  for (size_t k = 0; k < of_first.size(); ++k) {
    const size_t other = LookAlike(of_first[k], options.print_points);
    if (const auto same = of_second.find(of_first[k]); same != of_second.end()) {
      if (straight_share == 1 || random.Uniform() < straight_share) {
        straight.push_back({KeypointId(k), same->second});
      }
    } else if (of_second.count(other) && random.Uniform() < crossed_share) {
      crossing.push_back({KeypointId(k), of_second[other]});
    }
  }
  const bool crossed = crossing.size() > straight.size();
  sfm::TwoView pair;
  pair.pair = images;
  pair.inliers = crossed ? crossing : straight;
  if (pair.inliers.size() < kMinMatches) return;
  Rigid3 second_from_world = world.cam_from_world[images.second.index()];
  if (crossed) second_from_world = second_from_world * Rigid3{kHalfTurn, Eigen::Vector3d::Zero()};
  pair.second_from_first = second_from_world * world.cam_from_world[images.first.index()].Inverse();
  pair.second_from_first.translation.normalize();
  pair.median_angle_rad = MedianAngle_rad(world, pair, crossed);
  result.crossed_pairs += crossed;
  world.two_views.pairs.push_back(std::move(pair));
}

void LabelSegments(const LookAlikeOptions& options, LookAlikeWorld& result) {
  const SyntheticWorld& world = result.world;
  sfm::Segments& segments = result.segments;
  segments.segments.resize(2);
  segments.segments[kPrintSegment].ambiguous = true;
  constexpr size_t kMinImageTracks = 30;
  for (size_t i = 0; i < world.point_of_keypoint.size(); ++i) {
    std::array<size_t, 2> seen = {0, 0};
    segments.of_keypoint.emplace_back();
    for (const size_t point : world.point_of_keypoint[i]) {
      const uint32_t label = point < 2 * options.print_points ? kPrintSegment : kHeadSegment;
      segments.of_keypoint[i].push_back(label);
      ++seen[label];
    }
    for (size_t s = 0; s < seen.size(); ++s) {
      if (seen[s] >= kMinImageTracks) segments.segments[s].images.push_back(ImageId(i));
    }
  }
  for (const sfm::Track& track : world.tracks.tracks) {
    const Observation& first = track.observations.front();
    segments.of_track.push_back(segments.of_keypoint[first.image.index()][first.keypoint.index()]);
    ++segments.segments[*segments.of_track.back()].tracks;
  }
}

}  // namespace

LookAlikeWorld MakeLookAlikeWorld(const LookAlikeOptions& options) {
  SyntheticOptions cameras;
  cameras.columns = options.columns;
  cameras.rows = options.rows;
  cameras.points = 1;
  cameras.seed = options.seed;
  LookAlikeWorld result{MakeSyntheticWorld(cameras), {}, {}, 0};
  SyntheticWorld& world = result.world;
  world.two_views.pairs.clear();
  NormalRandom scene(DeriveSeed(options.seed, 10)), noise(DeriveSeed(options.seed, 11)),
      crossing(DeriveSeed(options.seed, 12));
  const std::vector<SurfacePoint> points = PlacePoints(options, scene);
  world.points.clear();
  for (const SurfacePoint& point : points) world.points.push_back(point.position);
  Project(points, options.noise_px, noise, world);
  for (size_t a = 0; a < world.cam_from_world.size(); ++a) {
    const Eigen::Vector3d center = world.cam_from_world[a].OriginInSource();
    result.azimuth_rad.push_back(std::atan2(center.y(), center.x()));
    for (size_t b = a + 1; b < world.cam_from_world.size(); ++b) {
      MatchPair(options, {ImageId(a), ImageId(b)}, crossing, result);
    }
  }
  world.view_graph = sfm::BuildViewGraph(world.features, world.two_views);
  world.tracks = sfm::BuildTracks(world.features, world.two_views, world.view_graph);
  LabelSegments(options, result);
  return result;
}

LookAlikeOptions FoldingOptions() {
  LookAlikeOptions options;
  options.columns = 15;
  options.print_half_width_deg = 90.0;
  options.crossed_share = 1.0;
  options.match_range_deg = 20.0;
  return options;
}

bool IsCrossed(const SyntheticWorld& world, const sfm::TwoView& view) {
  const Eigen::Quaterniond truth = (world.cam_from_world[view.pair.second.index()] *
                                    world.cam_from_world[view.pair.first.index()].Inverse())
                                       .rotation;
  return RotationAngle_rad(truth, view.second_from_first.rotation) > 0.5 * kPi;
}

}  // namespace rotunda::test
