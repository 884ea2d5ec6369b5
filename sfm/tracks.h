#pragma once

#include <optional>
#include <vector>

#include "sfm/core/ids.h"
#include "sfm/features.h"
#include "sfm/two_view.h"
#include "sfm/view_graph.h"

namespace rotunda::sfm {

/// Keypoints that are taken to be one point of the world: sorted by image, at most one a picture.
struct Track {
  std::vector<Observation> observations;
};

struct Tracks {
  std::vector<Track> tracks;  // longest first, ties by first observation
};

/// Union-find over inlier matches, pairs by descending weight (ties by pair); a union that would
/// put two keypoints of one picture into one track is refused. Matches of panoramic pairs are left
/// out: they cannot be triangulated, and in a rig they join different things that look alike.
/// Tracks of one keypoint are left out.
Tracks BuildTracks(const Features& features, const TwoViews& two_views, const ViewGraph& graph);

/// By ImageId and KeypointId; nullopt: in none.
using TrackOfKeypoint = std::vector<std::vector<std::optional<TrackId>>>;
TrackOfKeypoint TracksByKeypoint(const Features& features, const Tracks& tracks);

}  // namespace rotunda::sfm
