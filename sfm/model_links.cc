#include "sfm/model_links.h"

#include <utility>

namespace rotunda::sfm {
namespace {

constexpr uint32_t kNoPoint = UINT32_MAX;

void AddPoint(const LinkedModel& source, const LinkedModel& target, const Match& keypoints,
              ModelLink& link) {
  const LinkedPoint point = {keypoints.first, keypoints.second,
                             source.index.Find(link.source, keypoints.first),
                             target.index.Find(link.target, keypoints.second)};
  if (point.source_point || point.target_point) link.points.push_back(point);
}

/// nullopt: the camera sees no point in one of the models, so that its pose there means nothing.
std::optional<ModelLink> CommonCamera(const Features& features, const LinkedModel& source,
                                      const LinkedModel& target, ImageId image) {
  ModelLink link;
  link.source = link.target = image;
  bool in_source = false, in_target = false;
  for (size_t k = 0; k < features.image(image).keypoints.size(); ++k) {
    AddPoint(source, target, {KeypointId(k), KeypointId(k)}, link);
  }
  for (const LinkedPoint& point : link.points) {
    in_source = in_source || point.source_point;
    in_target = in_target || point.target_point;
  }
  if (!in_source || !in_target) return std::nullopt;
  return link;
}

ModelLink CrossPair(const LinkedModel& source, const LinkedModel& target, const TwoView& view,
                    bool source_first) {
  ModelLink link;
  link.source = source_first ? view.pair.first : view.pair.second;
  link.target = source_first ? view.pair.second : view.pair.first;
  link.target_cam_from_source_cam =
      source_first ? view.second_from_first : view.second_from_first.Inverse();
  for (Match match : view.inliers) {
    if (!source_first) std::swap(match.first, match.second);
    AddPoint(source, target, match, link);
  }
  return link;
}

}  // namespace

PointIndex::PointIndex(const Features& features, const Reconstruction& model)
    : points_(features.images.size()) {
  for (size_t i = 0; i < points_.size(); ++i) {
    if (model.cam_from_model[i]) points_[i].assign(features.images[i].keypoints.size(), kNoPoint);
  }
  for (size_t p = 0; p < model.points.size(); ++p) {
    for (const Observation& o : model.points[p].observations) {
      std::vector<uint32_t>& of_image = points_[o.image.index()];
      if (!of_image.empty()) of_image[o.keypoint.index()] = static_cast<uint32_t>(p);
    }
  }
}

std::optional<size_t> PointIndex::Find(ImageId image, KeypointId keypoint) const {
  const std::vector<uint32_t>& of_image = points_[image.index()];
  if (of_image.empty() || of_image[keypoint.index()] == kNoPoint) return std::nullopt;
  return of_image[keypoint.index()];
}

std::vector<ModelLink> LinkModels(const MergeInput& input, const LinkedModel& source,
                                  const LinkedModel& target) {
  std::vector<ModelLink> links;
  for (size_t i = 0; i < input.features.images.size(); ++i) {
    const ImageId image(i);
    if (!source.model.Registered(image) || !target.model.Registered(image)) continue;
    if (auto link = CommonCamera(input.features, source, target, image)) {
      links.push_back(*std::move(link));
    }
  }
  const auto only_in = [](const Reconstruction& a, const Reconstruction& b, ImageId image) {
    return a.Registered(image) && !b.Registered(image);
  };
  for (const ViewGraphEdge& edge : input.graph.edges) {
    const TwoView& view = input.two_views.pairs[edge.two_view];
    if (view.kind == TwoViewKind::kPanoramic) continue;
    const auto [first, second] = view.pair;
    const bool forward =
        only_in(source.model, target.model, first) && only_in(target.model, source.model, second);
    const bool backward =
        only_in(source.model, target.model, second) && only_in(target.model, source.model, first);
    if (!forward && !backward) continue;
    links.push_back(CrossPair(source, target, view, forward));
    links.back().weight = edge.weight;
  }
  return links;
}

}  // namespace rotunda::sfm
