#include "sfm/communities.h"

#include <gtest/gtest.h>
#include <igraph.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <random>
#include <string>

namespace rotunda::sfm {
namespace {

using Edges = std::map<std::pair<uint32_t, uint32_t>, double>;  // first < second

struct TestGraph {
  std::string name;
  uint32_t nodes = 0;
  Edges edges;

  void Add(uint32_t a, uint32_t b, double weight = 1) {
    if (a != b) edges[{std::min(a, b), std::max(a, b)}] = weight;
  }
  WeightedGraph Graph() const {
    WeightedGraph graph;
    graph.neighbours.resize(nodes);
    for (const auto& [ends, weight] : edges) {
      graph.neighbours[ends.first].push_back({ends.second, weight});
      graph.neighbours[ends.second].push_back({ends.first, weight});
    }
    for (std::vector<GraphNeighbour>& row : graph.neighbours) {
      std::sort(row.begin(), row.end(),
                [](const GraphNeighbour& a, const GraphNeighbour& b) { return a.node < b.node; });
    }
    return graph;
  }
};

double Uniform(std::mt19937_64& random) { return static_cast<double>(random() >> 11) * 0x1p-53; }

TestGraph RingOfCliques(uint32_t cliques, uint32_t size) {
  TestGraph graph{"ring of cliques", cliques * size, {}};
  for (uint32_t c = 0; c < cliques; ++c) {
    for (uint32_t i = 0; i < size; ++i) {
      for (uint32_t j = i + 1; j < size; ++j) graph.Add(c * size + i, c * size + j);
    }
    graph.Add(c * size, (c + 1) % cliques * size + 1);
  }
  return graph;
}

/// Groups of rising size; a node has about `inside` edges within its group and `outside` others.
TestGraph Planted(const std::string& name, const std::vector<uint32_t>& sizes, double inside,
                  double outside, bool weighted) {
  std::mt19937_64 random(11);
  std::vector<uint32_t> group;
  for (uint32_t g = 0; g < sizes.size(); ++g) group.insert(group.end(), sizes[g], g);
  TestGraph graph{name, static_cast<uint32_t>(group.size()), {}};
  for (uint32_t i = 0; i < graph.nodes; ++i) {
    for (uint32_t j = i + 1; j < graph.nodes; ++j) {
      const double p = group[i] == group[j] ? inside / sizes[group[i]] : outside / graph.nodes;
      if (Uniform(random) < p)
        graph.Add(i, j, weighted ? 1.0 + std::floor(9 * Uniform(random)) : 1);
    }
  }
  return graph;
}

TestGraph Grid(uint32_t side) {
  TestGraph graph{"grid", side * side, {}};
  for (uint32_t y = 0; y < side; ++y) {
    for (uint32_t x = 0; x < side; ++x) {
      if (x + 1 < side) graph.Add(y * side + x, y * side + x + 1);
      if (y + 1 < side) graph.Add(y * side + x, (y + 1) * side + x);
    }
  }
  return graph;
}

/// Points in the unit square (`around`: on a cylinder), joined when nearer than `reach`; like the
/// tracks on a body. Weighted: more, the nearer they are.
TestGraph Geometric(const std::string& name, uint32_t nodes, double reach, bool around,
                    bool weighted) {
  std::mt19937_64 random(12);
  std::vector<std::pair<double, double>> points;
  for (uint32_t i = 0; i < nodes; ++i) points.emplace_back(Uniform(random), Uniform(random));
  TestGraph graph{name, nodes, {}};
  for (uint32_t i = 0; i < nodes; ++i) {
    for (uint32_t j = i + 1; j < nodes; ++j) {
      double dx = std::abs(points[i].first - points[j].first);
      if (around) dx = std::min(dx, 1 - dx);
      const double distance = std::hypot(dx, points[i].second - points[j].second);
      if (distance >= reach) continue;
      graph.Add(i, j, weighted ? std::ceil(20 * (1 - distance / reach)) : 1);
    }
  }
  return graph;
}

TestGraph Sparse(uint32_t nodes, uint32_t edges) {
  std::mt19937_64 random(13);
  TestGraph graph{"random, sparse", nodes, {}};
  while (graph.edges.size() < edges) {
    graph.Add(static_cast<uint32_t>(random() % nodes), static_cast<uint32_t>(random() % nodes));
  }
  return graph;
}

/// The same graph in igraph, and what igraph makes of it.
class Igraph {
 public:
  explicit Igraph(const TestGraph& graph) {
    igraph_vector_int_t ends;
    igraph_vector_int_init(&ends, 0);
    igraph_vector_init(&weights_, 0);
    for (const auto& [pair, weight] : graph.edges) {
      igraph_vector_int_push_back(&ends, pair.first);
      igraph_vector_int_push_back(&ends, pair.second);
      igraph_vector_push_back(&weights_, weight);
    }
    igraph_create(&graph_, &ends, graph.nodes, IGRAPH_UNDIRECTED);
    igraph_vector_int_destroy(&ends);
  }
  ~Igraph() {
    igraph_destroy(&graph_);
    igraph_vector_destroy(&weights_);
  }
  Igraph(const Igraph&) = delete;
  Igraph& operator=(const Igraph&) = delete;

