#include "sfm/model_builder.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "sfm/core/statistics.h"
#include "sfm/triangulation.h"

namespace rotunda::sfm {
namespace {

constexpr size_t kNoPoint = SIZE_MAX;
/// Focal lengths tried for a lens that nothing is known of, in assumed ones.
constexpr std::array<double, 8> kFocalFactors = {1.0, 0.5, 0.63, 0.79, 1.26, 1.59, 2.0, 2.5};
/// Share of an initial pair's tracks that must survive as points.
constexpr double kMinInitialShare = 0.5;

}  // namespace

ModelBuilder::ModelBuilder(const IncrementalInput& input, const IncrementalOptions& options,
                           const std::vector<bool>& active, RunContext& context)
    : input_(input), options_(options), context_(context), active_(active) {
  const size_t images = input.features.images.size();
  tracks_of_image_.resize(images);
  for (size_t t = 0; t < input.tracks.tracks.size(); ++t) {
    for (const Observation& o : input.tracks.tracks[t].observations) {
      tracks_of_image_[o.image.index()].push_back({TrackId(t), o.keypoint});
    }
  }
  model_.intrinsics = input.intrinsics;
  model_.cam_from_model.resize(images);
  point_of_track_.assign(input.tracks.tracks.size(), kNoPoint);
  visible_.assign(images, 0);
  lens_refined_.assign(model_.intrinsics.lenses.size(), false);
  normalized_.resize(images);
  context_.threads.ParallelFor(images, [&](size_t i) { NormalizeKeypoints(ImageId(i)); });
}

double ModelBuilder::FocalOf(ImageId image) const {
  return model_.intrinsics.of(image).MeanFocal_px();
}

void ModelBuilder::NormalizeKeypoints(ImageId image) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<Keypoint>& keypoints = input_.features.image(image).keypoints;
  std::vector<Eigen::Vector2d>& normalized = normalized_[image.index()];
  normalized.assign(keypoints.size(), Eigen::Vector2d(nan, nan));
  const CameraIntrinsics& lens = model_.intrinsics.of(image);
  for (const ImageTrack& entry : tracks_of_image_[image.index()]) {
    const Keypoint& keypoint = keypoints[entry.keypoint.index()];
    const auto ray = lens.NormalizedFromPixel({keypoint.x_px, keypoint.y_px});
    if (ray) normalized[entry.keypoint.index()] = *ray;
  }
}

void ModelBuilder::AddRegistered(ImageId image, const Rigid3& cam_from_model) {
  model_.cam_from_model[image.index()] = cam_from_model;
  registered_.push_back(image);
}

Status ModelBuilder::Initialize(const TwoView& pair, size_t min_points, double min_angle_rad) {
  AddRegistered(pair.pair.first, Rigid3{});
  AddRegistered(pair.pair.second, pair.second_from_first);
  const std::vector<ImageId> both = {pair.pair.first, pair.pair.second};
  TriangulateFor(both);
  const size_t triangulated = live_points_;
  const auto failed = [&](const std::string& what) {
    return Error{ErrorCode::kFailed, what, "initial pair"};
  };
  if (triangulated < min_points) {
    return failed(std::to_string(triangulated) + " points, " + std::to_string(min_points) +
                  " are needed");
  }
  BundleAdjustmentOptions adjustment;
  adjustment.loss = Loss::kSoftL1;
  const auto report =
      AdjustBundle(model_, input_.features, {pair.pair.second}, adjustment, context_);
  if (!report) return report.error();
  Filter(options_.max_reprojection_px, std::numeric_limits<double>::infinity());
  size_t common = 0;
  for (const ImageTrack& entry : tracks_of_image_[pair.pair.first.index()]) {
    common += active_[entry.track.index()] && UsableObservations(entry.track).size() == 2;
  }
  std::vector<double> angles;
  const std::array<Eigen::Vector3d, 2> centers = {
      model_.cam_from_model[both[0].index()]->OriginInSource(),
      model_.cam_from_model[both[1].index()]->OriginInSource()};
  for (const Point3& point : model_.points) {
    angles.push_back(LargestAngle_rad(centers, point.position));
  }
  if (live_points_ < min_points || live_points_ < kMinInitialShare * common) {
    return failed(std::to_string(live_points_) + " of " + std::to_string(common) +
                  " common tracks hold after adjustment");
  }
  if (Median(angles) < min_angle_rad) {
    return failed("median angle " + std::to_string(DegFromRad(Median(angles))) +
                  " deg after adjustment, " + std::to_string(DegFromRad(min_angle_rad)) +
                  " deg are needed");
  }
  return {};
}

