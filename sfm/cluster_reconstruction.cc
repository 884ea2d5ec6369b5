#include "sfm/cluster_reconstruction.h"

#include <algorithm>
#include <atomic>
#include <iterator>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "sfm/consistent_view_graph.h"
#include "sfm/tracks.h"
#include "sfm/view_graph.h"

namespace rotunda::sfm {
namespace {

constexpr char kStage[] = "cluster reconstruction";

size_t CommonImages(const ImageCluster& a, const ImageCluster& b) {
  std::vector<ImageId> common;
  std::set_intersection(a.images.begin(), a.images.end(), b.images.begin(), b.images.end(),
                        std::back_inserter(common));
  return common.size();
}

template <typename T>
std::vector<T> Union(const std::vector<T>& a, const std::vector<T>& b) {
  std::vector<T> both;
  std::set_union(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(both));
  return both;
}

void SortBySize(std::vector<ImageCluster>& clusters) {
  std::sort(clusters.begin(), clusters.end(), [](const ImageCluster& a, const ImageCluster& b) {
    if (a.images.size() != b.images.size()) return a.images.size() > b.images.size();
    return a.parts.front() < b.parts.front();
  });
}

/// ConsistentViewGraph::Margin of the matches within the images; infinite where nothing is off.
double MarginOf(const IncrementalInput& input, const Correction& correction,
                const std::vector<ImageId>& images, const ClusterOptions& options) {
  const TwoViews matches = MatchesWithinParts(input, correction, images, options);
  const auto consistent =
      BuildConsistentViewGraph(BuildViewGraph(input.features, matches), matches, {});
  return consistent->Margin().value_or(std::numeric_limits<double>::infinity());
}

/// Clusters that become one where they share enough images.
class ClusterMerging {
 public:
  ClusterMerging(const IncrementalInput& input, const Correction& correction,
                 const ClusterOptions& options)
      : input_(input), correction_(correction), options_(options) {}

  /// Takes up the clusters behind `place` that belong to it until none is left.
  void Absorb(std::vector<ImageCluster>& clusters, size_t place) {
    for (size_t other = place + 1; other < clusters.size();) {
      ImageCluster& cluster = clusters[place];
      const std::vector<ImageId> images = Union(cluster.images, clusters[other].images);
      if (CommonImages(cluster, clusters[other]) <= options_.max_common_images ||
          !IsConsistent(cluster, clusters[other], images)) {
        ++other;
        continue;
      }
      cluster.images = images;
      cluster.parts = Union(cluster.parts, clusters[other].parts);
      clusters.erase(clusters.begin() + static_cast<std::ptrdiff_t>(other));
      other = place + 1;
    }
  }

 private:
  bool IsConsistent(const ImageCluster& a, const ImageCluster& b,
                    const std::vector<ImageId>& merged) {
    if (!options_.undo_inconsistent_merges) return true;
    const double margin = Margin(merged);
    return margin >= options_.trusted_margin ||
           (margin >= Margin(a.images) && margin >= Margin(b.images));
  }

  double Margin(const std::vector<ImageId>& images) {
    const auto known = margins_.find(images);
    if (known != margins_.end()) return known->second;
    return margins_[images] = MarginOf(input_, correction_, images, options_);
  }

