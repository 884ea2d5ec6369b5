#include "sfm/segments.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <utility>

namespace rotunda::sfm {
namespace {

using Label = std::optional<uint32_t>;
using KeypointLabels = std::vector<std::vector<Label>>;

/// The label that most have, the smallest of several; nullopt when there is none.
Label Majority(const std::map<uint32_t, size_t>& counts) {
  Label best;
  size_t most = 0;
  for (const auto& [label, count] : counts) {
    if (count > most) best = label, most = count;
  }
  return best;
}

/// Labels of the keypoints of sampled tracks alone.
KeypointLabels LabelSampled(const SegmentInput& input) {
  KeypointLabels labels;
  for (const ImageFeatures& image : input.features.images) {
    labels.emplace_back(image.keypoints.size());
  }
  for (size_t node = 0; node < input.track_graph.tracks.size(); ++node) {
    const Track& track = input.tracks.tracks[input.track_graph.tracks[node].index()];
    for (const Observation& seen : track.observations) {
      labels[seen.image.index()][seen.keypoint.index()] = input.communities.of_node[node];
    }
  }
  return labels;
}

/// Fills in the keypoints of one picture that have no label from those that share their patch.
void LabelRest(const ImageFeatures& image, const Superpixels& map, std::vector<Label>& labels) {
  if (map.labels.empty()) return;
  std::vector<std::map<uint32_t, size_t>> sampled(map.neighbours.size());  // by patch
  std::vector<uint16_t> patches;
  for (size_t i = 0; i < image.keypoints.size(); ++i) {
    patches.push_back(map.LabelAt(image.keypoints[i].x_px, image.keypoints[i].y_px));
    if (labels[i]) ++sampled[patches[i]][*labels[i]];
  }
  for (size_t i = 0; i < labels.size(); ++i) {
    if (!labels[i]) labels[i] = Majority(sampled[patches[i]]);
  }
}

std::vector<Label> LabelTracks(const Tracks& tracks, const KeypointLabels& of_keypoint) {
  std::vector<Label> of_track;
  for (const Track& track : tracks.tracks) {
    std::map<uint32_t, size_t> counts;
    for (const Observation& seen : track.observations) {
      const Label label = of_keypoint[seen.image.index()][seen.keypoint.index()];
      if (label) ++counts[*label];
    }
    of_track.push_back(Majority(counts));
  }
  return of_track;
}

struct TrackLink {
  TrackId first;  // first < second
  TrackId second;
  size_t matches = 0;
  auto operator<=>(const TrackLink&) const = default;
};

/// One for every match of a rejected pair that joins two tracks; none when the pair's matches agree
/// with the tracks.
std::vector<TrackLink> LinksOfPair(const TwoView& view, const TrackOfKeypoint& track_of,
                                   double max_agreeing_share) {
  std::vector<TrackLink> links;
  size_t agreeing = 0;
  for (const Match& match : view.inliers) {
    const auto& a = track_of[view.pair.first.index()][match.first.index()];
    const auto& b = track_of[view.pair.second.index()][match.second.index()];
    if (!a || !b) continue;
    if (*a == *b) {
      ++agreeing;
    } else {
      links.push_back({std::min(*a, *b), std::max(*a, *b), 1});
    }
  }
  const auto both = static_cast<double>(agreeing + links.size());
  if (static_cast<double>(agreeing) > max_agreeing_share * both) links.clear();
  return links;
}

/// Different tracks that at least `min_link_matches` matches of rejected pairs join. Panoramic
/// pairs are left out, as from the tracks: their rotation is not to be relied on.
std::vector<TrackLink> RejectedLinks(const SegmentInput& input, const SegmentOptions& options) {
  const TrackOfKeypoint track_of = TracksByKeypoint(input.features, input.tracks);
  std::vector<TrackLink> single;
  for (size_t edge = 0; edge < input.view_graph.edges.size(); ++edge) {
    const TwoView& view = input.two_views.pairs[input.view_graph.edges[edge].two_view];
    if (input.verdicts[edge] != EdgeVerdict::kRejected) continue;
    if (view.kind == TwoViewKind::kPanoramic) continue;
    const std::vector<TrackLink> links = LinksOfPair(view, track_of, options.max_agreeing_share);
    single.insert(single.end(), links.begin(), links.end());
  }
  std::sort(single.begin(), single.end());
  std::vector<TrackLink> links;
  for (size_t begin = 0, end = 0; begin < single.size(); begin = end) {
    while (end < single.size() && single[end] == single[begin]) ++end;
    if (end - begin < options.min_link_matches) continue;
    links.push_back({single[begin].first, single[begin].second, end - begin});
  }
  return links;
}

/// By node of the track graph.
std::vector<bool> SuspiciousNodes(const SegmentInput& input, const std::vector<TrackLink>& links,
                                  const SegmentOptions& options) {
  const TrackGraph& graph = input.track_graph;
  std::vector<bool> suspicious(graph.tracks.size(), false);
  if (options.sign == AmbiguitySign::kDiversity) {
    for (size_t node = 0; node < graph.tracks.size(); ++node) {
      const double index = DiversityIndex(graph, input.communities, static_cast<uint32_t>(node));
      suspicious[node] = index > options.min_diversity ||
                         (options.diversity_inclusive && index == options.min_diversity);
    }
    return suspicious;
  }
  std::vector<bool> linked(input.tracks.tracks.size(), false);
  for (const TrackLink& link : links)
    linked[link.first.index()] = linked[link.second.index()] = true;
  for (size_t node = 0; node < graph.tracks.size(); ++node) {
    suspicious[node] = linked[graph.tracks[node].index()];
  }
  return suspicious;
}

/// Tracks of every segment, and the pictures that see enough of them.
void CountTracks(const SegmentInput& input, size_t min_image_tracks, Segments& result) {
  std::vector<std::vector<size_t>> seen_by(result.segments.size(),
                                           std::vector<size_t>(input.features.images.size(), 0));
  for (size_t i = 0; i < input.tracks.tracks.size(); ++i) {
    const Label label = result.of_track[i];
    if (!label) continue;
    ++result.segments[*label].tracks;
    for (const Observation& seen : input.tracks.tracks[i].observations) {
      ++seen_by[*label][seen.image.index()];
    }
  }
  for (size_t s = 0; s < result.segments.size(); ++s) {
    for (size_t image = 0; image < seen_by[s].size(); ++image) {
      if (seen_by[s][image] >= min_image_tracks) {
        result.segments[s].images.push_back(ImageId(image));
      }
    }
  }
}

/// Most matches first, ties by segment.
void NameLookAlikes(const std::vector<TrackLink>& links, Segments& result) {
  std::vector<std::map<uint32_t, size_t>> joined(result.segments.size());
  for (const TrackLink& link : links) {
    const Label first = result.of_track[link.first.index()];
    const Label second = result.of_track[link.second.index()];
    if (!first || !second) continue;
    joined[*first][*second] += link.matches;
    if (*first != *second) joined[*second][*first] += link.matches;
  }
  for (size_t s = 0; s < joined.size(); ++s) {
    std::vector<std::pair<uint32_t, size_t>> order(joined[s].begin(), joined[s].end());
    std::stable_sort(order.begin(), order.end(),
                     [](const auto& a, const auto& b) { return a.second > b.second; });
    for (const auto& [segment, count] : order) result.segments[s].look_alikes.push_back(segment);
  }
}

}  // namespace

Status SegmentOptions::Validate() const {
  const auto check = [](double value, const std::string& name) -> Status {
    if (value >= 0 && value <= 1) return {};
    return Error{ErrorCode::kInvalidArgument,
                 name + " is " + std::to_string(value) + ", expected 0 to 1", "segments"};
  };
  if (min_link_matches < 1) {
    return Error{ErrorCode::kInvalidArgument, "min_link_matches is 0, expected at least 1",
                 "segments"};
  }
  ROTUNDA_RETURN_IF_ERROR(check(max_agreeing_share, "max_agreeing_share"));
  ROTUNDA_RETURN_IF_ERROR(check(min_diversity, "min_diversity"));
  return check(max_suspicious_share, "max_suspicious_share");
}

double DiversityIndex(const TrackGraph& graph, const Communities& communities, uint32_t node) {
  std::map<uint32_t, uint64_t> foreign;
  uint64_t all = 0;
  for (const GraphNeighbour& neighbour : graph.graph.neighbours[node]) {
    const uint32_t community = communities.of_node[neighbour.node];
    if (community == communities.of_node[node]) continue;
    ++foreign[community];
    ++all;
  }
  if (all == 0) return 0;
  uint64_t squares = 0;
  for (const auto& [community, count] : foreign) squares += count * count;
  return 1 - static_cast<double>(squares) / static_cast<double>(all * all);
}

Segments BuildSegments(const SegmentInput& input, const SegmentOptions& options) {
  Segments result;
  result.of_keypoint = LabelSampled(input);
  for (size_t i = 0; i < result.of_keypoint.size(); ++i) {
    LabelRest(input.features.images[i], input.superpixels[i], result.of_keypoint[i]);
  }
  result.of_track = LabelTracks(input.tracks, result.of_keypoint);
  result.segments.resize(input.communities.count);
  CountTracks(input, options.min_image_tracks, result);

  const std::vector<TrackLink> links = RejectedLinks(input, options);
  const std::vector<bool> suspicious = SuspiciousNodes(input, links, options);
  for (size_t node = 0; node < suspicious.size(); ++node) {
    Segment& segment = result.segments[input.communities.of_node[node]];
    ++segment.sampled_tracks;
    if (suspicious[node]) ++segment.suspicious_tracks;
  }
  for (Segment& segment : result.segments) {
    segment.ambiguous = static_cast<double>(segment.suspicious_tracks) >
                        options.max_suspicious_share * static_cast<double>(segment.sampled_tracks);
  }
  NameLookAlikes(links, result);
  return result;
}

}  // namespace rotunda::sfm