void ModelBuilder::Adopt(const Reconstruction& model) {
  model_.intrinsics = model.intrinsics;
  context_.threads.ParallelFor(normalized_.size(),
                               [&](size_t i) { NormalizeKeypoints(ImageId(i)); });
  for (size_t i = 0; i < model.cam_from_model.size(); ++i) {
    if (!model.cam_from_model[i]) continue;
    AddRegistered(ImageId(i), *model.cam_from_model[i]);
    if (options_.refine_intrinsics) lens_refined_[model_.intrinsics.lens_of_image[i]] = true;
  }
}

bool ModelBuilder::LensIsOpen(ImageId image) const {
  return options_.refine_intrinsics &&
         !lens_refined_[model_.intrinsics.lens_of_image[image.index()]];
}

std::vector<double> ModelBuilder::FocalFactors(ImageId image) const {
  if (!LensIsOpen(image)) return {1.0};
  const size_t lens = model_.intrinsics.lens_of_image[image.index()];
  std::vector<double> factors(kFocalFactors.begin(), kFocalFactors.end());
  std::vector<double> known;
  for (size_t l = 0; l < lens_refined_.size(); ++l) {
    const CameraIntrinsics& other = model_.intrinsics.lenses[l];
    if (lens_refined_[l]) {
      known.push_back(other.MeanFocal_px() / std::max(other.width_px, other.height_px));
    }
  }
  if (!known.empty()) {
    const CameraIntrinsics& own = model_.intrinsics.lenses[lens];
    factors.push_back(Median(known) * std::max(own.width_px, own.height_px) / own.MeanFocal_px());
  }
  return factors;
}

Result<ImageEstimate> ModelBuilder::EstimatePose(ImageId image, size_t min_inliers) const {
  AbsolutePoseInput input;
  input.focal_px = FocalOf(image);
  for (const ImageTrack& entry : tracks_of_image_[image.index()]) {
    const size_t point = point_of_track_[entry.track.index()];
    const Eigen::Vector2d& ray = normalized_[image.index()][entry.keypoint.index()];
    if (point == kNoPoint || !ray.allFinite()) continue;
    input.normalized.push_back(ray);
    input.points.push_back(model_.points[point].position);
  }
  AbsolutePoseOptions pose_options;
  pose_options.max_error_px = options_.max_pnp_error_px;
  pose_options.min_inlier_ratio = options_.min_pnp_inlier_ratio;
  pose_options.seed = DeriveSeed(context_.seed, image.index());
  pose_options.focal_factors = FocalFactors(image);
  ROTUNDA_ASSIGN_OR_RETURN(AbsolutePose pose, EstimateAbsolutePose(input, pose_options));
  const auto needed = std::max(
      min_inliers, static_cast<size_t>(options_.min_pnp_inlier_ratio * input.points.size()));
  if (pose.inliers.size() < needed) {
    return Error{ErrorCode::kFailed,
                 "its best pose fits " + std::to_string(pose.inliers.size()) + " of the " +
                     std::to_string(input.points.size()) + " points it sees, " +
                     std::to_string(needed) + " are needed",
                 ""};
  }
  ImageEstimate estimate = {pose.cam_from_model, std::nullopt};
  if (LensIsOpen(image)) estimate.focal_px = pose.focal_factor * input.focal_px;
  return estimate;
}

