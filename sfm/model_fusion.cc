#include "sfm/model_fusion.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include "sfm/core/statistics.h"

namespace rotunda::sfm {
namespace {

/// Standard error of a pose up to a common factor; infinite without observations.
double PoseError(const ImageResidual& residual) {
  if (residual.observations == 0) return std::numeric_limits<double>::infinity();
  return residual.rms_px / std::sqrt(static_cast<double>(residual.observations));
}

class Fusion {
 public:
  Fusion(const FusionInput& input, double max_duplicate_px)
      : input_(input),
        max_duplicate_px_(max_duplicate_px),
        fused_(input.target),
        source_residuals_(SummarizeReprojection(input.source, input.features)),
        target_residuals_(SummarizeReprojection(input.target, input.features)) {}

  Reconstruction Run() {
    ChoosePoses();
    ChooseLenses();
    LosePoses();
    for (const auto& [source_point, target_point] : DuplicateCandidates()) {
      FuseIfOnePoint(source_point, target_point);
    }
    for (size_t p = 0; p < source_points_.size(); ++p) {
      if (!fused_away_[p]) fused_.points.push_back(source_points_[p]);
    }
    ResolveKeypoints();
    std::erase_if(fused_.points, [](const Point3& p) { return p.observations.size() < 2; });
    return std::move(fused_);
  }

 private:
  bool FromSource(size_t image) const {
    if (!input_.source.cam_from_model[image]) return false;
    return !input_.target.cam_from_model[image] ||
           PoseError(source_residuals_.images[image]) < PoseError(target_residuals_.images[image]);
  }

  void ChoosePoses() {
    for (size_t i = 0; i < fused_.cam_from_model.size(); ++i) {
      if (FromSource(i)) fused_.cam_from_model[i] = input_.source.cam_from_model[i];
    }
  }

  void ChooseLenses() {
    std::vector<size_t> by_source(fused_.intrinsics.lenses.size()), by_target(by_source);
    for (size_t i = 0; i < fused_.cam_from_model.size(); ++i) {
      const size_t lens = fused_.intrinsics.lens_of_image[i];
      by_source[lens] += source_residuals_.images[i].observations;
      by_target[lens] += target_residuals_.images[i].observations;
    }
    for (size_t l = 0; l < by_source.size(); ++l) {
      if (by_source[l] <= by_target[l]) continue;
      fused_.intrinsics.lenses[l] = input_.source.intrinsics.lenses[l];
    }
  }

  /// Takes from the model whose pose of a contradictory camera went what it saw in it.
  void LosePoses() {
    std::vector<bool> source_loses(fused_.cam_from_model.size()), target_loses(source_loses);
    for (size_t k = 0; k < input_.links.size(); ++k) {
      if (!input_.links[k].CommonCamera() || input_.agrees[k]) continue;
      const size_t image = input_.links[k].source.index();
      (FromSource(image) ? target_loses : source_loses)[image] = true;
    }
    const auto erase = [](const std::vector<bool>& loses, std::vector<Point3>& points) {
      for (Point3& point : points) {
        std::erase_if(point.observations,
                      [&](const Observation& o) { return loses[o.image.index()]; });
      }
    };
    source_points_ = input_.source.points;
    fused_away_.assign(source_points_.size(), false);
    fused_into_.assign(fused_.points.size(), false);
    erase(source_loses, source_points_);
    erase(target_loses, fused_.points);
  }

  /// (source point, target point) of one track, those with most keypoints in common first.
  std::vector<std::pair<size_t, size_t>> DuplicateCandidates() const {
    std::map<std::pair<size_t, size_t>, size_t> votes;
    for (size_t k = 0; k < input_.links.size(); ++k) {
      if (!input_.agrees[k]) continue;
      for (const LinkedPoint& point : input_.links[k].points) {
        if (point.source_point && point.target_point) {
          ++votes[{*point.source_point, *point.target_point}];
        }
      }
    }
    std::vector<std::pair<size_t, size_t>> candidates;
    for (const auto& [points, count] : votes) candidates.push_back(points);
    std::stable_sort(candidates.begin(), candidates.end(),
                     [&](const auto& a, const auto& b) { return votes.at(a) > votes.at(b); });
    return candidates;
  }

