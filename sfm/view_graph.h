#pragma once

#include <vector>

#include "sfm/core/ids.h"
#include "sfm/two_view.h"

namespace rotunda::sfm {

struct ViewGraphEdge {
  size_t two_view = 0;  // place in TwoViews::pairs
  ImagePair pair;
  /// Mean of r_i and r_j, r_i = inliers of the pair / keypoints of i that have a verified match
  /// anywhere (TC-SfM III-A).
  double weight = 0;
};

/// One edge a verified pair, in the order of TwoViews::pairs.
struct ViewGraph {
  size_t images = 0;
  std::vector<ViewGraphEdge> edges;
};

ViewGraph BuildViewGraph(const Features& features, const TwoViews& two_views);

/// Places in `graph.edges`, heaviest first, ties by pair.
std::vector<size_t> EdgesByWeight(const ViewGraph& graph);

}  // namespace rotunda::sfm
