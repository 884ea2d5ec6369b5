#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <functional>

namespace rotunda {

/// An integer that cannot be taken for the id of something else. Ids index vectors:
/// `v[id.index()]`.
template <typename Tag>
class StrongId {
 public:
  constexpr StrongId() = default;
  constexpr explicit StrongId(size_t value) : value_(static_cast<uint32_t>(value)) {}
  constexpr size_t index() const { return value_; }
  constexpr auto operator<=>(const StrongId&) const = default;

 private:
  uint32_t value_ = UINT32_MAX;
};

/// Position of a picture in FrameSet::frames (sorted by camera name). One picture a camera.
using ImageId = StrongId<struct ImageTag>;
/// Position of a track in Tracks::tracks.
using TrackId = StrongId<struct TrackTag>;
/// Position of a keypoint in ImageFeatures::keypoints.
using KeypointId = StrongId<struct KeypointTag>;

/// Two pictures; `first < second`, so that a pair has one name.
struct ImagePair {
  ImageId first;
  ImageId second;
  auto operator<=>(const ImagePair&) const = default;
};

/// One keypoint of one picture.
struct Observation {
  ImageId image;
  KeypointId keypoint;
  auto operator<=>(const Observation&) const = default;
};

}  // namespace rotunda

template <typename Tag>
struct std::hash<rotunda::StrongId<Tag>> {
  size_t operator()(const rotunda::StrongId<Tag>& id) const { return id.index(); }
};
