#include "sfm/communities.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <numeric>
#include <random>
#include <string>

namespace rotunda::sfm {
namespace {

/// The method is greedy: the order of the nodes decides where it ends. The best of several orders
/// is taken, of which the first is that of the graph and the others are shuffled. Large graphs,
/// whose results hardly differ, get fewer, so that about kEdgesInAll edges are gone over.
constexpr size_t kMinOrders = 4, kMaxOrders = 16;
constexpr size_t kEdgesInAll = 1'000'000;
/// Gains of modularity below this are rounding.
constexpr double kMinGain = 1e-11;

using Labels = std::vector<uint32_t>;

/// A graph whose nodes may stand for many of the one below; rows of neighbours without loops.
struct Level {
  std::vector<size_t> begins;  // of each node's row; one more at the end
  std::vector<GraphNeighbour> neighbours;
  std::vector<double> degrees;  // with twice the weight inside the node
  double total = 0;             // sum of the degrees, 2m

  size_t size() const { return degrees.size(); }
};

Level BottomLevel(const WeightedGraph& graph) {
  Level level;
  level.begins = {0};
  for (const std::vector<GraphNeighbour>& row : graph.neighbours) {
    double degree = 0;
    for (const GraphNeighbour& neighbour : row) degree += neighbour.weight;
    level.neighbours.insert(level.neighbours.end(), row.begin(), row.end());
    level.begins.push_back(level.neighbours.size());
    level.degrees.push_back(degree);
    level.total += degree;
  }
  return level;
}

/// Weight from one node to each group of nodes, kept sparse: one pass over a row.
class WeightToGroup {
 public:
  explicit WeightToGroup(size_t groups) : weight_(groups, 0), met_(groups, false) {}

  /// Groups of the node's neighbours in the order in which they are met. `skip(n)` leaves n out.
  template <typename Skip>
  const Labels& Collect(const Level& level, uint32_t node, const Labels& group, Skip skip) {
    for (uint32_t g : groups_) met_[g] = false, weight_[g] = 0;
    groups_.clear();
    for (size_t i = level.begins[node]; i < level.begins[node + 1]; ++i) {
      const GraphNeighbour& neighbour = level.neighbours[i];
      if (skip(neighbour.node)) continue;
      const uint32_t g = group[neighbour.node];
      if (!met_[g]) groups_.push_back(g);
      met_[g] = true;
      weight_[g] += neighbour.weight;
    }
    return groups_;
  }
  double weight(uint32_t group) const { return weight_[group]; }

 private:
  std::vector<double> weight_;
  std::vector<bool> met_;
  Labels groups_;
};

Labels Singletons(size_t count) {
  Labels labels(count);
  std::iota(labels.begin(), labels.end(), 0U);
  return labels;
}

/// Fisher-Yates by hand: std::shuffle may differ between standard libraries.
void Shuffle(Labels& order, std::mt19937_64& random) {
  for (size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[random() % i]);
}

/// Renumbers to 0 .. count-1 in the order of the nodes; returns count.
uint32_t Compact(Labels& labels) {
  constexpr uint32_t kNone = UINT32_MAX;
  Labels new_label(labels.empty() ? 0 : *std::max_element(labels.begin(), labels.end()) + size_t{1},
                   kNone);
  uint32_t count = 0;
  for (uint32_t& label : labels) {
    if (new_label[label] == kNone) new_label[label] = count++;
    label = new_label[label];
  }
  return count;
}

/// Which community each node of a level is in, with the sums that a move needs. There are as many
/// communities as nodes; most are empty.
class Partition {
 public:
  Partition(const Level& level, Labels labels)
      : level_(level),
        labels_(std::move(labels)),
        degrees_(level.size(), 0),
        sizes_(level.size(), 0) {
    for (size_t i = 0; i < labels_.size(); ++i) {
      degrees_[labels_[i]] += level.degrees[i];
      ++sizes_[labels_[i]];
    }
    for (size_t c = sizes_.size(); c-- > 0;) {
      if (sizes_[c] == 0) empty_.push_back(static_cast<uint32_t>(c));
    }
  }

