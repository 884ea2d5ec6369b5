#include "sfm/view_graph.h"

#include <gtest/gtest.h>

#include <utility>
#include <vector>

namespace rotunda::sfm {
namespace {

TwoView View(size_t first, size_t second, const std::vector<std::pair<size_t, size_t>>& inliers) {
  TwoView view;
  view.pair = {ImageId(first), ImageId(second)};
  for (const auto& [a, b] : inliers) view.inliers.push_back({KeypointId(a), KeypointId(b)});
  return view;
}

Features WithKeypoints(const std::vector<size_t>& counts) {
  Features features;
  for (size_t count : counts) {
    features.images.emplace_back();
    features.images.back().keypoints.resize(count);
  }
  return features;
}

TEST(BuildViewGraph, WeightIsTheMeanShareOfVerifiedKeypoints) {
  // Picture 0 has verified keypoints {0, 1, 2}, picture 1 {0, 1, 3}, picture 2 {0, 5}; others do
  // not count.
  const Features features = WithKeypoints({10, 20, 30});
  const TwoViews views{
      {View(0, 1, {{0, 0}, {1, 1}}), View(0, 2, {{2, 5}}), View(1, 2, {{1, 5}, {3, 0}})}};
  const ViewGraph graph = BuildViewGraph(features, views);
  EXPECT_EQ(graph.images, 3U);
  ASSERT_EQ(graph.edges.size(), 3U);
  EXPECT_DOUBLE_EQ(graph.edges[0].weight, 0.5 * (2.0 / 3 + 2.0 / 3));
  EXPECT_DOUBLE_EQ(graph.edges[1].weight, 0.5 * (1.0 / 3 + 1.0 / 2));
  EXPECT_DOUBLE_EQ(graph.edges[2].weight, 0.5 * (2.0 / 3 + 2.0 / 2));
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(graph.edges[i].two_view, i);
    EXPECT_EQ(graph.edges[i].pair, views.pairs[i].pair);
  }
}

TEST(EdgesByWeight, HeaviestFirstAndTiesToTheSmallerPair) {
  ViewGraph graph;
  graph.images = 3;
  graph.edges = {{0, {ImageId(1), ImageId(2)}, 1.0},
                 {1, {ImageId(0), ImageId(2)}, 2.0},
                 {2, {ImageId(0), ImageId(1)}, 1.0}};
  EXPECT_EQ(EdgesByWeight(graph), (std::vector<size_t>{1, 2, 0}));
  EXPECT_TRUE(EdgesByWeight({}).empty());
}

}  // namespace
}  // namespace rotunda::sfm
