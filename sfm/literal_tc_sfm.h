#pragma once

#include <optional>
#include <string>
#include <vector>

#include "sfm/cluster_reconstruction.h"
#include "sfm/communities.h"
#include "sfm/core/frame_set.h"
#include "sfm/correction.h"
#include "sfm/model_merging.h"
#include "sfm/segments.h"
#include "sfm/superpixels.h"
#include "sfm/tc_sfm.h"
#include "sfm/track_graph.h"

namespace rotunda::sfm {

/// TC-SfM as it was published, stage by stage; what is set here is the paper's reading. Where the
/// paper names no more than a known method, ours stands also here: communities have the refinement
/// of Leiden and are the best of several orders of the nodes, and models whose cameras contradict
/// each other are not merged.
struct LiteralOptions {
  bool consistent_view_graph = false;  // only its edges are used
  double min_edge_weight = 0.15;       // tau_w; 0.05 for photographs from the Internet
  /// tau_w is just above the heaviest edge that contradicts the others, where one does.
  bool adaptive_edge_weight = false;
  /// Of the lighter edges only those that agree with the others and have enough matches whose two
  /// keypoints are in one track take part in what comes after the tracks.
  bool confirmed_light_edges = false;
  SuperpixelOptions superpixels;
  TrackGraphOptions track_graph{.weighted = false};
  CommunityOptions communities;
  SegmentOptions segments{.sign = AmbiguitySign::kDiversity};
  CorrectionOptions correction{.next = NextImage::kMostPrimaryPoints,
                               .place_distance = PlaceDistance::kTranslationAngle,
                               .undecided_is_consistent = true,
                               .labels_by_track = false,
                               .max_sigma_share = std::numeric_limits<double>::infinity(),
                               .model = {}};
  ClusterOptions clusters;
  MergeOptions merging{.reprojection_weight = 0, .mean_cost = false, .similarity = {}};
  Status Validate() const;
};

struct LiteralResult {
  IncrementalResult models;  // most images first
  Segments segments;
  std::optional<double> view_graph_margin;  // ConsistentViewGraph::Margin, where it was built
  /// Light edges that hold the graph together, what correction found of every ambiguous segment,
  /// and which models were not joined.
  std::vector<std::string> notes;
};

/// Wang et al., III-A to III-D: tracks of the heavy edges, track graph, communities, ambiguous ones
/// by the diversity of their tracks' neighbours, correction, a reconstruction a cluster, merging,
/// last adjustment. It gives no verdict. What is missing from it (a test of the result, evidence
/// where front meets back) is RunTcSfm's business; this is what that is compared with.
Result<LiteralResult> RunLiteralTcSfm(const FrameSet& set, const TcSfmInput& input,
                                      const LiteralOptions& options,
                                      const IncrementalOptions& incremental, RunContext& context);

}  // namespace rotunda::sfm
