#include "sfm/literal_tc_sfm.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

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

/// By ImageId and KeypointId; nullopt: in none.
std::vector<std::vector<std::optional<size_t>>> TrackOfKeypoint(const Features& features,
                                                                const Tracks& tracks) {
  std::vector<std::vector<std::optional<size_t>>> track_of;
  for (const ImageFeatures& image : features.images) track_of.emplace_back(image.keypoints.size());
  for (size_t t = 0; t < tracks.tracks.size(); ++t) {
    for (const Observation& o : tracks.tracks[t].observations) {
      track_of[o.image.index()][o.keypoint.index()] = t;
    }
  }
  return track_of;
}

/// The edges of `graph` but for those that neither `heavy` has nor its tracks confirm.
ViewGraph ConfirmedEdges(const TcSfmInput& input, const ViewGraph& graph, const ViewGraph& heavy,
                         const Tracks& tracks) {
  const auto track_of = TrackOfKeypoint(input.features, tracks);
  std::set<ImagePair> sure;
  for (const ViewGraphEdge& edge : heavy.edges) sure.insert(edge.pair);
  ViewGraph confirmed{graph.images, {}};
  for (const ViewGraphEdge& edge : graph.edges) {
    const std::vector<Match>& matches = input.two_views.pairs[edge.two_view].inliers;
    const auto inside =
        static_cast<size_t>(std::count_if(matches.begin(), matches.end(), [&](const Match& match) {
          const auto track = track_of[edge.pair.first.index()][match.first.index()];
          return track && track == track_of[edge.pair.second.index()][match.second.index()];
        }));
    const bool enough =
        inside >= kMinConfirmed &&
        static_cast<double>(inside) >= kMinConfirmedShare * static_cast<double>(matches.size());
    if (enough || sure.contains(edge.pair)) confirmed.edges.push_back(edge);
  }
  return confirmed;
}

/// One line of what the passes found of a segment's images, each counted by its last judgement.
std::string NoteOf(const SegmentCorrection& segment) {
  std::map<ImageId, ImageVerdict> last;
  for (const Judgement& judgement : segment.judgements) last[judgement.image] = judgement.verdict;
  const auto count = [&](ImageVerdict verdict) {
    return std::to_string(std::count_if(last.begin(), last.end(),
                                        [&](const auto& v) { return v.second == verdict; }));
  };
  return "segment " + std::to_string(segment.segment) +
         " looks ambiguous: " + count(ImageVerdict::kInitial) +
         " pictures began the models of it, " + count(ImageVerdict::kConsistent) +
         " are consistent, " + count(ImageVerdict::kInconsistent) + " inconsistent, " +
         count(ImageVerdict::kUndecided) + " undecided, " + count(ImageVerdict::kRefused) +
         " refused, " + count(ImageVerdict::kUnplaced) +
         " without a pose; subsets: " + std::to_string(segment.subsets.size());
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
  const ViewGraph heavy = HeavyEdges(graph, LeastWeight(judged, options));
  const Tracks tracks = BuildTracks(input.features, input.two_views, heavy);
  const ViewGraph usable =
      options.confirmed_light_edges ? ConfirmedEdges(input, graph, heavy, tracks) : graph;
  LiteralResult result;
  result.view_graph_margin = judged.Margin();
  ROTUNDA_ASSIGN_OR_RETURN(result.segments,
                           FindSegments(set, input, judged.verdicts, tracks, options, context));

  context.Report("correction", 0, 1);
  const IncrementalInput everything = {input.features, input.intrinsics, input.two_views, usable,
                                       tracks};
  ROTUNDA_ASSIGN_OR_RETURN(
      const Correction correction,
      BuildCorrection(everything, result.segments, options.correction, context));
  for (const SegmentCorrection& segment : correction.segments) {
    result.notes.push_back(NoteOf(segment));
  }
  ROTUNDA_ASSIGN_OR_RETURN(
      std::vector<Reconstruction> models,
      BuildClusterReconstructions(everything, correction, options.clusters, incremental, context));
  context.Report("merging", 0, 1);
  ROTUNDA_ASSIGN_OR_RETURN(MergeResult merged,
                           MergeModels({input.features, input.two_views, usable}, std::move(models),
                                       options.merging, context));
  ROTUNDA_ASSIGN_OR_RETURN(result.models, Complete(everything, correction, std::move(merged.models),
                                                   options.clusters, incremental, context));
  return result;
}

}  // namespace rotunda::sfm
