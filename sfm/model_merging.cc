#include "sfm/model_merging.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "sfm/bidirectional_consistency.h"
#include "sfm/disjoint_sets.h"
#include "sfm/model_fusion.h"

namespace rotunda::sfm {
namespace {

constexpr char kStage[] = "merging";

struct Node {
  Reconstruction model;
  PointIndex index;
  size_t first_member;  // smallest place of the input models in it
};

/// How two nodes could become one.
struct Attempt {
  size_t source = 0, target = 0;  // places of nodes
  bool linked = false;
  SimilarityVerdict verdict;
  double cost_px2 = 0;  // what weighs the edge
};

class Merger {
 public:
  Merger(const MergeInput& input, std::vector<Reconstruction> models, const MergeOptions& options,
         RunContext& context)
      : input_(input), options_(options), context_(context) {
    for (size_t m = 0; m < models.size(); ++m) {
      PointIndex index(input.features, models[m]);
      nodes_.push_back({std::move(models[m]), std::move(index), m});
    }
  }

  Status Run() {
    const size_t models = nodes_.size();
    bool merged = true;
    while (merged) {
      const std::vector<Attempt> attempts = AllAttempts();
      if (context_.Stopped()) return Error{ErrorCode::kCancelled, "stopped", kStage};
      merged = MergeInward(SpanningForest(attempts));
      if (!merged) TakeRefusals(attempts);
      context_.Report(kStage, models - nodes_.size(), models);
    }
    return {};
  }

  MergeResult Take() {
    std::stable_sort(nodes_.begin(), nodes_.end(), [](const Node& a, const Node& b) {
      const size_t a_images = RegisteredCount(a.model), b_images = RegisteredCount(b.model);
      if (a_images != b_images) return a_images > b_images;
      return a.model.points.size() > b.model.points.size();
    });
    for (Node& node : nodes_) result_.models.push_back(std::move(node.model));
    return std::move(result_);
  }

 private:
  /// Made where they are needed: those of all pairs of models at once would fill the memory.
  std::vector<ModelLink> Links(const Attempt& attempt) const {
    const Node &source = nodes_[attempt.source], &target = nodes_[attempt.target];
    return LinkModels(input_, {source.model, source.index}, {target.model, target.index});
  }

  /// The smaller one is the source; ties: the later one.
  Attempt Try(size_t a, size_t b) const {
    Attempt attempt;
    const size_t a_images = RegisteredCount(nodes_[a].model);
    const size_t b_images = RegisteredCount(nodes_[b].model);
    const bool a_stays = a_images > b_images || (a_images == b_images && a < b);
    attempt.target = a_stays ? a : b;
    attempt.source = a_stays ? b : a;
    const Reconstruction& source = nodes_[attempt.source].model;
    const Reconstruction& target = nodes_[attempt.target].model;
    const std::vector<ModelLink> links = Links(attempt);
    attempt.linked = !links.empty();
    attempt.verdict = EstimateSimilarity(links, source, target, options_.similarity,
                                         SeedOf(attempt.source, attempt.target));
    if (attempt.verdict.target_from_source) Refine(links, attempt);
    return attempt;
  }

  /// Of the first input models, so that it does not depend on the places of the nodes.
  uint64_t SeedOf(size_t source, size_t target) const {
    return DeriveSeed(DeriveSeed(context_.seed, nodes_[source].first_member),
                      nodes_[target].first_member);
  }

  void Refine(const std::vector<ModelLink>& links, Attempt& attempt) const {
    const Reconstruction& source = nodes_[attempt.source].model;
    const Reconstruction& target = nodes_[attempt.target].model;
    std::vector<ModelLink> agreeing;
    for (size_t k = 0; k < links.size(); ++k) {
      if (attempt.verdict.agrees[k]) agreeing.push_back(links[k]);
    }
    const Consistency consistency = MinimiseInconsistency(
        {input_.features, source, target, agreeing}, *attempt.verdict.target_from_source,
        {options_.reprojection_weight, options_.bidirectional}, context_.stop);
    attempt.cost_px2 = options_.mean_cost ? consistency.mean_cost_px2 : consistency.cost_px2;
    attempt.verdict =
        JudgeSimilarity(links, source, target, consistency.target_from_source, options_.similarity);
  }

  /// Of all pairs of nodes, in order of (first, second).
  std::vector<Attempt> AllAttempts() const {
    std::vector<std::pair<size_t, size_t>> pairs;
    for (size_t a = 0; a < nodes_.size(); ++a) {
      for (size_t b = a + 1; b < nodes_.size(); ++b) pairs.emplace_back(a, b);
    }
    std::vector<Attempt> attempts(pairs.size());
    context_.threads.ParallelFor(
        pairs.size(), [&](size_t i) { attempts[i] = Try(pairs[i].first, pairs[i].second); },
        context_.stop);
    return attempts;
  }