  double Modularity(const std::vector<uint32_t>& of_node, double resolution) const {
    igraph_vector_int_t membership;
    igraph_vector_int_init(&membership, 0);
    for (uint32_t community : of_node) igraph_vector_int_push_back(&membership, community);
    igraph_real_t modularity = 0;
    igraph_modularity(&graph_, &membership, &weights_, resolution, false, &modularity);
    igraph_vector_int_destroy(&membership);
    return modularity;
  }

  /// Best of `runs` of igraph's Louvain, each with an order of nodes of its own; final level.
  double BestLouvain(double resolution, int runs) const {
    double best = -std::numeric_limits<double>::infinity();
    for (int run = 0; run < runs; ++run) {
      igraph_rng_seed(igraph_rng_default(), static_cast<igraph_uint_t>(run));
      igraph_vector_int_t membership;
      igraph_vector_int_init(&membership, 0);
      igraph_community_multilevel(&graph_, &weights_, resolution, &membership, nullptr, nullptr);
      igraph_real_t modularity = 0;
      igraph_modularity(&graph_, &membership, &weights_, resolution, false, &modularity);
      igraph_vector_int_destroy(&membership);
      best = std::max<double>(best, modularity);
    }
    return best;
  }

 private:
  igraph_t graph_;
  igraph_vector_t weights_;
};

TestGraph KarateClub() {
  igraph_t club;
  igraph_famous(&club, "Zachary");
  TestGraph graph{"karate club", static_cast<uint32_t>(igraph_vcount(&club)), {}};
  for (igraph_integer_t i = 0; i < igraph_ecount(&club); ++i) {
    graph.Add(static_cast<uint32_t>(IGRAPH_FROM(&club, i)),
              static_cast<uint32_t>(IGRAPH_TO(&club, i)));
  }
  igraph_destroy(&club);
  return graph;
}

std::vector<TestGraph> AllGraphs() {
  const std::vector<uint32_t> equal(8, 32), mixed = {10, 20, 30, 40, 60, 80, 120};
  return {KarateClub(),
          RingOfCliques(30, 5),
          Planted("planted, little mixing", equal, 14, 2, false),
          Planted("planted, mixing", equal, 10, 6, false),
          Planted("planted, much mixing", equal, 8, 8, false),
          Planted("planted, sizes differ, weighted", mixed, 10, 4, true),
          Grid(20),
          Geometric("geometric", 600, 0.08, false, false),
          Geometric("geometric, weighted", 600, 0.08, false, true),
          Geometric("geometric, cylinder, weighted", 800, 0.07, true, true),
          Sparse(300, 600)};
}

Communities Build(const TestGraph& graph, double resolution = 1) {
  const Result<Communities> communities = BuildCommunities(graph.Graph(), {resolution});
  EXPECT_TRUE(communities.ok());
  return *communities;
}

TEST(BuildCommunities, ReachesTheBestOfManyRunsOfIgraph) {
  for (double resolution : {1.0, 2.0}) {
    for (const TestGraph& graph : AllGraphs()) {
      const Igraph igraph(graph);
      const Communities communities = Build(graph, resolution);
      const double best = igraph.BestLouvain(resolution, 10);
      EXPECT_GE(communities.modularity, best - 1e-9) << graph.name << ", gamma " << resolution;
      EXPECT_NEAR(communities.modularity, igraph.Modularity(communities.of_node, resolution), 1e-12)
          << graph.name;
    }
  }
}

TEST(Modularity, HandCases) {
  // Two triangles joined by one edge: 7 edges, degree sums 7 and 7.
  TestGraph graph{"two triangles", 6, {}};
  for (uint32_t base : {0U, 3U}) {
    graph.Add(base, base + 1);
    graph.Add(base, base + 2);
    graph.Add(base + 1, base + 2);
  }
  graph.Add(2, 3);
  EXPECT_NEAR(Modularity(graph.Graph(), {0, 0, 0, 1, 1, 1}, 1), 6.0 / 7 - 0.5, 1e-15);
  EXPECT_NEAR(Modularity(graph.Graph(), {0, 0, 0, 1, 1, 1}, 1.5), 6.0 / 7 - 0.75, 1e-15);
  EXPECT_NEAR(Modularity(graph.Graph(), {0, 0, 0, 0, 0, 0}, 1), 0, 1e-15);
  EXPECT_EQ(Modularity(WeightedGraph{}, {}, 1), 0);
  EXPECT_EQ(Modularity(WeightedGraph{{{}, {}}}, {0, 1}, 1), 0);
}

/// Largest modularity over all partitions: community of node i is at most one more than those
/// before it use.
double BestOfAll(const WeightedGraph& graph, std::vector<uint32_t>& labels, uint32_t used) {
  if (labels.size() == graph.neighbours.size()) return Modularity(graph, labels, 1);
  double best = -1;
  for (uint32_t label = 0; label <= used; ++label) {
    labels.push_back(label);
    best = std::max(best, BestOfAll(graph, labels, std::max(used, label + 1)));
    labels.pop_back();
  }
  return best;
}

TEST(BuildCommunities, FindsTheBestOfAllPartitionsOfSmallGraphs) {
  std::mt19937_64 random(14);
  for (int round = 0; round < 30; ++round) {
    TestGraph graph{"small", 8, {}};
    for (uint32_t i = 0; i < graph.nodes; ++i) {
      for (uint32_t j = i + 1; j < graph.nodes; ++j) {
        if (random() % 5 < 2) graph.Add(i, j, 1.0 + static_cast<double>(random() % 4));
      }
    }
    std::vector<uint32_t> labels;
    const double best = BestOfAll(graph.Graph(), labels, 0);
    EXPECT_NEAR(Build(graph).modularity, best, 1e-12) << "round " << round;
  }
}

TEST(BuildCommunities, CommunitiesAreConnectedAndNumberedBySize) {
  for (double resolution : {0.1, 1.0, 3.0}) {
    for (const TestGraph& test : AllGraphs()) {
      const WeightedGraph graph = test.Graph();
      const Communities communities = Build(test, resolution);
      ASSERT_EQ(communities.of_node.size(), test.nodes);
      std::vector<size_t> sizes(communities.count, 0), pieces(communities.count, 0);
      std::vector<uint32_t> smallest;
      std::vector<bool> reached(test.nodes, false);
      for (uint32_t start = 0; start < test.nodes; ++start) {
        const uint32_t community = communities.of_node[start];
        ASSERT_LT(community, communities.count);
        ++sizes[community];
        if (reached[start]) continue;
        ++pieces[community];
        smallest.resize(communities.count, test.nodes);
        smallest[community] = std::min(smallest[community], start);
        std::vector<uint32_t> open = {start};
        reached[start] = true;
        while (!open.empty()) {
          const uint32_t node = open.back();
          open.pop_back();
          for (const GraphNeighbour& neighbour : graph.neighbours[node]) {
            if (reached[neighbour.node] || communities.of_node[neighbour.node] != community) {
              continue;
            }
            reached[neighbour.node] = true;
            open.push_back(neighbour.node);
          }
        }
      }
      EXPECT_EQ(pieces, std::vector<size_t>(communities.count, 1)) << test.name;
      for (size_t c = 1; c < communities.count; ++c) {
        EXPECT_TRUE(sizes[c - 1] > sizes[c] ||
                    (sizes[c - 1] == sizes[c] && smallest[c - 1] < smallest[c]));
      }
    }
  }
}

TEST(BuildCommunities, TheSameEveryTime) {
  for (const TestGraph& graph : AllGraphs()) {
    const Communities first = Build(graph), second = Build(graph);
    EXPECT_EQ(first.of_node, second.of_node);
    EXPECT_EQ(first.modularity, second.modularity);
  }
}

TEST(BuildCommunities, NodesWithoutEdgesStayAlone) {
  EXPECT_EQ(Build({"none", 0, {}}).count, 0U);
  EXPECT_EQ(Build({"no edges", 3, {}}).of_node, (std::vector<uint32_t>{0, 1, 2}));
  TestGraph graph{"one edge", 4, {}};
  graph.Add(1, 3);
  EXPECT_EQ(Build(graph).of_node, (std::vector<uint32_t>{1, 0, 2, 0}));
}

TEST(BuildCommunities, RefusesBadOptionsAndGraphs) {
  const auto code = [](const WeightedGraph& graph, double resolution) {
    const Result<Communities> communities = BuildCommunities(graph, {resolution});
    return communities.ok() ? std::optional<ErrorCode>() : communities.error().code;
  };
  const WeightedGraph good{{{{1, 1.0}}, {{0, 1.0}}}};
  EXPECT_EQ(code(good, 1), std::nullopt);
  EXPECT_EQ(code(good, 0), ErrorCode::kInvalidArgument);
  EXPECT_EQ(code(good, std::nan("")), ErrorCode::kInvalidArgument);
  EXPECT_EQ(code({{{{2, 1.0}}, {}}}, 1), ErrorCode::kInvalidArgument);
  EXPECT_EQ(code({{{{0, 1.0}}}}, 1), ErrorCode::kInvalidArgument);
  EXPECT_EQ(code({{{{1, -1.0}}, {{0, -1.0}}}}, 1), ErrorCode::kInvalidArgument);
  EXPECT_EQ(code({{{{1, 1.0}, {1, 1.0}}, {{0, 1.0}}}}, 1), ErrorCode::kInvalidArgument);
}

}  // namespace
}  // namespace rotunda::sfm
