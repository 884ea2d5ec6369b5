#include "sfm/tracks.h"

#include <algorithm>

#include "sfm/disjoint_sets.h"

namespace rotunda::sfm {
namespace {

/// Union-find over all keypoints in which every set knows its pictures.
class TrackForest {
 public:
  explicit TrackForest(const Features& features)
      : offsets_(Offsets(features)), sets_(offsets_.back()) {
    images_.resize(offsets_.back());
  }

  /// Joins the tracks of two keypoints unless a picture would then be in the track twice.
  void Join(const Observation& a, const Observation& b) {
    const size_t root_a = sets_.Find(IndexOf(a));
    const size_t root_b = sets_.Find(IndexOf(b));
    if (root_a == root_b) return;
    if (images_[root_a].empty()) images_[root_a] = {a.image};
    if (images_[root_b].empty()) images_[root_b] = {b.image};
    std::vector<ImageId> merged;
    merged.reserve(images_[root_a].size() + images_[root_b].size());
    std::set_union(images_[root_a].begin(), images_[root_a].end(), images_[root_b].begin(),
                   images_[root_b].end(), std::back_inserter(merged));
    if (merged.size() < images_[root_a].size() + images_[root_b].size()) return;
    images_[root_a] = {};
    images_[root_b] = {};
    sets_.Unite(root_a, root_b);
    images_[sets_.Find(root_a)] = std::move(merged);
  }

  /// Keypoints are visited in order of picture, so a track's observations come sorted.
  std::vector<Track> Collect() {
    std::vector<Track> by_root(offsets_.back());
    for (size_t image = 0; image + 1 < offsets_.size(); ++image) {
      for (size_t i = offsets_[image]; i < offsets_[image + 1]; ++i) {
        const size_t root = sets_.Find(i);
        if (images_[root].size() < 2) continue;
        by_root[root].observations.push_back({ImageId(image), KeypointId(i - offsets_[image])});
      }
    }
    std::erase_if(by_root, [](const Track& track) { return track.observations.empty(); });
    return by_root;
  }

 private:
  static std::vector<size_t> Offsets(const Features& features) {
    std::vector<size_t> offsets = {0};
    for (const ImageFeatures& image : features.images) {
      offsets.push_back(offsets.back() + image.keypoints.size());
    }
    return offsets;
  }
  size_t IndexOf(const Observation& observation) const {
    return offsets_[observation.image.index()] + observation.keypoint.index();
  }

  std::vector<size_t> offsets_;  // of each picture's first keypoint; one more at the end
  DisjointSets sets_;
  std::vector<std::vector<ImageId>> images_;  // by root, sorted; empty: a keypoint on its own
};

}  // namespace

Tracks BuildTracks(const Features& features, const TwoViews& two_views, const ViewGraph& graph) {
  TrackForest forest(features);
  for (size_t edge : EdgesByWeight(graph)) {
    const TwoView& view = two_views.pairs[graph.edges[edge].two_view];
    if (view.kind == TwoViewKind::kPanoramic) continue;
    for (const Match& match : view.inliers) {
      forest.Join({view.pair.first, match.first}, {view.pair.second, match.second});
    }
  }
  Tracks tracks{forest.Collect()};
  std::sort(tracks.tracks.begin(), tracks.tracks.end(), [](const Track& a, const Track& b) {
    if (a.observations.size() != b.observations.size()) {
      return a.observations.size() > b.observations.size();
    }
    return a.observations.front() < b.observations.front();
  });
  return tracks;
}

TrackOfKeypoint TracksByKeypoint(const Features& features, const Tracks& tracks) {
  TrackOfKeypoint track_of;
  for (const ImageFeatures& image : features.images) track_of.emplace_back(image.keypoints.size());
  for (size_t i = 0; i < tracks.tracks.size(); ++i) {
    for (const Observation& seen : tracks.tracks[i].observations) {
      track_of[seen.image.index()][seen.keypoint.index()] = TrackId(i);
    }
  }
  return track_of;
}

}  // namespace rotunda::sfm
