#include "sfm/literal_tc_sfm.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "sfm/core/html_text.h"
#include "sfm/disjoint_sets.h"
#include "sfm/tracks.h"

namespace rotunda::sfm {
namespace {

/// Of the matches of a light edge that is confirmed, so many, and this share, lie within a track.
constexpr size_t kMinConfirmed = 3;
constexpr double kMinConfirmedShare = 0.4;

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

/// What the others say of every edge, where a reading asks for it; the paper asks for nothing.
Result<ConsistentViewGraph> JudgeEdges(const TcSfmInput& input, const LiteralOptions& options) {
  if (options.consistent_view_graph || options.adaptive_edge_weight ||
      options.confirmed_light_edges || options.correction.graph_support ||
      options.segments.sign == AmbiguitySign::kRejectedLinks) {
    return BuildConsistentViewGraph(input.view_graph, input.two_views, {});
  }
  return ConsistentViewGraph{
      std::vector<EdgeVerdict>(input.view_graph.edges.size(), EdgeVerdict::kAgrees)};
}

/// tau_w.
double LeastWeight(const ConsistentViewGraph& judged, const LiteralOptions& options) {
  if (!options.adaptive_edge_weight || !judged.heaviest_off) return options.min_edge_weight;
  return std::nextafter(*judged.heaviest_off, std::numeric_limits<double>::infinity());
}

/// The edges of `heavy`, and those that agree with the others and are confirmed by its tracks.
ViewGraph ConfirmedEdges(const TcSfmInput& input, const ConsistentViewGraph& judged,
                         const ViewGraph& heavy, const Tracks& tracks) {
  const TrackOfKeypoint track_of = TracksByKeypoint(input.features, tracks);
  std::set<ImagePair> sure;
  for (const ViewGraphEdge& edge : heavy.edges) sure.insert(edge.pair);
  const auto is_confirmed = [&](const ViewGraphEdge& edge) {
    const std::vector<Match>& matches = input.two_views.pairs[edge.two_view].inliers;
    const auto inside =
        static_cast<size_t>(std::count_if(matches.begin(), matches.end(), [&](const Match& match) {
          const auto track = track_of[edge.pair.first.index()][match.first.index()];
          return track && track == track_of[edge.pair.second.index()][match.second.index()];
        }));
    return inside >= kMinConfirmed &&
           static_cast<double>(inside) >= kMinConfirmedShare * static_cast<double>(matches.size());
  };
  ViewGraph confirmed{input.view_graph.images, {}};
  for (size_t e = 0; e < input.view_graph.edges.size(); ++e) {
    const ViewGraphEdge& edge = input.view_graph.edges[e];
    const bool agrees = judged.verdicts[e] == EdgeVerdict::kAgrees;
    if (sure.contains(edge.pair) || (agrees && is_confirmed(edge))) confirmed.edges.push_back(edge);
  }
  return confirmed;
}

/// One line of what the passes found of a segment's images.
std::string NoteOf(const SegmentCorrection& segment) {
  size_t placed = 0;
  for (const std::vector<ImageId>& subset : segment.subsets) placed += subset.size();
  const auto count = [&](ImageVerdict verdict) {
    return std::to_string(
        std::count_if(segment.judgements.begin(), segment.judgements.end(),
                      [&](const Judgement& judgement) { return judgement.verdict == verdict; }));
  };
  return "segment " + std::to_string(segment.segment) +
         " is ambiguous: " + Counted(placed, "picture") + " in " +
         Counted(segment.subsets.size(), "subset") + ", " +
         std::to_string(segment.left_out.size()) +
         " left out; judgements: " + count(ImageVerdict::kConsistent) + " consistent, " +
         count(ImageVerdict::kInconsistent) + " inconsistent, " + count(ImageVerdict::kUndecided) +
         " undecided, " + count(ImageVerdict::kRefused) + " refused, " +
         count(ImageVerdict::kUnplaced) + " without a pose";
}

std::vector<std::string> NotesOf(const ViewGraph& heavy, double min_weight,
                                 const Correction& correction, const MergeResult& merged) {
  std::vector<std::string> notes;
  const auto light = std::count_if(heavy.edges.begin(), heavy.edges.end(),
                                   [&](const ViewGraphEdge& e) { return e.weight < min_weight; });
  if (light > 0) {
    notes.push_back("lighter than " + std::to_string(min_weight) + ", but kept to hold the " +
                    "pictures together: " + Counted(static_cast<size_t>(light), "pair"));
  }
  for (const SegmentCorrection& segment : correction.segments) notes.push_back(NoteOf(segment));
  for (const std::string& refusal : merged.refusals) {
    notes.push_back("two models were not joined: " + refusal);
  }
  return notes;
}

std::set<ImagePair> RejectedPairs(const ViewGraph& graph, const ConsistentViewGraph& judged) {
  std::set<ImagePair> rejected;
  for (size_t e = 0; e < graph.edges.size(); ++e) {
    if (judged.verdicts[e] == EdgeVerdict::kRejected) rejected.insert(graph.edges[e].pair);
  }
  return rejected;
}

/// `verdicts`: parallel to the edges of `input.view_graph`.
Result<Segments> FindSegments(const FrameSet& set, const TcSfmInput& input,
                              const std::vector<EdgeVerdict>& verdicts, const Tracks& tracks,
                              const LiteralOptions& options, RunContext& context) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<Superpixels> superpixels,
                           BuildSuperpixels(set, options.superpixels, context));
  context.Report("communities", 0, 1);
  const TrackGraph graph =
      BuildTrackGraph(input.features, tracks, superpixels, options.track_graph);
  ROTUNDA_ASSIGN_OR_RETURN(const Communities communities,
                           BuildCommunities(graph.graph, options.communities));
  return BuildSegments({input.features, input.two_views, input.view_graph, verdicts, tracks,
                        superpixels, graph, communities},
                       options.segments);
}