void ModelBuilder::SetFocal(size_t lens, double focal_px) {
  CameraIntrinsics& intrinsics = model_.intrinsics.lenses[lens];
  const double factor = focal_px / intrinsics.MeanFocal_px();
  for (size_t p = 0; p < intrinsics.params.size(); ++p) {
    if (IsFocal(intrinsics.model, p)) intrinsics.params[p] *= factor;
  }
  for (size_t i = 0; i < normalized_.size(); ++i) {
    if (model_.intrinsics.lens_of_image[i] == lens) NormalizeKeypoints(ImageId(i));
  }
}

void ModelBuilder::Register(ImageId image, const ImageEstimate& estimate) {
  if (estimate.focal_px) {
    SetFocal(model_.intrinsics.lens_of_image[image.index()], *estimate.focal_px);
  }
  AddRegistered(image, estimate.cam_from_model);
}

std::vector<WeakImage> ModelBuilder::WeakImages(size_t min_observations) const {
  std::vector<size_t> held(model_.cam_from_model.size(), 0);
  for (const Point3& point : model_.points) {
    for (const Observation& o : point.observations) ++held[o.image.index()];
  }
  std::vector<WeakImage> weak;
  for (const ImageId image : registered_) {
    if (held[image.index()] < min_observations) weak.push_back({image, held[image.index()]});
  }
  return weak;
}

void ModelBuilder::Unregister(ImageId image) {
  for (const ImageTrack& entry : tracks_of_image_[image.index()]) {
    const size_t place = point_of_track_[entry.track.index()];
    if (place == kNoPoint) continue;
    Point3& point = model_.points[place];
    const auto removed =
        std::erase_if(point.observations, [&](const Observation& o) { return o.image == image; });
    if (removed > 0 && !Determined(point)) RemovePoint(place);
  }
  model_.cam_from_model[image.index()].reset();
  std::erase(registered_, image);
}

std::vector<WeakImage> ModelBuilder::UnregisterWeak(size_t min_observations) {
  std::vector<WeakImage> gone;
  std::vector<WeakImage> weak = WeakImages(min_observations);
  while (!weak.empty()) {
    for (const WeakImage& w : weak) Unregister(w.image);
    gone.insert(gone.end(), weak.begin(), weak.end());
    weak = WeakImages(min_observations);
  }
  Compact();
  return gone;
}

double ModelBuilder::ObservationError_px(const Observation& observation,
                                         const Eigen::Vector3d& position) const {
  const Eigen::Vector2d& ray = normalized_[observation.image.index()][observation.keypoint.index()];
  const Eigen::Vector3d x = *model_.cam_from_model[observation.image.index()] * position;
  if (!(x.z() > 0) || !ray.allFinite()) return std::numeric_limits<double>::infinity();
  return FocalOf(observation.image) * (x.hnormalized() - ray).norm();
}

std::vector<Observation> ModelBuilder::UsableObservations(TrackId track) const {
  std::vector<Observation> usable;
  for (const Observation& o : input_.tracks.tracks[track.index()].observations) {
    if (IsRegistered(o.image) && normalized_[o.image.index()][o.keypoint.index()].allFinite()) {
      usable.push_back(o);
    }
  }
  return usable;
}

std::optional<Point3> ModelBuilder::TriangulateTrack(TrackId track) const {
  const std::vector<Observation> usable = UsableObservations(track);
  std::vector<TriangulationView> views;
  for (const Observation& o : usable) {
    views.push_back(MakeTriangulationView(*model_.cam_from_model[o.image.index()],
                                          normalized_[o.image.index()][o.keypoint.index()],
                                          FocalOf(o.image)));
  }
  const auto found =
      Triangulate(views, {options_.max_reprojection_px, options_.min_triangulation_angle_rad});
  if (!found) return std::nullopt;
  Point3 point;
  point.position = found->position;
  for (const size_t i : found->inliers) point.observations.push_back(usable[i]);
  return point;
}

std::optional<Point3> ModelBuilder::ExtendedPoint(TrackId track, const Point3& point) const {
  Point3 extended = point;
  extended.observations.clear();
  for (const Observation& o : UsableObservations(track)) {
    const bool has = std::binary_search(point.observations.begin(), point.observations.end(), o);
    if (has || ObservationError_px(o, point.position) < options_.max_reprojection_px) {
      extended.observations.push_back(o);
    }
  }
  if (extended.observations.size() == point.observations.size()) return std::nullopt;
  return extended;
}

