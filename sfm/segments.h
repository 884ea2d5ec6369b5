#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "sfm/communities.h"
#include "sfm/consistent_view_graph.h"
#include "sfm/core/ids.h"
#include "sfm/core/result.h"
#include "sfm/features.h"
#include "sfm/superpixels.h"
#include "sfm/track_graph.h"
#include "sfm/tracks.h"
#include "sfm/two_view.h"
#include "sfm/view_graph.h"

namespace rotunda::sfm {

/// A part of the scene: one community of tracks and what belongs to it.
struct Segment {
  size_t sampled_tracks = 0;
  size_t suspicious_tracks = 0;
  bool ambiguous = false;  // suspicious / sampled > max_suspicious_share
  /// Segments that rejected pairs join it with, most matches first; itself, too, when parts of it
  /// look alike, as in a periodic print.
  std::vector<uint32_t> look_alikes;
  std::vector<ImageId> images;  // that see at least min_image_tracks of its tracks, sorted
  size_t tracks = 0;            // of all tracks
};

struct Segments {
  std::vector<std::optional<uint32_t>> of_track;                  // by TrackId; the segment
  std::vector<std::vector<std::optional<uint32_t>>> of_keypoint;  // by ImageId and KeypointId
  std::vector<Segment> segments;                                  // by community
};

/// How a track is found to be suspicious.
enum class AmbiguitySign {
  kRejectedLinks,  // matches of rejected pairs join it with another track
  kDiversity,      // its neighbours belong to many foreign communities (the paper's gsi)
};

struct SegmentOptions {
  AmbiguitySign sign = AmbiguitySign::kRejectedLinks;
  /// Matches of rejected pairs between the same two tracks that count as a link. What looks alike
  /// is matched again and again; random mismatches are not.
  size_t min_link_matches = 2;
  /// A rejected pair whose matches lie within single tracks more often than this shows the same
  /// thing and only has a wrong pose: it says nothing of look-alikes.
  double max_agreeing_share = 0.1;
  double min_diversity = 0.5;         // tau_gs: gsi above it is suspicious
  bool diversity_inclusive = false;   // gsi equal to it is, too
  double max_suspicious_share = 0.2;  // xi
  size_t min_image_tracks = 30;       // fewer: the picture is not related to the segment
  Status Validate() const;
};

/// Gini-Simpson index over the foreign communities of a track's distinct neighbours (TC-SfM eq. 1):
/// 1 - sum (n_i / N)^2, n_i the neighbours in community i other than its own; 0 when N = 0.
double DiversityIndex(const TrackGraph& graph, const Communities& communities, uint32_t node);

struct SegmentInput {
  const Features& features;
  const TwoViews& two_views;
  const ViewGraph& view_graph;
  const std::vector<EdgeVerdict>& verdicts;  // parallel to the edges
  const Tracks& tracks;
  const std::vector<Superpixels>& superpixels;
  const TrackGraph& track_graph;
  const Communities& communities;
};

/// TC-SfM III-B and the labels of III-C: which communities are ambiguous, and the segment of every
/// keypoint and track. A keypoint of a sampled track has the track's community, another one the
/// community that most sampled keypoints of its superpixel have; a track has that of most of its
/// keypoints (ties: the smaller).
Segments BuildSegments(const SegmentInput& input, const SegmentOptions& options);

}  // namespace rotunda::sfm