  const Labels& labels() const { return labels_; }
  uint32_t of(uint32_t node) const { return labels_[node]; }
  bool Alone(uint32_t node) const { return sizes_[labels_[node]] == 1; }
  uint32_t SomeEmpty() const { return empty_.back(); }  // there is one when a node is not alone
  /// Sum of the degrees of a community's nodes, without that of `node`.
  double DegreeWithout(uint32_t community, uint32_t node) const {
    return degrees_[community] - (labels_[node] == community ? level_.degrees[node] : 0);
  }

  void Move(uint32_t node, uint32_t to) {
    const uint32_t from = labels_[node];
    if (sizes_[to] == 0) empty_.pop_back();
    ++sizes_[to];
    if (--sizes_[from] == 0) empty_.push_back(from);
    degrees_[from] -= level_.degrees[node];
    degrees_[to] += level_.degrees[node];
    labels_[node] = to;
  }

 private:
  const Level& level_;
  Labels labels_;
  std::vector<double> degrees_;  // by community
  std::vector<uint32_t> sizes_;  // by community
  Labels empty_;
};

/// One search from one order of the nodes.
class Search {
 public:
  Search(double resolution, uint64_t order)
      : resolution_(resolution), order_(order), random_(order) {}

  /// Louvain with the refinement of Leiden (Traag et al., Sci. Rep. 2019) from `labels` on: move
  /// single nodes, cut each community into parts that hang together, make the parts the nodes of
  /// the next level, where they begin in their community.
  Labels Improve(const Level& bottom, Labels labels) {
    Labels node_of(Singletons(bottom.size()));  // by node of the bottom: node of the level
    Level level = bottom;
    Compact(labels);
    while (true) {
      labels = MoveNodes(level, std::move(labels));
      const uint32_t communities = Compact(labels);
      if (communities == level.size()) break;
      Labels part = Refine(level, labels);
      uint32_t parts = Compact(part);
      if (parts == level.size()) {  // nothing to be had by cutting: as Louvain does it
        part = labels;
        parts = communities;
      }
      Labels part_label(parts);
      for (size_t i = 0; i < part.size(); ++i) part_label[part[i]] = labels[i];
      for (uint32_t& node : node_of) node = part[node];
      level = Aggregate(level, part, parts);
      labels = std::move(part_label);
    }
    for (uint32_t& node : node_of) node = labels[node];
    return node_of;
  }

 private:
  Labels Order(size_t count) {
    Labels order = Singletons(count);
    if (order_ > 0) Shuffle(order, random_);
    return order;
  }

  /// Moves nodes to the community with the largest gain until none gains; a node whose neighbour
  /// has moved is looked at again.
  Labels MoveNodes(const Level& level, Labels labels) {
    Partition partition(level, std::move(labels));
    const Labels order = Order(level.size());
    std::deque<uint32_t> queue(order.begin(), order.end());
    std::vector<bool> queued(level.size(), true);
    WeightToGroup weights(level.size());
    while (!queue.empty()) {
      const uint32_t node = queue.front();
      queue.pop_front();
      queued[node] = false;
      const uint32_t to = BestCommunity(level, partition, node, weights);
      if (to == partition.of(node)) continue;
      partition.Move(node, to);
      for (size_t i = level.begins[node]; i < level.begins[node + 1]; ++i) {
        const uint32_t other = level.neighbours[i].node;
        if (queued[other] || partition.of(other) == to) continue;
        queued[other] = true;
        queue.push_back(other);
      }
    }
    return partition.labels();
  }

  uint32_t BestCommunity(const Level& level, const Partition& partition, uint32_t node,
                         WeightToGroup& weights) const {
    const Labels& near =
        weights.Collect(level, node, partition.labels(), [](uint32_t) { return false; });
    // Half the gain of modularity by joining c from being alone, times the total.
    const auto gain = [&](uint32_t c) {
      return weights.weight(c) -
             resolution_ * level.degrees[node] * partition.DegreeWithout(c, node) / level.total;
    };
    uint32_t to = partition.of(node);
    double best = gain(to) + kMinGain * level.total;
    for (uint32_t c : near) {
      if (const double g = gain(c); g > best) to = c, best = g;
    }
    return best < 0 && !partition.Alone(node) ? partition.SomeEmpty() : to;
  }

