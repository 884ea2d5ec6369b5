#pragma once

#include <vector>

#include "sfm/communities.h"
#include "sfm/core/ids.h"
#include "sfm/core/result.h"
#include "sfm/features.h"
#include "sfm/superpixels.h"
#include "sfm/tracks.h"

namespace rotunda::sfm {

/// Sampled tracks and which of them lie side by side in the pictures.
struct TrackGraph {
  std::vector<TrackId> tracks;  // by node: the sampled track
  WeightedGraph graph;          // weight: pictures in which two tracks are adjacent
};

struct TrackGraphOptions {
  size_t min_track_length = 3;
  bool weighted = true;  // false: every edge weighs 1 (the paper)
  Status Validate() const;
};

/// TC-SfM III-A. Tracks longest first; one is sampled when some superpixel that it touches is not
/// covered yet in that picture, then all that it touches are. Two sampled tracks are adjacent in a
/// picture when their keypoints lie in the same or in touching superpixels.
TrackGraph BuildTrackGraph(const Features& features, const Tracks& tracks,
                           const std::vector<Superpixels>& superpixels,
                           const TrackGraphOptions& options);

}  // namespace rotunda::sfm
