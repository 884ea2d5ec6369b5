#pragma once

#include <cstdint>
#include <vector>

#include "sfm/core/result.h"

namespace rotunda::sfm {

struct GraphNeighbour {
  uint32_t node = 0;
  double weight = 0;
};

/// Undirected, without loops: every edge stands at both of its ends. Neighbours sorted by node.
struct WeightedGraph {
  std::vector<std::vector<GraphNeighbour>> neighbours;  // by node
};

struct Communities {
  std::vector<uint32_t> of_node;  // 0 .. count-1, numbered by falling size (ties: smallest node)
  size_t count = 0;
  double modularity = 0;
};

struct CommunityOptions {
  double resolution = 1.0;  // gamma; above 1: smaller communities
  Status Validate() const;
};

/// Modularity with resolution gamma (Newman & Girvan 2004; Reichardt & Bornholdt 2006):
/// sum over communities of (inner weight / m) - gamma (degree sum / 2m)^2.
double Modularity(const WeightedGraph& graph, const std::vector<uint32_t>& of_node,
                  double resolution);

/// Louvain (Blondel et al., J. Stat. Mech. 2008) with the refinement of Leiden (Traag et al., Sci.
/// Rep. 2019), final level; the best of several fixed orders of the nodes. Communities are
/// connected; a node without an edge is one of its own. kInvalidArgument: options or graph are not
/// as said.
Result<Communities> BuildCommunities(const WeightedGraph& graph, const CommunityOptions& options);

}  // namespace rotunda::sfm