  /// Kruskal; cheapest first, ties by the attempts' order.
  std::vector<Attempt> SpanningForest(const std::vector<Attempt>& attempts) const {
    std::vector<size_t> order(attempts.size());
    std::iota(order.begin(), order.end(), size_t{0});
    std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
      return attempts[a].cost_px2 < attempts[b].cost_px2;
    });
    DisjointSets trees(nodes_.size());
    std::vector<Attempt> forest;
    for (const size_t a : order) {
      if (!attempts[a].verdict.target_from_source) continue;
      if (trees.Unite(attempts[a].source, attempts[a].target)) forest.push_back(attempts[a]);
    }
    return forest;
  }

  /// Works the forest off, each time the cheapest edge that ends in a leaf. False: nothing merged.
  bool MergeInward(std::vector<Attempt> forest) {
    std::vector<bool> grown(nodes_.size()), gone(nodes_.size());
    while (!forest.empty()) {
      const auto leaf = std::find_if(forest.begin(), forest.end(), [&](const Attempt& edge) {
        return Degree(forest, edge.source) == 1 || Degree(forest, edge.target) == 1;
      });
      Attempt edge = *leaf;
      forest.erase(leaf);
      if (grown[edge.source] || grown[edge.target]) edge = Try(edge.source, edge.target);
      if (!edge.verdict.target_from_source) continue;
      Merge(edge);
      grown[edge.target] = gone[edge.source] = true;
      for (Attempt& other : forest) {
        if (other.source == edge.source) other.source = edge.target;
        if (other.target == edge.source) other.target = edge.target;
      }
    }
    std::vector<Node> left;
    for (size_t n = 0; n < nodes_.size(); ++n) {
      if (!gone[n]) left.push_back(std::move(nodes_[n]));
    }
    nodes_ = std::move(left);
    return std::find(gone.begin(), gone.end(), true) != gone.end();
  }

  static size_t Degree(const std::vector<Attempt>& forest, size_t node) {
    return static_cast<size_t>(std::count_if(
        forest.begin(), forest.end(),
        [&](const Attempt& edge) { return edge.source == node || edge.target == node; }));
  }

  void Merge(const Attempt& edge) {
    Node& source = nodes_[edge.source];
    Node& target = nodes_[edge.target];
    const Reconstruction moved = Transformed(source.model, *edge.verdict.target_from_source);
    target.model =
        FuseModels({input_.features, moved, target.model, Links(edge), edge.verdict.agrees},
                   options_.max_duplicate_px);
    target.index = PointIndex(input_.features, target.model);
    target.first_member = std::min(target.first_member, source.first_member);
  }

  /// Of a round that merged nothing: its attempts are between the models that are left.
  void TakeRefusals(const std::vector<Attempt>& attempts) {
    for (const Attempt& attempt : attempts) {
      if (attempt.linked) result_.refusals.push_back(attempt.verdict.refusal);
    }
  }

  const MergeInput& input_;
  const MergeOptions& options_;
  RunContext& context_;
  std::vector<Node> nodes_;
  MergeResult result_;
};

}  // namespace

Status MergeOptions::Validate() const {
  const auto bad = [](const char* field, double value, const char* expected) {
    return Error{ErrorCode::kInvalidArgument,
                 std::to_string(value) + " is out of range, expected " + expected, field};
  };
  if (!(reprojection_weight >= 0)) return bad("reprojection_weight", reprojection_weight, ">= 0");
  if (!(max_duplicate_px > 0)) return bad("max_duplicate_px", max_duplicate_px, "> 0");
  return similarity.Validate();
}

Result<MergeResult> MergeModels(const MergeInput& input, std::vector<Reconstruction> models,
                                const MergeOptions& options, RunContext& context) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  for (size_t m = 0; m < models.size(); ++m) {
    if (models[m].cam_from_model.size() == input.features.images.size()) continue;
    return Error{ErrorCode::kInvalidArgument,
                 "found " + std::to_string(models[m].cam_from_model.size()) +
                     " pictures, expected " + std::to_string(input.features.images.size()),
                 "model " + std::to_string(m)};
  }
  Merger merger(input, std::move(models), options, context);
  ROTUNDA_RETURN_IF_ERROR(merger.Run());
  return merger.Take();
}

}  // namespace rotunda::sfm
