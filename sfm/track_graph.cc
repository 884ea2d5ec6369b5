#include "sfm/track_graph.h"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>

namespace rotunda::sfm {
namespace {

/// Patch under an observation; nullopt in a frame without picture.
std::optional<uint16_t> PatchOf(const Features& features,
                                const std::vector<Superpixels>& superpixels,
                                const Observation& observation) {
  const Superpixels& map = superpixels[observation.image.index()];
  if (map.labels.empty()) return std::nullopt;
  const Keypoint& keypoint =
      features.image(observation.image).keypoints[observation.keypoint.index()];
  return map.LabelAt(keypoint.x_px, keypoint.y_px);
}

/// Nodes by patch, of one picture.
using NodesByPatch = std::vector<std::vector<uint32_t>>;

/// Samples tracks and notes where the sampled ones are seen.
class Sampler {
 public:
  Sampler(const Features& features, const std::vector<Superpixels>& superpixels)
      : features_(features), superpixels_(superpixels) {
    for (const Superpixels& map : superpixels) nodes_.emplace_back(map.neighbours.size());
  }

  /// True when the track is sampled, as node `node`.
  bool Offer(const Track& track, uint32_t node) {
    patches_.clear();
    bool uncovered = false;
    for (const Observation& observation : track.observations) {
      const std::optional<uint16_t> patch = PatchOf(features_, superpixels_, observation);
      if (!patch) continue;
      patches_.push_back(&nodes_[observation.image.index()][*patch]);
      uncovered |= patches_.back()->empty();
    }
    if (!uncovered) return false;
    for (std::vector<uint32_t>* nodes : patches_) nodes->push_back(node);
    return true;
  }

  const std::vector<NodesByPatch>& nodes() const { return nodes_; }  // by image

 private:
  const Features& features_;
  const std::vector<Superpixels>& superpixels_;
  std::vector<NodesByPatch> nodes_;
  std::vector<std::vector<uint32_t>*> patches_;  // of the track on offer
};

/// Two nodes side by side in one picture, the smaller in the upper half: a number that sorts.
using Contact = uint64_t;

void AppendContacts(const NodesByPatch& nodes, const Superpixels& map,
                    std::vector<Contact>& contacts) {
  const auto append = [&](uint32_t a, uint32_t b) {
    contacts.push_back(Contact{std::min(a, b)} << 32 | std::max(a, b));
  };
  for (size_t patch = 0; patch < nodes.size(); ++patch) {
    for (size_t i = 0; i < nodes[patch].size(); ++i) {
      for (size_t j = i + 1; j < nodes[patch].size(); ++j) append(nodes[patch][i], nodes[patch][j]);
    }
    for (uint16_t beside : map.neighbours[patch]) {
      if (beside < patch) continue;
      for (uint32_t a : nodes[patch]) {
        for (uint32_t b : nodes[beside]) append(a, b);
      }
    }
  }
}

/// A contact stands once for every picture. Sorted contacts give sorted rows: those of a node to
/// smaller ones come before those to larger ones.
WeightedGraph GraphOf(std::vector<Contact> contacts, size_t nodes, bool weighted) {
  std::sort(contacts.begin(), contacts.end());
  WeightedGraph graph;
  graph.neighbours.resize(nodes);
  for (size_t begin = 0, end = 0; begin < contacts.size(); begin = end) {
    while (end < contacts.size() && contacts[end] == contacts[begin]) ++end;
    const double weight = weighted ? static_cast<double>(end - begin) : 1.0;
    const auto first = static_cast<uint32_t>(contacts[begin] >> 32);
    const auto second = static_cast<uint32_t>(contacts[begin]);
    graph.neighbours[first].push_back({second, weight});
    graph.neighbours[second].push_back({first, weight});
  }
  return graph;
}

}  // namespace

Status TrackGraphOptions::Validate() const {
  if (min_track_length >= 2) return {};
  return Error{ErrorCode::kInvalidArgument,
               std::to_string(min_track_length) + " is out of range, expected >= 2",
               "min_track_length"};
}

TrackGraph BuildTrackGraph(const Features& features, const Tracks& tracks,
                           const std::vector<Superpixels>& superpixels,
                           const TrackGraphOptions& options) {
  TrackGraph result;
  Sampler sampler(features, superpixels);
  for (size_t i = 0; i < tracks.tracks.size(); ++i) {
    const Track& track = tracks.tracks[i];
    if (track.observations.size() < options.min_track_length) break;  // the rest is shorter still
    const auto node = static_cast<uint32_t>(result.tracks.size());
    if (sampler.Offer(track, node)) result.tracks.push_back(TrackId(i));
  }
  std::vector<Contact> contacts;
  for (size_t image = 0; image < superpixels.size(); ++image) {
    AppendContacts(sampler.nodes()[image], superpixels[image], contacts);
  }
  result.graph = GraphOf(std::move(contacts), result.tracks.size(), options.weighted);
  return result;
}

}  // namespace rotunda::sfm
