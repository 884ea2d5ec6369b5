#include "sfm/covisibility.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <string>

namespace rotunda::sfm {
namespace {

/// Of every keypoint those of other images that a verified match joins it with.
class MatchPartners {
 public:
  MatchPartners(const Features& features, const TwoViews& two_views, const ViewGraph& graph) {
    for (const ImageFeatures& image : features.images) {
      of_keypoint_.emplace_back(image.keypoints.size());
    }
    for (const ViewGraphEdge& edge : graph.edges) {
      for (const Match& match : two_views.pairs[edge.two_view].inliers) {
        of_keypoint_[edge.pair.first.index()][match.first.index()].push_back(
            {edge.pair.second, match.second});
        of_keypoint_[edge.pair.second.index()][match.second.index()].push_back(
            {edge.pair.first, match.first});
      }
    }
  }
  const std::vector<Observation>& Of(const Observation& observation) const {
    return of_keypoint_[observation.image.index()][observation.keypoint.index()];
  }

 private:
  std::vector<std::vector<std::vector<Observation>>> of_keypoint_;
};

constexpr size_t kMinObservers = 3;  // two that enclose, and the image itself may be one

/// Points that enough images see, cut at the median of the longest side of their box until at most
/// `limit` are left together.
std::vector<std::vector<size_t>> SplitIntoRegions(const Reconstruction& model, size_t limit) {
  std::vector<size_t> all;
  for (size_t p = 0; p < model.points.size(); ++p) {
    if (model.points[p].observations.size() >= kMinObservers) all.push_back(p);
  }
  std::vector<std::vector<size_t>> open = {all}, regions;
  while (!open.empty()) {
    std::vector<size_t> points = std::move(open.back());
    open.pop_back();
    if (points.size() <= limit) {
      if (!points.empty()) regions.push_back(std::move(points));
      continue;
    }
    Eigen::AlignedBox3d box;
    for (const size_t p : points) box.extend(model.points[p].position);
    Eigen::Index axis = 0;
    box.sizes().maxCoeff(&axis);
    const auto middle = points.begin() + static_cast<std::ptrdiff_t>(points.size() / 2);
    std::nth_element(points.begin(), middle, points.end(), [&](size_t a, size_t b) {
      const double x = model.points[a].position[axis], y = model.points[b].position[axis];
      return x != y ? x < y : a < b;
    });
    open.emplace_back(middle, points.end());
    open.emplace_back(points.begin(), middle);
  }
  return regions;
}

double Angle_rad(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::acos(std::clamp(a.dot(b), -1.0, 1.0));
}

bool Inside(const ImageFeatures& picture, const Eigen::Vector2d& pixel, double border_px) {
  return pixel.x() >= border_px && pixel.y() >= border_px &&
         pixel.x() <= picture.width_px - border_px && pixel.y() <= picture.height_px - border_px;
}

/// Nearest depth of the points in cells of a picture: what they hide lies behind.
class DepthMap {
 public:
  DepthMap() = default;
  DepthMap(const ImageFeatures& picture, double cell_share)
      : cell_px_(cell_share * std::max(picture.width_px, picture.height_px)),
        columns_(static_cast<int>(picture.width_px / cell_px_) + 1),
        rows_(static_cast<int>(picture.height_px / cell_px_) + 1),
        nearest_(static_cast<size_t>(columns_ * rows_), std::numeric_limits<double>::infinity()) {}

  void Add(const Eigen::Vector2d& pixel, double depth) {
    double& nearest = nearest_[Index(Column(pixel), Row(pixel))];
    nearest = std::min(nearest, depth);
  }
  /// Over the cell and the eight around it.
  double Nearest(const Eigen::Vector2d& pixel) const {
    double nearest = std::numeric_limits<double>::infinity();
    for (int row = std::max(0, Row(pixel) - 1); row <= std::min(rows_ - 1, Row(pixel) + 1); ++row) {
      for (int column = std::max(0, Column(pixel) - 1);
           column <= std::min(columns_ - 1, Column(pixel) + 1); ++column) {
        nearest = std::min(nearest, nearest_[Index(column, row)]);
      }
    }
    return nearest;
  }

 private:
  size_t Index(int column, int row) const { return static_cast<size_t>(row * columns_ + column); }
  int Column(const Eigen::Vector2d& pixel) const {
    return std::clamp(static_cast<int>(pixel.x() / cell_px_), 0, columns_ - 1);
  }
  int Row(const Eigen::Vector2d& pixel) const {
    return std::clamp(static_cast<int>(pixel.y() / cell_px_), 0, rows_ - 1);
  }

