#pragma once

#include <optional>
#include <vector>

#include "sfm/core/result.h"
#include "sfm/core/rigid3.h"
#include "sfm/two_view.h"
#include "sfm/view_graph.h"

namespace rotunda::sfm {

/// What the view graph as a whole says of one of its edges.
enum class EdgeVerdict {
  kAgrees,
  kRejected,  // contradicts the graph: joins parts that look alike
};

/// The view graph with every edge judged by all others, before any track is built.
struct ConsistentViewGraph {
  std::vector<EdgeVerdict> verdicts;  // parallel to ViewGraph::edges
  /// Of the edges that may vote, the weight of the lightest that holds the images together (of the
  /// maximum spanning tree of those that agree) and of the heaviest that is more than
  /// ConsistencyOptions::far_rad off the averaged rotations; nullopt: there is none.
  std::optional<double> lightest_joining = std::nullopt;
  std::optional<double> heaviest_off = std::nullopt;

  /// lightest_joining / heaviest_off: how far the graph is from having been joined by an edge that
  /// contradicts it. nullopt where nothing does.
  std::optional<double> Margin() const;
};

struct ConsistencyOptions {
  double far_rad = RadFromDeg(30.0);   // off the joined rotations: dropped before any averaging
  double off_rad = RadFromDeg(15.0);   // off the first average: dropped before the second
  double agree_rad = RadFromDeg(8.0);  // of the second average: kept
  /// All edges between two pieces vote on how they are joined; false: the heaviest joins them, as
  /// in a maximum spanning tree (the paper).
  bool piece_consensus = true;
  Status Validate() const;
};

/// Rotations piece by piece in the order of the maximum spanning tree, two pieces joined by the
/// consensus of all edges between them, then robust averaging (IRLS with L1/2 weights; Chatterjee &
/// Govindu, PAMI 2018) of the edges that are not far off. Heavy edges come first because crossed
/// pairs tend to be light, although many: a consensus of all edges folds. Panoramic
/// pairs have no part in it.
Result<ConsistentViewGraph> BuildConsistentViewGraph(const ViewGraph& graph,
                                                     const TwoViews& two_views,
                                                     const ConsistencyOptions& options);

ViewGraph EdgesThatAgree(const ViewGraph& graph, const ConsistentViewGraph& consistent);

}  // namespace rotunda::sfm