void ModelBuilder::SetPoint(TrackId track, Point3 point) {
  size_t& place = point_of_track_[track.index()];
  if (place != kNoPoint) {
    model_.points[place] = std::move(point);
    return;
  }
  place = model_.points.size();
  model_.points.push_back(std::move(point));
  track_of_point_.push_back(track);
  ++live_points_;
  for (const Observation& o : input_.tracks.tracks[track.index()].observations) {
    ++visible_[o.image.index()];
  }
}

void ModelBuilder::RemovePoint(size_t point) {
  const TrackId track = track_of_point_[point];
  point_of_track_[track.index()] = kNoPoint;
  model_.points[point].observations.clear();
  --live_points_;
  for (const Observation& o : input_.tracks.tracks[track.index()].observations) {
    --visible_[o.image.index()];
  }
}

void ModelBuilder::Compact() {
  size_t kept = 0;
  for (size_t p = 0; p < model_.points.size(); ++p) {
    if (model_.points[p].observations.empty()) continue;
    if (kept != p) {
      model_.points[kept] = std::move(model_.points[p]);
      track_of_point_[kept] = track_of_point_[p];
      point_of_track_[track_of_point_[kept].index()] = kept;
    }
    ++kept;
  }
  model_.points.resize(kept);
  track_of_point_.resize(kept);
}

void ModelBuilder::TriangulateTracks(const std::vector<TrackId>& tracks, bool afresh) {
  std::vector<std::optional<Point3>> points(tracks.size());
  const auto triangulate = [&](size_t i) {
    const TrackId track = tracks[i];
    const size_t place = point_of_track_[track.index()];
    if (place == kNoPoint) {
      points[i] = TriangulateTrack(track);
      return;
    }
    const Point3& point = model_.points[place];
    points[i] = ExtendedPoint(track, point);
    const size_t has = points[i] ? points[i]->observations.size() : point.observations.size();
    if (!afresh || 2 * has > UsableObservations(track).size()) return;
    auto other = TriangulateTrack(track);
    if (other && other->observations.size() > has) points[i] = std::move(other);
  };
  // In blocks: one call a track would cost more than the work.
  constexpr size_t kBlock = 256;
  context_.threads.ParallelFor((tracks.size() + kBlock - 1) / kBlock, [&](size_t block) {
    const size_t end = std::min(tracks.size(), (block + 1) * kBlock);
    for (size_t i = block * kBlock; i < end; ++i) triangulate(i);
  });
  for (size_t i = 0; i < tracks.size(); ++i) {
    if (points[i]) SetPoint(tracks[i], *std::move(points[i]));
  }
}

void ModelBuilder::TriangulateFor(const std::vector<ImageId>& images) {
  std::vector<bool> taken(active_.size(), false);
  std::vector<TrackId> tracks;
  for (const ImageId image : images) {
    for (const ImageTrack& entry : tracks_of_image_[image.index()]) {
      const size_t t = entry.track.index();
      if (!active_[t] || taken[t]) continue;
      taken[t] = true;
      tracks.push_back(entry.track);
    }
  }
  TriangulateTracks(tracks, false);
}

void ModelBuilder::TriangulateAll() {
  std::vector<TrackId> tracks;
  for (size_t t = 0; t < active_.size(); ++t) {
    if (active_[t]) tracks.push_back(TrackId(t));
  }
  TriangulateTracks(tracks, true);
}

void ModelBuilder::UseAllTracks() { active_.assign(active_.size(), true); }

std::vector<ImageId> ModelBuilder::LocalImages(const std::vector<ImageId>& images) const {
  std::vector<size_t> shared(model_.cam_from_model.size(), 0);
  for (const ImageId image : images) {
    for (const ImageTrack& entry : tracks_of_image_[image.index()]) {
      const size_t point = point_of_track_[entry.track.index()];
      if (point == kNoPoint) continue;
      for (const Observation& o : model_.points[point].observations) ++shared[o.image.index()];
    }
  }
  std::vector<ImageId> local = images;
  for (const ImageId image : images) shared[image.index()] = 0;
  std::vector<ImageId> others;
  for (size_t i = 0; i < shared.size(); ++i) {
    if (shared[i] > 0) others.push_back(ImageId(i));
  }
  std::stable_sort(others.begin(), others.end(),
                   [&](ImageId a, ImageId b) { return shared[a.index()] > shared[b.index()]; });
  others.resize(std::min(others.size(), options_.local_ba_images));
  local.insert(local.end(), others.begin(), others.end());
  return local;
}