  double cell_px_ = 1;
  int columns_ = 0, rows_ = 0;
  std::vector<double> nearest_;
};

/// An image somewhere in the model, and what hides what from there.
struct Viewpoint {
  ImageId image;
  Rigid3 cam_from_model;
  Eigen::Vector3d center;
  DepthMap depths;
};

/// Any point may hide another, whoever observes it: surfaces are closed.
Viewpoint MakeViewpoint(const Reconstruction& model, const ImageFeatures& picture, ImageId image,
                        const Rigid3& cam_from_model, const CovisibilityOptions& options) {
  Viewpoint view = {image, cam_from_model, cam_from_model.OriginInSource(),
                    DepthMap(picture, options.obstacle_cell_share)};
  if (!options.obstacles) return view;
  for (const Point3& point : model.points) {
    if (point.observations.size() < kMinObservers) continue;
    const Eigen::Vector3d x = cam_from_model * point.position;
    if (!(x.z() > 0)) continue;
    const auto pixel = model.intrinsics.of(image).Project(x);
    if (pixel && Inside(picture, *pixel, 0)) view.depths.Add(*pixel, x.z());
  }
  return view;
}

/// A point with the directions in which it is seen.
struct SeenPoint {
  const Point3* point;
  std::vector<Eigen::Vector3d> directions;  // unit, parallel to the observations
};

}  // namespace

/// Everything that counting needs of a model.
struct CovisibilityCounter::Impl {
  const Reconstruction& model;
  const Features& features;
  const CovisibilityOptions options;
  MatchPartners partners;
  std::vector<Eigen::Vector3d> centers;  // by ImageId
  std::vector<std::vector<size_t>> regions;

  Viewpoint At(ImageId image, const Rigid3& cam_from_model) const {
    return MakeViewpoint(model, features.image(image), image, cam_from_model, options);
  }

  SeenPoint Seen(size_t p) const {
    SeenPoint seen{&model.points[p], {}};
    for (const Observation& o : seen.point->observations) {
      seen.directions.push_back((centers[o.image.index()] - seen.point->position).normalized());
    }
    return seen;
  }

  /// Inside the picture, and no point is clearly nearer there.
  bool MustBeSeen(const Viewpoint& view, const Eigen::Vector3d& position) const {
    const Eigen::Vector3d x = view.cam_from_model * position;
    if (!(x.z() > 0)) return false;
    const auto pixel = model.intrinsics.of(view.image).Project(x);
    if (!pixel) return false;
    const ImageFeatures& picture = features.image(view.image);
    const double border_px = options.border_share * std::max(picture.width_px, picture.height_px);
    return Inside(picture, *pixel, border_px) &&
           view.depths.Nearest(*pixel) >= (1 - options.obstacle_depth_share) * x.z();
  }

  /// Observations of other images that see the point from near by; empty unless two of them
  /// enclose the viewpoint.
  std::vector<size_t> EnclosingObservers(const Viewpoint& view, const SeenPoint& seen) const {
    const Eigen::Vector3d direction = (view.center - seen.point->position).normalized();
    std::vector<size_t> near;
    std::vector<double> angles;
    for (size_t k = 0; k < seen.directions.size(); ++k) {
      if (seen.point->observations[k].image == view.image) continue;
      const double angle = Angle_rad(direction, seen.directions[k]);
      if (angle > options.max_view_angle_rad) continue;
      near.push_back(k);
      angles.push_back(angle);
    }
    for (size_t a = 0; a < near.size(); ++a) {
      for (size_t b = a + 1; b < near.size(); ++b) {
        const double apart = Angle_rad(seen.directions[near[a]], seen.directions[near[b]]);
        if (angles[a] + angles[b] <= options.enclosure * apart) return near;
      }
    }
    return {};
  }

  /// Whether a match joins the image with an observer by a keypoint that `fits`.
  template <typename Fits>
  bool MetBy(const Viewpoint& view, const SeenPoint& seen, const std::vector<size_t>& observers,
             const Fits& fits) const {
    return std::any_of(observers.begin(), observers.end(), [&](size_t k) {
      const auto& joined = partners.Of(seen.point->observations[k]);
      return std::any_of(joined.begin(), joined.end(), [&](const Observation& partner) {
        return partner.image == view.image && fits(partner.keypoint);
      });
    });
  }

  bool Met(const Viewpoint& view, const SeenPoint& seen,
           const std::vector<size_t>& observers) const {
    return MetBy(view, seen, observers, [](KeypointId) { return true; });
  }

  /// By a keypoint at most `max_error_px` from where the point projects to.
  bool MetInPlace(const Viewpoint& view, const SeenPoint& seen,
                  const std::vector<size_t>& observers, double max_error_px) const {
    const auto pixel =
        model.intrinsics.of(view.image).Project(view.cam_from_model * seen.point->position);
    return MetBy(view, seen, observers, [&](KeypointId keypoint) {
      const Keypoint& met = features.image(view.image).keypoints[keypoint.index()];
      return (Eigen::Vector2d(met.x_px, met.y_px) - *pixel).norm() <= max_error_px;
    });
  }