  /// Parts of communities: every node begins alone and joins the part of its community that gains
  /// most, if node and part are bound well enough to the rest of the community (Leiden's gamma
  /// connectedness). Parts are connected.
  Labels Refine(const Level& level, const Labels& labels) {
    const auto count = static_cast<uint32_t>(level.size());
    const auto bound = [&](double weight, double degree, double community) {
      return weight >= resolution_ * degree * (community - degree) / level.total - kMinGain;
    };
    std::vector<double> community(count, 0);
    for (uint32_t i = 0; i < count; ++i) community[labels[i]] += level.degrees[i];
    Labels part = Singletons(count);
    std::vector<double> degree = level.degrees;  // by part
    std::vector<double> outside(count, 0);  // weight from the part to the rest of its community
    for (uint32_t i = 0; i < count; ++i) {
      for (size_t k = level.begins[i]; k < level.begins[i + 1]; ++k) {
        const GraphNeighbour& neighbour = level.neighbours[k];
        if (labels[neighbour.node] == labels[i]) outside[i] += neighbour.weight;
      }
    }
    std::vector<uint32_t> size(count, 1);
    WeightToGroup weights(count);
    for (uint32_t node : Order(count)) {
      const double total = community[labels[node]];
      if (part[node] != node || size[node] > 1) continue;
      if (!bound(outside[node], level.degrees[node], total)) continue;
      const Labels& parts = weights.Collect(
          level, node, part, [&](uint32_t other) { return labels[other] != labels[node]; });
      uint32_t to = node;
      double best = kMinGain * level.total;
      for (uint32_t p : parts) {
        const double gain =
            weights.weight(p) - resolution_ * level.degrees[node] * degree[p] / level.total;
        if (gain > best && bound(outside[p], degree[p], total)) to = p, best = gain;
      }
      if (to == node) continue;
      part[node] = to;
      size[node] = 0;
      ++size[to];
      outside[to] += outside[node] - 2 * weights.weight(to);
      degree[to] += level.degrees[node];
    }
    return part;
  }

  static Level Aggregate(const Level& level, const Labels& part, uint32_t parts) {
    std::vector<Labels> members(parts);
    for (uint32_t i = 0; i < part.size(); ++i) members[part[i]].push_back(i);
    Level next;
    next.total = level.total;
    next.begins = {0};
    std::map<uint32_t, double> row;
    for (uint32_t p = 0; p < parts; ++p) {
      row.clear();
      double degree = 0;
      for (uint32_t i : members[p]) {
        degree += level.degrees[i];
        for (size_t k = level.begins[i]; k < level.begins[i + 1]; ++k) {
          const uint32_t other = part[level.neighbours[k].node];
          if (other != p) row[other] += level.neighbours[k].weight;
        }
      }
      for (const auto& [other, weight] : row) next.neighbours.push_back({other, weight});
      next.begins.push_back(next.neighbours.size());
      next.degrees.push_back(degree);
    }
    return next;
  }

