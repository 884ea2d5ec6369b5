#include "sfm/literal_tc_sfm.h"

#include <string>

#include "sfm/disjoint_sets.h"
#include "sfm/tracks.h"

namespace rotunda::sfm {
namespace {

/// The heavy edges, and of the others those that hold the graph together.
ViewGraph HeavyEdges(const ViewGraph& graph, double min_weight) {
  ViewGraph heavy{graph.images, {}};
  DisjointSets sets(graph.images);
  for (const size_t e : EdgesByWeight(graph)) {
    const ViewGraphEdge& edge = graph.edges[e];
    const bool joins = sets.Unite(edge.pair.first.index(), edge.pair.second.index());
    if (joins || edge.weight >= min_weight) heavy.edges.push_back(edge);
  }
  return heavy;
}

Result<Segments> FindSegments(const FrameSet& set, const TcSfmInput& input, const Tracks& tracks,
                              const LiteralOptions& options, RunContext& context) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<Superpixels> superpixels,
                           BuildSuperpixels(set, options.superpixels, context));
  context.Report("communities", 0, 1);
  const TrackGraph graph =
      BuildTrackGraph(input.features, tracks, superpixels, options.track_graph);
  ROTUNDA_ASSIGN_OR_RETURN(const Communities communities,
                           BuildCommunities(graph.graph, options.communities));
  // No edge is judged by the others in the paper.
  const std::vector<EdgeVerdict> verdicts(input.view_graph.edges.size(), EdgeVerdict::kAgrees);
  return BuildSegments({input.features, input.two_views, input.view_graph, verdicts, tracks,
                        superpixels, graph, communities},
                       options.segments);
}

std::vector<ImageId> AllImages(const Features& features) {
  std::vector<ImageId> images;
  for (size_t i = 0; i < features.images.size(); ++i) images.push_back(ImageId(i));
  return images;
}

}  // namespace

Status LiteralOptions::Validate() const {
  if (!(min_edge_weight >= 0)) {
    return Error{ErrorCode::kInvalidArgument,
                 std::to_string(min_edge_weight) + " is out of range, expected >= 0",
                 "min_edge_weight"};
  }
  ROTUNDA_RETURN_IF_ERROR(superpixels.Validate());
  ROTUNDA_RETURN_IF_ERROR(track_graph.Validate());
  ROTUNDA_RETURN_IF_ERROR(communities.Validate());
  ROTUNDA_RETURN_IF_ERROR(segments.Validate());
  ROTUNDA_RETURN_IF_ERROR(correction.Validate());
  ROTUNDA_RETURN_IF_ERROR(clusters.Validate());
  return merging.Validate();
}

Result<LiteralResult> RunLiteralTcSfm(const FrameSet& set, const TcSfmInput& input,
                                      const LiteralOptions& options,
                                      const IncrementalOptions& incremental, RunContext& context) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  const ViewGraph heavy = HeavyEdges(input.view_graph, options.min_edge_weight);
  const Tracks tracks = BuildTracks(input.features, input.two_views, heavy);
  LiteralResult result;
  ROTUNDA_ASSIGN_OR_RETURN(result.segments, FindSegments(set, input, tracks, options, context));

  context.Report("correction", 0, 1);
  const IncrementalInput everything = {input.features, input.intrinsics, input.two_views,
                                       input.view_graph, tracks};
  ROTUNDA_ASSIGN_OR_RETURN(
      const Correction correction,
      BuildCorrection(everything, result.segments, options.correction, context));
  ROTUNDA_ASSIGN_OR_RETURN(
      std::vector<Reconstruction> models,
      BuildClusterReconstructions(everything, correction, options.clusters, incremental, context));
  context.Report("merging", 0, 1);
  ROTUNDA_ASSIGN_OR_RETURN(MergeResult merged,
                           MergeModels({input.features, input.two_views, input.view_graph},
                                       std::move(models), options.merging, context));

  const TwoViews consistent =
      MatchesWithinParts(everything, correction, AllImages(input.features), options.clusters);
  const ViewGraph graph = BuildViewGraph(input.features, consistent);
  const Tracks last = BuildTracks(input.features, consistent, graph);
  const Reconstruction start = merged.models.front();
  ROTUNDA_ASSIGN_OR_RETURN(result.models, ExtendReconstruction({input.features, start.intrinsics,
                                                                consistent, graph, last},
                                                               start, incremental, context));
  merged.models.erase(merged.models.begin());
  AppendModels(std::move(merged.models), incremental.min_model_images, result.models);
  return result;
}

}  // namespace rotunda::sfm
