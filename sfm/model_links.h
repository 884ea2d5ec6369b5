#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "sfm/core/ids.h"
#include "sfm/core/rigid3.h"
#include "sfm/features.h"
#include "sfm/reconstruction.h"
#include "sfm/two_view.h"
#include "sfm/view_graph.h"

namespace rotunda::sfm {

/// What models are merged by, besides themselves. The edges of `graph` name the pairs that may
/// speak (places in `two_views`) and their weights.
struct MergeInput {
  const Features& features;
  const TwoViews& two_views;
  const ViewGraph& graph;
};

/// Which point of a model a keypoint of a registered image belongs to.
class PointIndex {
 public:
  PointIndex(const Features& features, const Reconstruction& model);
  std::optional<size_t> Find(ImageId image, KeypointId keypoint) const;

 private:
  std::vector<std::vector<uint32_t>> points_;  // by image and keypoint; empty: not registered
};

/// A keypoint of a link's source image, the one of its target image that shows the same, and the
/// points they belong to in their models, at least one of them.
struct LinkedPoint {
  KeypointId source_keypoint, target_keypoint;
  std::optional<size_t> source_point, target_point;
};

/// What ties two models: a camera that both have, or a verified pair of pictures, one from each.
struct ModelLink {
  ImageId source, target;  // equal: a camera that both models have
  /// Of the view graph (TC-SfM III-A); of a common camera 1, a picture's share in itself.
  double weight = 1.0;
  /// x_target = R x_source + lambda t, |t| = 1 and lambda > 0 unknown; the identity, with t = 0,
  /// for a common camera.
  Rigid3 target_cam_from_source_cam;
  std::vector<LinkedPoint> points;

  bool CommonCamera() const { return source == target; }
};

/// One of the two models of a merge.
struct LinkedModel {
  const Reconstruction& model;
  const PointIndex& index;
};

/// All links: common cameras that see points in both models, by image; then pairs of an image of
/// the source alone and one of the target alone, in the order of the graph. Panoramic pairs are
/// left out: where no two cameras share a place they join things that look alike.
std::vector<ModelLink> LinkModels(const MergeInput& input, const LinkedModel& source,
                                  const LinkedModel& target);

}  // namespace rotunda::sfm