Status ModelBuilder::AdjustLocally(const std::vector<ImageId>& images) {
  BundleAdjustmentOptions adjustment;
  adjustment.loss = Loss::kSoftL1;
  adjustment.max_iterations = 10;
  adjustment.function_tolerance = 1e-3;
  const auto report =
      AdjustBundle(model_, input_.features, LocalImages(images), adjustment, context_);
  return report ? Status() : Status(report.error());
}

Status ModelBuilder::AdjustGlobally(const BundleAdjustmentOptions& options) {
  Compact();
  BundleAdjustmentOptions adjustment = options;
  adjustment.refine_intrinsics = RefinesIntrinsics(registered_.size(), options_);
  const auto report = AdjustBundle(model_, input_.features, registered_, adjustment, context_);
  if (!report) return report.error();
  if (adjustment.refine_intrinsics) NormalizeRefinedLenses();
  return {};
}

void ModelBuilder::NormalizeRefinedLenses() {
  for (const ImageId image : registered_) {
    lens_refined_[model_.intrinsics.lens_of_image[image.index()]] = true;
  }
  context_.threads.ParallelFor(normalized_.size(), [&](size_t i) {
    if (lens_refined_[model_.intrinsics.lens_of_image[i]]) NormalizeKeypoints(ImageId(i));
  });
}

double ModelBuilder::RobustSigma() const {
  std::vector<double> squares;
  for (const Point3& point : model_.points) {
    for (const Observation& o : point.observations) {
      const double sigma_px =
          KeypointSigma_px(input_.features.image(o.image).keypoints[o.keypoint.index()]);
      const double error = ObservationError_px(o, point.position) / sigma_px;
      squares.push_back(error * error);
    }
  }
  // The squared length of a 2-D Gaussian has its median at 2 ln 2 sigma^2.
  constexpr double kLeastSigma = 0.01;
  return std::max(kLeastSigma, std::sqrt(Median(std::move(squares)) / (2.0 * std::log(2.0))));
}

/// Seen by two images at least, under a large enough angle.
bool ModelBuilder::Determined(const Point3& point) const {
  if (point.observations.size() < 2) return false;
  std::vector<Eigen::Vector3d> centers;
  for (const Observation& o : point.observations) {
    centers.push_back(model_.cam_from_model[o.image.index()]->OriginInSource());
  }
  return LargestAngle_rad(centers, point.position) >= options_.min_triangulation_angle_rad;
}

size_t ModelBuilder::Filter(double max_error_px, double max_sigmas) {
  const double limit = std::isfinite(max_sigmas) ? max_sigmas * RobustSigma() : max_sigmas;
  size_t removed = 0;
  for (size_t p = 0; p < model_.points.size(); ++p) {
    Point3& point = model_.points[p];
    if (point.observations.empty()) continue;
    removed += std::erase_if(point.observations, [&](const Observation& o) {
      const double error_px = ObservationError_px(o, point.position);
      const double sigma_px =
          KeypointSigma_px(input_.features.image(o.image).keypoints[o.keypoint.index()]);
      return !(error_px < max_error_px) || !(error_px < limit * sigma_px);
    });
    if (Determined(point)) continue;
    removed += point.observations.size();
    RemovePoint(p);
  }
  Compact();
  return removed;
}

size_t ModelBuilder::ObservationCount() const {
  size_t count = 0;
  for (const Point3& point : model_.points) count += point.observations.size();
  return count;
}

Reconstruction ModelBuilder::Take() {
  Compact();
  registered_.clear();
  return std::move(model_);
}

}  // namespace rotunda::sfm
