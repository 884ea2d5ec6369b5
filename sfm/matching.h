#pragma once

#include <vector>

#include "sfm/core/ids.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"
#include "sfm/features.h"

namespace rotunda::sfm {

struct Match {
  KeypointId first;
  KeypointId second;
  auto operator<=>(const Match&) const = default;
};

struct PairMatches {
  ImagePair pair;
  std::vector<Match> matches;  // sorted by first
};

/// Sorted by pair; pairs without a match are left out.
struct Matches {
  std::vector<PairMatches> pairs;
};

struct MatchOptions {
  /// Nearest over second-nearest distance; Lowe's and COLMAP's 0.8.
  double max_ratio = 0.8;
  /// Angle between unit descriptors; COLMAP's 0.7.
  double max_distance_rad = 0.7;
  /// Pairs with fewer matches than this cannot become a two-view geometry and are dropped.
  size_t min_matches = 15;
  Status Validate() const;
};

/// Mutual nearest neighbours with the ratio test both ways over 8-bit descriptors.
Result<Matches> BuildMatches(const Features& features, const std::vector<ImagePair>& pairs,
                             const MatchOptions& options, RunContext& context);

/// Which implementation of the inner product BuildMatches uses on this processor:
/// "avx512-vnni", "avx2" or "generic". All give the same matches.
const char* MatchKernelName();

}  // namespace rotunda::sfm
