#pragma once

#include <cstdint>
#include <vector>

#include "sfm/core/ids.h"
#include "sfm/covisibility.h"
#include "sfm/view_graph.h"

namespace rotunda::sfm {

/// Images of a model in groups that see different things in the same places of it.
struct LookAlikeGroups {
  std::vector<int> of_image;  // by ImageId: group, 0 the largest; kNoGroup: not in the model
  size_t count = 0;
  /// Log-likelihood (natural) that the groups gain over one group, over all regions that are met
  /// within groups and not across, less the description length of the groups and of the choice of
  /// regions; 0 with one group.
  double gain = 0;
  /// By ImageId: log-likelihood by which the image belongs to its group rather than to the next
  /// best; 0 where nothing tells, infinite with one group.
  std::vector<double> certainty;
};
inline constexpr int kNoGroup = -1;

/// Groups of images by what they meet (conflicting observations, Heinly et al., ECCV 2014; missing
/// correspondences, Zach et al., CVPR 2008; here counted region by region and only where an image
/// is enclosed). Expectation maximisation over two unknowns: which regions tell groups apart, and
/// which images belong together (correlation clustering by agglomeration and single moves), from
/// several starts; the labelling of the largest gain is returned, one group when none gains. Images
/// that no region says anything of go with their strongest neighbour in `graph`.
LookAlikeGroups FindLookAlikeGroups(const Covisibility& covisibility, const ViewGraph& graph);

}  // namespace rotunda::sfm