  const IncrementalInput& input_;
  const Correction& correction_;
  const ClusterOptions& options_;
  std::map<std::vector<ImageId>, double> margins_;
};

Result<IncrementalResult> Reconstruct(const IncrementalInput& input, const TwoViews& two_views,
                                      const IncrementalOptions& options, RunContext& context) {
  const ViewGraph graph = BuildViewGraph(input.features, two_views);
  const Tracks tracks = BuildTracks(input.features, two_views, graph);
  return BuildReconstructions({input.features, input.intrinsics, two_views, graph, tracks}, options,
                              context);
}

/// One result a cluster; nullopt: cancelled before it began.
using ClusterResults = std::vector<std::optional<Result<IncrementalResult>>>;

/// The models of all clusters; an error when there are none.
Result<std::vector<Reconstruction>> ModelsOf(ClusterResults reconstructed) {
  std::vector<Reconstruction> models;
  std::string reason = "no picture is related to any part of the scene";
  for (size_t c = reconstructed.size(); c-- > 0;) {
    if (!*reconstructed[c]) reason = reconstructed[c]->error().message;
  }
  for (std::optional<Result<IncrementalResult>>& own : reconstructed) {
    if (!*own) continue;
    std::move((*own)->models.begin(), (*own)->models.end(), std::back_inserter(models));
  }
  if (!models.empty()) return models;
  return Error{ErrorCode::kFailed, "no cluster of pictures gives a model: " + reason, kStage};
}

}  // namespace

Status ClusterOptions::Validate() const {
  if (min_pair_matches < 1) {
    return Error{ErrorCode::kInvalidArgument, "0 found, expected >= 1", "min_pair_matches"};
  }
  if (trusted_margin > 0) return {};
  return Error{ErrorCode::kInvalidArgument, std::to_string(trusted_margin) + " found, expected > 0",
               "trusted_margin"};
}

std::vector<ImageCluster> BuildClusters(const IncrementalInput& input, const Correction& correction,
                                        const ClusterOptions& options) {
  std::vector<ImageCluster> clusters;
  for (uint32_t part = 0; part < correction.parts.size(); ++part) {
    if (correction.parts[part].images.empty()) continue;
    clusters.push_back({{part}, correction.parts[part].images});
  }
  SortBySize(clusters);
  ClusterMerging merging(input, correction, options);
  for (size_t place = 0; place < clusters.size(); ++place) merging.Absorb(clusters, place);
  SortBySize(clusters);
  return clusters;
}

TwoViews MatchesWithinParts(const IncrementalInput& input, const Correction& correction,
                            const std::vector<ImageId>& images, const ClusterOptions& options) {
  std::vector<bool> inside(input.features.images.size(), false);
  for (const ImageId image : images) inside[image.index()] = true;
  const auto part_of = [&](ImageId image, KeypointId keypoint) {
    return correction.part_of_keypoint[image.index()][keypoint.index()];
  };
  TwoViews result;
  for (const ViewGraphEdge& edge : input.view_graph.edges) {
    const auto [first, second] = edge.pair;
    if (!inside[first.index()] || !inside[second.index()]) continue;
    TwoView view = input.two_views.pairs[edge.two_view];
    std::erase_if(view.inliers, [&](const Match& match) {
      const auto part = part_of(first, match.first);
      return !part || part != part_of(second, match.second);
    });
    if (view.inliers.size() >= options.min_pair_matches) result.pairs.push_back(std::move(view));
  }
  return result;
}

Result<std::vector<Reconstruction>> BuildClusterReconstructions(
    const IncrementalInput& input, const Correction& correction, const ClusterOptions& options,
    const IncrementalOptions& incremental, RunContext& context) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  ROTUNDA_RETURN_IF_ERROR(incremental.Validate());
  const std::vector<ImageCluster> clusters = BuildClusters(input, correction, options);
  const size_t count = clusters.size();
  ClusterResults reconstructed(count);
  std::atomic<size_t> done = 0;
  context.Report(kStage, 0, count);
  const auto reconstruct = [&](size_t c) {
    RunContext own{context.threads, context.stop, nullptr, DeriveSeed(context.seed, c)};
    const TwoViews matches = MatchesWithinParts(input, correction, clusters[c].images, options);
    reconstructed[c] = Reconstruct(input, matches, incremental, own);
    context.Report(kStage, ++done, count);
  };
  // Work inside a body of ParallelFor is serial, so that a single cluster is better off outside.
  if (count == 1) {
    reconstruct(0);
  } else {
    context.threads.ParallelFor(count, reconstruct, context.stop);
  }
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "cancelled", kStage};
  return ModelsOf(std::move(reconstructed));
}

}  // namespace rotunda::sfm
