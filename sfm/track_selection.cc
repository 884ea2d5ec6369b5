#include "sfm/track_selection.h"

#include <algorithm>

namespace rotunda::sfm {
namespace {

/// Grid cells along the larger side of a picture.
constexpr int kCells = 24;

/// How many selected tracks a picture has, in all and in each cell.
class Coverage {
 public:
  Coverage(const ImageFeatures& image, size_t tracks, size_t limit) : image_(image), limit_(limit) {
    cell_px_ =
        std::max(1.0f, std::max(image.width_px, image.height_px) / static_cast<float>(kCells));
    cells_.assign(kCells * kCells, 0);
    available_ = tracks;
  }

  void CountCell(KeypointId keypoint) {
    occupied_.resize(cells_.size()), occupied_[Cell(keypoint)] = true;
  }
  void SetShare() {
    const auto used = static_cast<size_t>(std::count(occupied_.begin(), occupied_.end(), true));
    share_ = used > 0 ? (limit_ + used - 1) / used : limit_;
  }
  bool Wants(KeypointId keypoint) const {
    return total_ < limit_ && (available_ <= limit_ || cells_[Cell(keypoint)] < share_);
  }
  void Take(KeypointId keypoint) {
    ++cells_[Cell(keypoint)];
    ++total_;
  }

 private:
  size_t Cell(KeypointId keypoint) const {
    const Keypoint& k = image_.keypoints[keypoint.index()];
    const int column = std::clamp(static_cast<int>(k.x_px / cell_px_), 0, kCells - 1);
    const int row = std::clamp(static_cast<int>(k.y_px / cell_px_), 0, kCells - 1);
    return static_cast<size_t>(row * kCells + column);
  }

  const ImageFeatures& image_;
  size_t limit_;
  float cell_px_ = 1;
  size_t available_ = 0;
  size_t total_ = 0;
  size_t share_ = 0;
  std::vector<size_t> cells_;
  std::vector<bool> occupied_;
};

}  // namespace

std::vector<bool> SelectTracks(const Features& features, const Tracks& tracks, size_t per_image) {
  std::vector<size_t> tracks_of_image(features.images.size(), 0);
  for (const Track& track : tracks.tracks) {
    for (const Observation& o : track.observations) ++tracks_of_image[o.image.index()];
  }
  std::vector<Coverage> coverage;
  for (size_t i = 0; i < features.images.size(); ++i) {
    coverage.emplace_back(features.images[i], tracks_of_image[i], per_image);
  }
  for (const Track& track : tracks.tracks) {
    for (const Observation& o : track.observations) {
      coverage[o.image.index()].CountCell(o.keypoint);
    }
  }
  for (Coverage& image : coverage) image.SetShare();
  std::vector<bool> selected(tracks.tracks.size(), false);
  for (size_t t = 0; t < tracks.tracks.size(); ++t) {
    const std::vector<Observation>& observations = tracks.tracks[t].observations;
    selected[t] = std::any_of(observations.begin(), observations.end(), [&](const Observation& o) {
      return coverage[o.image.index()].Wants(o.keypoint);
    });
    if (!selected[t]) continue;
    for (const Observation& o : observations) coverage[o.image.index()].Take(o.keypoint);
  }
  return selected;
}

}  // namespace rotunda::sfm
