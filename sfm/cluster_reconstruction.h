#pragma once

#include <cstdint>
#include <vector>

#include "sfm/core/ids.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"
#include "sfm/correction.h"
#include "sfm/incremental.h"
#include "sfm/reconstruction.h"
#include "sfm/two_view.h"

namespace rotunda::sfm {

struct ClusterOptions {
  size_t max_common_images = 20;  // clusters that share more are merged
  size_t min_pair_matches = 15;   // a pair that has fewer within single parts is left out
  /// A merge is undone when it brings together images whose pairs contradict each other: when
  /// ConsistentViewGraph::Margin of the merged cluster is below `trusted_margin` and below that of
  /// one of the two. The paper does not.
  bool undo_inconsistent_merges = false;
  double trusted_margin = 1.2;
  Status Validate() const;
};

/// Images that are reconstructed together.
struct ImageCluster {
  std::vector<uint32_t> parts;  // of Correction::parts whose images it holds, sorted
  std::vector<ImageId> images;  // sorted
};

/// The images of every part, merged as image sets where they overlap; most images first, ties by
/// first part. Parts without images are left out.
std::vector<ImageCluster> BuildClusters(const IncrementalInput& input, const Correction& correction,
                                        const ClusterOptions& options);

/// The pairs of `input.view_graph` with both images in `images`, each with the matches whose ends
/// lie in the same part.
TwoViews MatchesWithinParts(const IncrementalInput& input, const Correction& correction,
                            const std::vector<ImageId>& images, const ClusterOptions& options);

/// TC-SfM III-C, end: every cluster by incremental structure from motion on tracks of its own that
/// never join two parts. Models by cluster, then most images first; unlike those of one
/// BuildReconstructions, models of different clusters may have images in common. A cluster that
/// gives no model is not an error, none at all is one (kFailed). Clusters run side by side.
Result<std::vector<Reconstruction>> BuildClusterReconstructions(
    const IncrementalInput& input, const Correction& correction, const ClusterOptions& options,
    const IncrementalOptions& incremental, RunContext& context);

}  // namespace rotunda::sfm