  double resolution_;
  uint64_t order_;
  std::mt19937_64 random_;
};

/// Every connected piece of a community becomes one of its own.
Labels SplitIntoConnected(const WeightedGraph& graph, const Labels& labels) {
  constexpr uint32_t kNone = UINT32_MAX;
  Labels piece(labels.size(), kNone);
  uint32_t count = 0;
  for (uint32_t start = 0; start < labels.size(); ++start) {
    if (piece[start] != kNone) continue;
    Labels open = {start};
    piece[start] = count;
    while (!open.empty()) {
      const uint32_t node = open.back();
      open.pop_back();
      for (const GraphNeighbour& neighbour : graph.neighbours[node]) {
        if (piece[neighbour.node] != kNone || labels[neighbour.node] != labels[node]) continue;
        piece[neighbour.node] = count;
        open.push_back(neighbour.node);
      }
    }
    ++count;
  }
  return piece;
}

/// Falling size, ties by the smallest node.
Communities Numbered(const WeightedGraph& graph, Labels labels, double resolution) {
  Communities communities;
  communities.count = Compact(labels);  // by smallest node
  std::vector<size_t> sizes(communities.count, 0);
  for (uint32_t label : labels) ++sizes[label];
  Labels order = Singletons(communities.count);
  std::stable_sort(order.begin(), order.end(),
                   [&](uint32_t a, uint32_t b) { return sizes[a] > sizes[b]; });
  Labels rank(communities.count);
  for (uint32_t i = 0; i < order.size(); ++i) rank[order[i]] = i;
  for (uint32_t label : labels) communities.of_node.push_back(rank[label]);
  communities.modularity = Modularity(graph, communities.of_node, resolution);
  return communities;
}

Status CheckGraph(const WeightedGraph& graph) {
  for (size_t i = 0; i < graph.neighbours.size(); ++i) {
    const std::vector<GraphNeighbour>& row = graph.neighbours[i];
    for (size_t k = 0; k < row.size(); ++k) {
      const bool in_order = k == 0 || row[k - 1].node < row[k].node;
      const bool allowed = row[k].node < graph.neighbours.size() && row[k].node != i;
      if (in_order && allowed && row[k].weight > 0 && std::isfinite(row[k].weight)) continue;
      return Error{ErrorCode::kInvalidArgument,
                   "node " + std::to_string(i) + " has a neighbour " + std::to_string(row[k].node) +
                       " of weight " + std::to_string(row[k].weight) +
                       ", expected other nodes in rising order and positive weights",
                   "communities"};
    }
  }
  return {};
}

}  // namespace

Status CommunityOptions::Validate() const {
  if (resolution > 0 && std::isfinite(resolution)) return {};
  return Error{ErrorCode::kInvalidArgument,
               "resolution is " + std::to_string(resolution) + ", expected more than 0",
               "communities"};
}

double Modularity(const WeightedGraph& graph, const std::vector<uint32_t>& of_node,
                  double resolution) {
  if (of_node.empty()) return 0;
  const size_t count = *std::max_element(of_node.begin(), of_node.end()) + size_t{1};
  std::vector<double> inner(count, 0), degree(count, 0);  // inner: every edge from both ends
  double total = 0;
  for (size_t i = 0; i < graph.neighbours.size(); ++i) {
    for (const GraphNeighbour& neighbour : graph.neighbours[i]) {
      total += neighbour.weight;
      degree[of_node[i]] += neighbour.weight;
      if (of_node[neighbour.node] == of_node[i]) inner[of_node[i]] += neighbour.weight;
    }
  }
  if (total == 0) return 0;
  double modularity = 0;
  for (size_t c = 0; c < count; ++c) {
    modularity += inner[c] / total - resolution * (degree[c] / total) * (degree[c] / total);
  }
  return modularity;
}

Result<Communities> BuildCommunities(const WeightedGraph& graph, const CommunityOptions& options) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  ROTUNDA_RETURN_IF_ERROR(CheckGraph(graph));
  const Level bottom = BottomLevel(graph);
  Labels best = Singletons(bottom.size());
  double best_modularity = Modularity(graph, best, options.resolution);
  const size_t edges = bottom.neighbours.size() / 2;
  const size_t orders = edges == 0 ? 0 : std::clamp(kEdgesInAll / edges, kMinOrders, kMaxOrders);
  for (uint64_t order = 0; order < orders; ++order) {
    Search search(options.resolution, order);
    Labels labels = Singletons(bottom.size());
    double modularity = Modularity(graph, labels, options.resolution);
    while (true) {
      Labels next = SplitIntoConnected(graph, search.Improve(bottom, labels));
      const double reached = Modularity(graph, next, options.resolution);
      if (reached <= modularity + kMinGain) break;
      labels = std::move(next);
      modularity = reached;
    }
    if (modularity > best_modularity + kMinGain) {
      best = std::move(labels);
      best_modularity = modularity;
    }
  }
  return Numbered(graph, std::move(best), options.resolution);
}

}  // namespace rotunda::sfm