  RegionCovisibility CountRegion(const std::vector<Viewpoint>& views,
                                 const std::vector<size_t>& points) const {
    std::map<ImagePair, PairCount> counts;
    size_t trials = 0, counted = 0;
    for (const size_t p : points) {
      const SeenPoint seen = Seen(p);
      for (const Viewpoint& view : views) {
        if (!MustBeSeen(view, seen.point->position)) continue;
        const std::vector<size_t> observers = EnclosingObservers(view, seen);
        if (observers.empty()) continue;
        const bool met = Met(view, seen, observers);
        ++trials;
        counted += observers.size();
        for (const size_t k : observers) {
          const ImageId other = seen.point->observations[k].image;
          const ImagePair pair{std::min(view.image, other), std::max(view.image, other)};
          PairCount& count = counts[pair];
          count.pair = pair;
          ++count.expected;
          count.met += met;
        }
      }
    }
    RegionCovisibility region;
    for (const auto& [pair, count] : counts) region.pairs.push_back(count);
    if (counted > 0) {
      region.independence = static_cast<double>(trials) / static_cast<double>(counted);
    }
    return region;
  }
};

CovisibilityCounter::CovisibilityCounter(const Reconstruction& model, const Features& features,
                                         const TwoViews& two_views, const ViewGraph& graph,
                                         const CovisibilityOptions& options)
    : impl_(new Impl{model, features, options, MatchPartners(features, two_views, graph), {}, {}}) {
  impl_->centers.resize(features.images.size());
  for (size_t i = 0; i < features.images.size(); ++i) {
    if (model.Registered(ImageId(i))) {
      impl_->centers[i] = model.cam_from_model[i]->OriginInSource();
    }
  }
  impl_->regions = SplitIntoRegions(
      model, std::max(options.min_points_per_region, model.points.size() / options.max_regions));
}

CovisibilityCounter::~CovisibilityCounter() = default;

std::vector<MeetingCount> CovisibilityCounter::CountAt(ImageId image, const Rigid3& cam_from_model,
                                                       double max_error_px) const {
  const Viewpoint view = impl_->At(image, cam_from_model);
  std::vector<MeetingCount> counts(impl_->regions.size());
  for (size_t r = 0; r < counts.size(); ++r) {
    for (const size_t p : impl_->regions[r]) {
      const SeenPoint seen = impl_->Seen(p);
      if (!impl_->MustBeSeen(view, seen.point->position)) continue;
      const std::vector<size_t> observers = impl_->EnclosingObservers(view, seen);
      if (observers.empty()) continue;
      ++counts[r].expected;
      counts[r].met += impl_->Met(view, seen, observers);
      counts[r].in_place += impl_->MetInPlace(view, seen, observers, max_error_px);
    }
  }
  return counts;
}

Covisibility CovisibilityCounter::CountAll(RunContext& context) const {
  std::vector<ImageId> registered;
  for (size_t i = 0; i < impl_->centers.size(); ++i) {
    if (impl_->model.Registered(ImageId(i))) registered.push_back(ImageId(i));
  }
  std::vector<Viewpoint> views(registered.size());
  context.threads.ParallelFor(views.size(), [&](size_t v) {
    views[v] = impl_->At(registered[v], *impl_->model.cam_from_model[registered[v].index()]);
  });
  Covisibility covisibility{impl_->centers.size(), {}};
  covisibility.regions.resize(impl_->regions.size());
  context.threads.ParallelFor(
      impl_->regions.size(),
      [&](size_t r) { covisibility.regions[r] = impl_->CountRegion(views, impl_->regions[r]); },
      context.stop);
  return covisibility;
}

Status CovisibilityOptions::Validate() const {
  const auto bad = [](const char* field, double value, const char* expected) {
    return Error{ErrorCode::kInvalidArgument,
                 std::to_string(value) + " is out of range, expected " + expected, field};
  };
  if (min_points_per_region < 1) return bad("min_points_per_region", 0, ">= 1");
  if (max_regions < 1) return bad("max_regions", 0, ">= 1");
  if (!(max_view_angle_rad > 0)) return bad("max_view_angle_rad", max_view_angle_rad, "> 0");
  if (!(enclosure >= 1)) return bad("enclosure", enclosure, ">= 1");
  if (!(border_share >= 0)) return bad("border_share", border_share, ">= 0");
  if (!(obstacle_cell_share > 0)) return bad("obstacle_cell_share", obstacle_cell_share, "> 0");
  if (!(obstacle_depth_share > 0)) return bad("obstacle_depth_share", obstacle_depth_share, "> 0");
  return {};
}

}  // namespace rotunda::sfm
