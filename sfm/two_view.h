#pragma once

#include <optional>
#include <vector>

#include "sfm/core/ids.h"
#include "sfm/core/result.h"
#include "sfm/core/rigid3.h"
#include "sfm/core/run_context.h"
#include "sfm/features.h"
#include "sfm/intrinsics.h"
#include "sfm/matching.h"

namespace rotunda::sfm {

enum class TwoViewKind {
  kCalibrated,    // essential matrix: intrinsics known, or assumed and as good as free ones
  kUncalibrated,  // fundamental matrix; the pose comes from the assumed focal lengths
  kPlanar,        // homography explains the matches, with parallax
  kPanoramic,     // rotation alone explains them, or the rays are as good as parallel: no baseline
};

/// A verified pair.
struct TwoView {
  ImagePair pair;
  TwoViewKind kind = TwoViewKind::kCalibrated;
  Rigid3 second_from_first;     // |translation| = 1, or 0 when kPanoramic
  std::vector<Match> inliers;   // sorted by first; in front of both cameras
  double median_angle_rad = 0;  // triangulation angle over the inliers; 0 when kPanoramic
};

/// Sorted by pair.
struct TwoViews {
  std::vector<TwoView> pairs;
};

struct TwoViewOptions {
  double max_error_px = 4.0;  // Sampson distance; COLMAP's
  size_t min_inliers = 15;
  double min_inlier_ratio = 0.25;  // of the pair's matches
  double confidence = 0.999;
  int max_iterations = 10000;
  /// Homography inliers / epipolar inliers above which a pair counts as planar or panoramic.
  double max_homography_ratio = 0.8;
  /// Median triangulation angle below which a pair counts as panoramic. In a rig, where no two
  /// cameras share a place, such pairs show different parts of the rig that look alike.
  double min_angle_rad = RadFromDeg(1.0);
  Status Validate() const;
};

/// Robust two-view geometry of every pair: LO-RANSAC (Lebeda et al., BMVC 2012) over the five-point
/// solver (Nister, PAMI 2004) when intrinsics are known, over the seven-point solver otherwise;
/// homography test; refinement of the pose on the Sampson error over the inliers. The seed of a
/// pair depends on context.seed and the pair's ids alone.
Result<TwoViews> BuildTwoViews(const Features& features, const Intrinsics& intrinsics,
                               const Matches& matches, const TwoViewOptions& options,
                               RunContext& context);

}  // namespace rotunda::sfm
