#include "sfm/view_graph.h"

#include <algorithm>
#include <numeric>

namespace rotunda::sfm {

ViewGraph BuildViewGraph(const Features& features, const TwoViews& two_views) {
  std::vector<std::vector<bool>> verified(features.images.size());
  for (size_t i = 0; i < verified.size(); ++i) {
    verified[i].resize(features.images[i].keypoints.size());
  }
  for (const TwoView& view : two_views.pairs) {
    for (const Match& match : view.inliers) {
      verified[view.pair.first.index()][match.first.index()] = true;
      verified[view.pair.second.index()][match.second.index()] = true;
    }
  }
  std::vector<double> keypoints;
  for (const std::vector<bool>& image : verified) {
    keypoints.push_back(static_cast<double>(std::count(image.begin(), image.end(), true)));
  }

  ViewGraph graph;
  graph.images = features.images.size();
  for (size_t i = 0; i < two_views.pairs.size(); ++i) {
    const TwoView& view = two_views.pairs[i];
    const auto inliers = static_cast<double>(view.inliers.size());
    const double r_first = inliers / std::max(1.0, keypoints[view.pair.first.index()]);
    const double r_second = inliers / std::max(1.0, keypoints[view.pair.second.index()]);
    graph.edges.push_back({i, view.pair, 0.5 * (r_first + r_second)});
  }
  return graph;
}

std::vector<size_t> EdgesByWeight(const ViewGraph& graph) {
  std::vector<size_t> order(graph.edges.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    const ViewGraphEdge& x = graph.edges[a];
    const ViewGraphEdge& y = graph.edges[b];
    if (x.weight != y.weight) return x.weight > y.weight;
    return x.pair < y.pair;
  });
  return order;
}

}  // namespace rotunda::sfm