std::vector<ImageId> AllImages(const Features& features) {
  std::vector<ImageId> images;
  for (size_t i = 0; i < features.images.size(); ++i) images.push_back(ImageId(i));
  return images;
}

/// The largest of the merged models on the matches within the parts, adjusted; the others behind
/// it.
Result<IncrementalResult> Complete(const IncrementalInput& input, const Correction& correction,
                                   std::vector<Reconstruction> merged,
                                   const ClusterOptions& clusters,
                                   const IncrementalOptions& incremental, RunContext& context) {
  const TwoViews consistent =
      MatchesWithinParts(input, correction, AllImages(input.features), clusters);
  const ViewGraph graph = BuildViewGraph(input.features, consistent);
  const Tracks tracks = BuildTracks(input.features, consistent, graph);
  const Reconstruction start = std::move(merged.front());
  ROTUNDA_ASSIGN_OR_RETURN(
      IncrementalResult models,
      ExtendReconstruction({input.features, start.intrinsics, consistent, graph, tracks}, start,
                           incremental, context));
  merged.erase(merged.begin());
  AppendModels(std::move(merged), incremental.min_model_images, models);
  return models;
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
  ROTUNDA_ASSIGN_OR_RETURN(const ConsistentViewGraph judged, JudgeEdges(input, options));
  const ViewGraph graph =
      options.consistent_view_graph ? EdgesThatAgree(input.view_graph, judged) : input.view_graph;
  const double min_weight = LeastWeight(judged, options);
  const ViewGraph heavy = HeavyEdges(graph, min_weight);
  const Tracks tracks = BuildTracks(input.features, input.two_views, heavy);
  const ViewGraph usable =
      options.confirmed_light_edges ? ConfirmedEdges(input, judged, heavy, tracks) : graph;
  LiteralResult result;
  result.view_graph_margin = judged.Margin();
  ROTUNDA_ASSIGN_OR_RETURN(result.segments,
                           FindSegments(set, input, judged.verdicts, tracks, options, context));

  context.Report("correction", 0, 1);
  const IncrementalInput everything = {input.features, input.intrinsics, input.two_views, usable,
                                       tracks};
  ROTUNDA_ASSIGN_OR_RETURN(const Correction correction,
                           BuildCorrection(everything, result.segments, options.correction, context,
                                           RejectedPairs(input.view_graph, judged)));
  ROTUNDA_ASSIGN_OR_RETURN(
      std::vector<Reconstruction> models,
      BuildClusterReconstructions(everything, correction, options.clusters, incremental, context));
  context.Report("merging", 0, 1);
  ROTUNDA_ASSIGN_OR_RETURN(MergeResult merged,
                           MergeModels({input.features, input.two_views, usable}, std::move(models),
                                       options.merging, context));
  result.notes = NotesOf(heavy, min_weight, correction, merged);
  ROTUNDA_ASSIGN_OR_RETURN(result.models, Complete(everything, correction, std::move(merged.models),
                                                   options.clusters, incremental, context));
  return result;
}

}  // namespace rotunda::sfm
