#include "sfm/view_graph.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

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

ViewGraph RandomGraph(std::mt19937_64& random, size_t images, size_t edges) {
  ViewGraph graph;
  graph.images = images;
  while (graph.edges.size() < edges) {
    const size_t a = random() % images, b = random() % images;
    if (a >= b) continue;
    const ImagePair pair{ImageId(a), ImageId(b)};
    const bool there = std::any_of(graph.edges.begin(), graph.edges.end(),
                                   [&](const ViewGraphEdge& e) { return e.pair == pair; });
    if (there) continue;
    graph.edges.push_back({graph.edges.size(), pair, static_cast<double>(random() % 20)});
  }
  return graph;
}

/// Labels of the components of the edges in `mask`, by flooding.
std::vector<size_t> Components(const ViewGraph& graph, uint32_t mask) {
  std::vector<size_t> label(graph.images);
  for (size_t i = 0; i < label.size(); ++i) label[i] = i;
  for (size_t round = 0; round < graph.images; ++round) {
    for (size_t e = 0; e < graph.edges.size(); ++e) {
      if ((mask >> e & 1U) == 0) continue;
      size_t &a = label[graph.edges[e].pair.first.index()],
             &b = label[graph.edges[e].pair.second.index()];
      a = b = std::min(a, b);
    }
  }
  return label;
}

TEST(MaximumSpanningTree, WeighsAsMuchAsTheBestOfAllForests) {
  std::mt19937_64 random(3);
  for (int trial = 0; trial < 30; ++trial) {
    const ViewGraph graph = RandomGraph(random, 6, 4 + trial % 8);
    const uint32_t all = (1U << graph.edges.size()) - 1;
    const std::vector<size_t> components = Components(graph, all);
    double best = -1;
    for (uint32_t mask = 0; mask <= all; ++mask) {
      std::vector<size_t> roots = Components(graph, mask);
      if (roots != components) continue;  // does not span
      double weight = 0;
      for (size_t e = 0; e < graph.edges.size(); ++e) {
        if (mask >> e & 1U) weight += graph.edges[e].weight;
      }
      std::sort(roots.begin(), roots.end());
      const auto distinct =
          static_cast<size_t>(std::unique(roots.begin(), roots.end()) - roots.begin());
      const bool forest = static_cast<size_t>(__builtin_popcount(mask)) == graph.images - distinct;
      if (forest) best = std::max(best, weight);
    }
    const std::vector<size_t> tree = MaximumSpanningTree(graph);
    double weight = 0;
    uint32_t mask = 0;
    for (size_t e : tree) {
      weight += graph.edges[e].weight;
      mask |= 1U << e;
    }
    EXPECT_EQ(weight, best) << "trial " << trial;
    EXPECT_EQ(Components(graph, mask), components) << "trial " << trial;
    EXPECT_TRUE(std::is_sorted(tree.begin(), tree.end(), [&](size_t a, size_t b) {
      return graph.edges[a].weight > graph.edges[b].weight;
    }));
  }
}

TEST(MaximumSpanningTree, TiesGoToTheSmallerPair) {
  ViewGraph graph;
  graph.images = 3;
  graph.edges = {{0, {ImageId(1), ImageId(2)}, 1.0},
                 {1, {ImageId(0), ImageId(2)}, 1.0},
                 {2, {ImageId(0), ImageId(1)}, 1.0}};
  EXPECT_EQ(MaximumSpanningTree(graph), (std::vector<size_t>{2, 1}));
}

TEST(ConnectedComponents, LargestFirstWithoutLonePictures) {
  ViewGraph graph;
  graph.images = 8;
  const auto edge = [&](size_t a, size_t b) {
    graph.edges.push_back({graph.edges.size(), {ImageId(a), ImageId(b)}, 1.0});
  };
  edge(0, 5);
  edge(2, 3);
  edge(3, 7);
  edge(1, 4);
  const auto components = ConnectedComponents(graph);
  const auto ids = [](std::initializer_list<size_t> values) {
    std::vector<ImageId> result;
    for (size_t v : values) result.push_back(ImageId(v));
    return result;
  };
  EXPECT_EQ(components, (std::vector{ids({2, 3, 7}), ids({0, 5}), ids({1, 4})}));
}

}  // namespace
}  // namespace rotunda::sfm