  std::optional<Eigen::Vector2d> Projected(ImageId image, const Eigen::Vector3d& position) const {
    const auto& pose = fused_.cam_from_model[image.index()];
    if (!pose) return std::nullopt;
    return fused_.intrinsics.of(image).Project(*pose * position);
  }

  /// Median distance of the projections in the pictures that see either; infinite where none does.
  double Distance_px(const Point3& a, const Point3& b) const {
    std::vector<double> distances_px;
    for (const Point3* point : {&a, &b}) {
      for (const Observation& o : point->observations) {
        const auto pixel_a = Projected(o.image, a.position);
        const auto pixel_b = Projected(o.image, b.position);
        distances_px.push_back(pixel_a && pixel_b ? (*pixel_a - *pixel_b).norm()
                                                  : std::numeric_limits<double>::infinity());
      }
    }
    if (distances_px.empty()) return std::numeric_limits<double>::infinity();
    return Median(std::move(distances_px));
  }

  double Error_px(const Point3& point, const Observation& observation) const {
    return ReprojectionError_px(fused_, input_.features, point, observation)
        .value_or(std::numeric_limits<double>::infinity());
  }

  /// A point takes part in one fusion at most.
  void FuseIfOnePoint(size_t source_point, size_t target_point) {
    if (fused_away_[source_point] || fused_into_[target_point]) return;
    const Point3& source = source_points_[source_point];
    Point3& target = fused_.points[target_point];
    if (!(Distance_px(source, target) <= max_duplicate_px_)) return;
    const auto a = static_cast<double>(source.observations.size());
    const auto b = static_cast<double>(target.observations.size());
    Point3 both = target;
    both.position = (a * source.position + b * target.position) / (a + b);
    both.observations.insert(both.observations.end(), source.observations.begin(),
                             source.observations.end());
    // Where a picture has two keypoints of the track, the nearer one stays.
    std::sort(both.observations.begin(), both.observations.end(),
              [&](const Observation& o, const Observation& p) {
                if (o.image != p.image) return o.image < p.image;
                const double o_px = Error_px(both, o), p_px = Error_px(both, p);
                return o_px != p_px ? o_px < p_px : o.keypoint < p.keypoint;
              });
    const auto same = [](const Observation& o, const Observation& p) { return o.image == p.image; };
    both.observations.erase(std::unique(both.observations.begin(), both.observations.end(), same),
                            both.observations.end());
    target = std::move(both);
    fused_away_[source_point] = fused_into_[target_point] = true;
  }

  size_t AgreeingObservations(const Point3& point) const {
    size_t count = 0;
    for (const Observation& o : point.observations) {
      count += Error_px(point, o) <= max_duplicate_px_;
    }
    return count;
  }

  void ResolveKeypoints() {
    std::map<Observation, size_t> owner;
    for (size_t p = 0; p < fused_.points.size(); ++p) {
      for (const Observation& o : fused_.points[p].observations) TakeKeypoint(o, p, owner);
    }
    for (size_t p = 0; p < fused_.points.size(); ++p) {
      std::erase_if(fused_.points[p].observations,
                    [&](const Observation& o) { return owner.at(o) != p; });
    }
  }

  /// Ties: the earlier point keeps it.
  void TakeKeypoint(const Observation& observation, size_t point,
                    std::map<Observation, size_t>& owner) const {
    const auto [place, is_new] = owner.try_emplace(observation, point);
    if (is_new) return;
    if (AgreeingObservations(fused_.points[point]) >
        AgreeingObservations(fused_.points[place->second])) {
      place->second = point;
    }
  }

  const FusionInput& input_;
  double max_duplicate_px_;
  Reconstruction fused_;
  ReprojectionSummary source_residuals_, target_residuals_;  // each in its own model
  std::vector<Point3> source_points_;
  std::vector<bool> fused_away_;  // by source point
  std::vector<bool> fused_into_;  // by target point
};

}  // namespace

Reconstruction FuseModels(const FusionInput& input, double max_duplicate_px) {
  return Fusion(input, max_duplicate_px).Run();
}

}  // namespace rotunda::sfm
