#include "sfm/segment_model.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include "sfm/bundle_adjustment.h"
#include "sfm/core/statistics.h"
#include "sfm/triangulation.h"

namespace rotunda::sfm {
namespace {

constexpr uint32_t kNoPoint = UINT32_MAX;
/// All poses are adjusted when the model has grown by this factor: they are only compared at
/// thresholds of many degrees.
constexpr double kAdjustmentGrowth = 1.2;
/// Share of the pair's points that must survive the first adjustment.
constexpr double kMinInitialShare = 0.5;

BundleAdjustmentOptions Adjustment() {
  BundleAdjustmentOptions options;
  options.loss = Loss::kSoftL1;
  options.max_iterations = 15;
  options.function_tolerance = 1e-3;
  return options;
}

}  // namespace

SegmentModel::SegmentModel(const SegmentModelInput& input, const SegmentModelOptions& options,
                           RunContext& context)
    : input_(input), options_(options), context_(context) {
  const Features& features = input.input.features;
  model_.intrinsics = input.input.intrinsics;
  model_.cam_from_model.resize(features.images.size());
  for (const ImageFeatures& image : features.images) {
    point_of_.emplace_back(image.keypoints.size(), kNoPoint);
  }
}

double SegmentModel::Error_px(const Observation& o, const Eigen::Vector3d& position) const {
  const Eigen::Vector3d x = *model_.cam_from_model[o.image.index()] * position;
  const Eigen::Vector2d& ray = RayOf(o);
  if (!(x.z() > 0) || !ray.allFinite()) return std::numeric_limits<double>::infinity();
  return FocalOf(o.image) * (x.hnormalized() - ray).norm();
}

double SegmentModel::Angle_rad(const Point3& point) const {
  std::vector<Eigen::Vector3d> centers;
  for (const Observation& o : point.observations) {
    centers.push_back(model_.cam_from_model[o.image.index()]->OriginInSource());
  }
  return LargestAngle_rad(centers, point.position);
}

void SegmentModel::Add(ImageId image, const Rigid3& cam_from_model) {
  model_.cam_from_model[image.index()] = cam_from_model;
  registered_.push_back(image);
}

Status SegmentModel::Initialize(const TwoView& pair, size_t min_points, double min_angle_rad) {
  Add(pair.pair.first, Rigid3{});
  Add(pair.pair.second, pair.second_from_first);
  TriangulateNew(pair.pair.second);
  const size_t triangulated = model_.points.size();
  ROTUNDA_RETURN_IF_ERROR(Adjust({pair.pair.second}));
  std::vector<double> angles;
  for (const Point3& point : model_.points) {
    if (!point.observations.empty()) angles.push_back(Angle_rad(point));
  }
  if (angles.size() < min_points ||
      static_cast<double>(angles.size()) < kMinInitialShare * static_cast<double>(triangulated)) {
    return Error{ErrorCode::kFailed,
                 std::to_string(angles.size()) + " of " + std::to_string(triangulated) +
                     " points hold after adjustment",
                 "initial pair"};
  }
  const double median_rad = Median(std::move(angles));
  if (median_rad < min_angle_rad) {
    return Error{ErrorCode::kFailed,
                 "median angle " + std::to_string(DegFromRad(median_rad)) + " deg after adjustment",
                 "initial pair"};
  }
  return {};
}

Support SegmentModel::SupportOf(ImageId image, PointKind kind) const {
  std::vector<std::pair<KeypointId, uint32_t>> votes;
  for (const SegmentNeighbour& neighbour : input_.neighbours[image.index()]) {
    if (!IsRegistered(neighbour.image)) continue;
    for (const SegmentMatch& match : neighbour.matches) {
      const uint32_t point = PointOf({neighbour.image, match.other});
      if (match.kind == kind && point != kNoPoint) votes.emplace_back(match.own, point);
    }
  }
  std::sort(votes.begin(), votes.end());
  Support support;
  support.matches.focal_px = FocalOf(image);
  size_t most = 0;
  for (size_t begin = 0, end = 0; begin < votes.size(); begin = end) {
    while (end < votes.size() && votes[end] == votes[begin]) ++end;
    const auto [keypoint, point] = votes[begin];
    const bool first = support.keypoints.empty() || support.keypoints.back() != keypoint;
    if (!first && end - begin <= most) continue;
    most = end - begin;
    const Eigen::Vector2d& ray = RayOf({image, keypoint});
    if (!ray.allFinite()) continue;
    if (first) {
      support.keypoints.push_back(keypoint);
      support.points.push_back(point);
      support.matches.normalized.push_back(ray);
      support.matches.points.push_back(model_.points[point].position);
    } else {
      support.points.back() = point;
      support.matches.points.back() = model_.points[point].position;
    }
  }
  return support;
}

Result<AbsolutePose> SegmentModel::EstimatePose(const Support& support, size_t min_inliers,
                                                uint64_t seed) const {
  AbsolutePoseOptions options;
  options.max_error_px = options_.max_pnp_error_px;
  options.min_inlier_ratio = options_.min_pnp_inlier_ratio;
  options.seed = seed;
  ROTUNDA_ASSIGN_OR_RETURN(AbsolutePose pose, EstimateAbsolutePose(support.matches, options));
  const auto needed = std::max(
      min_inliers,
      static_cast<size_t>(options_.min_pnp_inlier_ratio * static_cast<double>(support.size())));
  if (pose.inliers.size() >= needed) return pose;
  return Error{ErrorCode::kFailed,
               std::to_string(pose.inliers.size()) + " of " + std::to_string(support.size()) +
                   " points fit one pose, " + std::to_string(needed) + " are needed",
               ""};
}

/// In front, in the picture, seen by enough others, and by one of them from near the direction.
bool SegmentModel::MustBeSeen(const Point3& point, ImageId image,
                              const Rigid3& cam_from_model) const {
  if (point.observations.size() < options_.min_expected_images) return false;
  const Eigen::Vector3d x = cam_from_model * point.position;
  if (!(x.z() > 0)) return false;
  const CameraIntrinsics& lens = model_.intrinsics.of(image);
  const std::optional<Eigen::Vector2d> pixel = lens.Project(x);
  if (!pixel || !lens.Contains(*pixel)) return false;
  const double least_cosine = std::cos(options_.max_expected_angle_rad);
  const Eigen::Vector3d direction = cam_from_model.OriginInSource() - point.position;
  return std::any_of(
      point.observations.begin(), point.observations.end(), [&](const Observation& o) {
        const Eigen::Vector3d other = PoseOf(o.image).OriginInSource() - point.position;
        return direction.dot(other) >= least_cosine * direction.norm() * other.norm();
      });
}

ExpectedPoints SegmentModel::ExpectedAt(ImageId image, const Rigid3& cam_from_model) const {
  std::vector<bool> named(model_.points.size(), false);
  for (const PointKind kind : {PointKind::kPrimary, PointKind::kAuxiliary}) {
    for (const size_t point : SupportOf(image, kind).points) named[point] = true;
  }
  ExpectedPoints expected;
  for (size_t p = 0; p < model_.points.size(); ++p) {
    if (!MustBeSeen(model_.points[p], image, cam_from_model)) continue;
    ++expected.all;
    expected.met += named[p];
  }
  return expected;
}

Rigid3 SegmentModel::RefinedPose(ImageId image, const Rigid3& cam_from_model) const {
  AbsolutePoseInput all = SupportOf(image, PointKind::kPrimary).matches;
  const Support auxiliary = SupportOf(image, PointKind::kAuxiliary);
  all.normalized.insert(all.normalized.end(), auxiliary.matches.normalized.begin(),
                        auxiliary.matches.normalized.end());
  all.points.insert(all.points.end(), auxiliary.matches.points.begin(),
                    auxiliary.matches.points.end());
  AbsolutePose start = {cam_from_model, 1.0, {}};
  for (size_t i = 0; i < all.points.size(); ++i) {
    const Eigen::Vector3d x = cam_from_model * all.points[i];
    if (!(x.z() > 0)) continue;
    const double error_px = all.focal_px * (x.hnormalized() - all.normalized[i]).norm();
    if (error_px < options_.max_pnp_error_px) start.inliers.push_back(i);
  }
  return RefineAbsolutePose(all, start, options_.max_reprojection_px, false).cam_from_model;
}

void SegmentModel::Extend(ImageId image, PointKind kind) {
  const Support support = SupportOf(image, kind);
  for (size_t i = 0; i < support.size(); ++i) {
    const Observation own = {image, support.keypoints[i]};
    Point3& point = model_.points[support.points[i]];
    if (PointOf(own) != kNoPoint || !(Error_px(own, point.position) < options_.max_reprojection_px))
      continue;
    const auto place =
        std::lower_bound(point.observations.begin(), point.observations.end(), image,
                         [](const Observation& o, ImageId id) { return o.image < id; });
    if (place != point.observations.end() && place->image == image) continue;
    point.observations.insert(place, own);
    PointOf(own) = static_cast<uint32_t>(support.points[i]);
  }
}

/// Matches with registered images at both of whose ends there is no point yet, by own keypoint.
std::vector<SegmentModel::Sight> SegmentModel::FreeSights(ImageId image) const {
  std::vector<Sight> sights;
  for (const SegmentNeighbour& neighbour : input_.neighbours[image.index()]) {
    if (!IsRegistered(neighbour.image)) continue;
    for (const SegmentMatch& match : neighbour.matches) {
      const Observation own = {image, match.own}, other = {neighbour.image, match.other};
      if (PointOf(own) != kNoPoint || PointOf(other) != kNoPoint) continue;
      if (!RayOf(own).allFinite() || !RayOf(other).allFinite()) continue;
      sights.push_back({match.own, other, match.kind});
    }
  }
  std::sort(sights.begin(), sights.end());
  return sights;
}

void SegmentModel::TriangulateNew(ImageId image) {
  const std::vector<Sight> sights = FreeSights(image);
  for (size_t begin = 0, end = 0; begin < sights.size(); begin = end) {
    while (end < sights.size() && sights[end].own == sights[begin].own) ++end;
    TriangulatePoint(image, std::span(sights).subspan(begin, end - begin));
  }
}

void SegmentModel::TriangulatePoint(ImageId image, std::span<const Sight> sights) {
  std::vector<Observation> seen = {{image, sights.front().own}};
  for (const Sight& sight : sights) {
    // Another keypoint of this image may have taken it in the meantime.
    if (PointOf(sight.other) == kNoPoint) seen.push_back(sight.other);
  }
  std::vector<TriangulationView> views;
  for (const Observation& o : seen) {
    views.push_back(
        MakeTriangulationView(*model_.cam_from_model[o.image.index()], RayOf(o), FocalOf(o.image)));
  }
  const auto found =
      Triangulate(views, {options_.max_reprojection_px, options_.min_triangulation_angle_rad});
  if (!found || found->inliers.front() != 0) return;
  Point3 point;
  point.position = found->position;
  for (const size_t i : found->inliers) {
    PointOf(seen[i]) = static_cast<uint32_t>(model_.points.size());
    point.observations.push_back(seen[i]);
  }
  std::sort(point.observations.begin(), point.observations.end());
  model_.points.push_back(std::move(point));
}

void SegmentModel::Register(ImageId image, const Rigid3& cam_from_model) {
  Add(image, cam_from_model);
  Extend(image, PointKind::kPrimary);
  Extend(image, PointKind::kAuxiliary);
  TriangulateNew(image);
  const auto grown = static_cast<double>(registered_.size());
  if (grown < kAdjustmentGrowth * static_cast<double>(images_at_adjustment_)) return;
  // When the solver gives up the model stays as it was, which serves as well.
  static_cast<void>(Adjust(registered_));
}

Status SegmentModel::Adjust(const std::vector<ImageId>& free_images) {
  images_at_adjustment_ = registered_.size();
  const auto report =
      AdjustBundle(model_, input_.input.features, free_images, Adjustment(), context_);
  if (!report) return report.error();
  Filter();
  return {};
}

void SegmentModel::Filter() {
  for (Point3& point : model_.points) {
    std::erase_if(point.observations, [&](const Observation& o) {
      if (Error_px(o, point.position) < options_.max_reprojection_px) return false;
      PointOf(o) = kNoPoint;
      return true;
    });
    if (point.observations.empty()) continue;
    if (point.observations.size() >= 2 &&
        Angle_rad(point) >= options_.min_triangulation_angle_rad) {
      continue;
    }
    for (const Observation& o : point.observations) PointOf(o) = kNoPoint;
    point.observations.clear();
  }
}

}  // namespace rotunda::sfm
