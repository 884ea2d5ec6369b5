#pragma once

#include <cstdint>
#include <limits>
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
  double print_half_width_deg = 25.0;  // 90: the print goes round the body
  double crossed_share = 0.5;          // of what could be matched across the sides
  /// Matches thin out with the angle between the directions the cameras look from, as
  /// exp(-(angle / range)^2 / 2); after the half turn for crossed ones. With an odd number of
  /// columns every camera then has crossed links stronger than its true ones to the next column.
  double match_range_deg = std::numeric_limits<double>::infinity();
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

/// A print all round, and 15 columns: opposite cameras are 12 degrees apart after the half turn,
/// neighbours 24, so that the strongest links are crossed ones and the spanning tree folds.
LookAlikeOptions FoldingOptions();

/// Whether the pair's relative rotation is nearer to the half turn than to the truth.
bool IsCrossed(const SyntheticWorld& world, const sfm::TwoView& view);

}  // namespace rotunda::test
