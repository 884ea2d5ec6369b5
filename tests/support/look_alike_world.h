#pragma once

#include <cstdint>
#include <vector>

#include "sfm/segments.h"
#include "tests/support/synthetic_world.h"

namespace rotunda::test {

/// A cylinder with the same print on its front (azimuth 0) and its back, and a head of points that
/// exist once, inside a ring of cameras.
struct LookAlikeOptions {
  size_t columns = 12;  // an even number: every camera has one opposite
  size_t rows = 2;
  size_t print_points = 240;  // on each side
  size_t head_points = 300;
  double print_half_width_deg = 25.0;
  double crossed_share = 0.5;  // of what could be matched across the sides
  double noise_px = 0.5;
  uint64_t seed = 1;
};

inline constexpr uint32_t kPrintSegment = 0;  // both sides, ambiguous
inline constexpr uint32_t kHeadSegment = 1;

/// Point p < print_points of the front looks like point print_points + p of the back; the head's
/// points come after them. A pair whose crossed matches outnumber the true ones has the crossed
/// matches alone, and the relative pose that is true but for half a turn about the axis.
struct LookAlikeWorld {
  SyntheticWorld world;
  sfm::Segments segments;
  std::vector<double> azimuth_rad;  // by image, in (-pi, pi]
  size_t crossed_pairs = 0;

  bool SeesFront(ImageId image) const { return std::abs(azimuth_rad[image.index()]) < 0.5 * kPi; }
};

LookAlikeWorld MakeLookAlikeWorld(const LookAlikeOptions& options);

}  // namespace rotunda::test
