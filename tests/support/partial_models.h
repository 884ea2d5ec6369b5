#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "sfm/core/rigid3.h"
#include "sfm/reconstruction.h"
#include "tests/support/synthetic_world.h"

namespace rotunda::test {

inline constexpr size_t kRingImages = 24;  // of SyntheticOptions as they are: 12 columns of 2
/// The images of `columns` columns from `first` on, around that ring.
std::vector<ImageId> Columns(size_t first, size_t columns);

/// What incremental reconstruction would make of `images` alone: the points that at least two of
/// them see, adjusted to the noisy keypoints, in a random frame of its own (any rotation, metres of
/// translation, scale 0.2 to 5).
sfm::Reconstruction MakePartialModel(const SyntheticWorld& world,
                                     const std::vector<ImageId>& images, uint64_t seed,
                                     RunContext& context);

/// Estimates the relative poses anew from the noisy keypoints, as the front end does, so that they
/// have its errors; pairs that do not hold go. Builds the view graph anew.
void EstimateTwoViews(SyntheticWorld& world, RunContext& context);

/// Keeps the pairs that `keep` is true for, and builds the view graph anew.
void KeepPairs(SyntheticWorld& world, const std::function<bool(const ImagePair&)>& keep);

/// Adds the pair that a garment with the same print before and behind would bring: the relative
/// pose to the second camera carried half a turn about the vertical axis, and matches between what
/// that camera would show of the print (the middle third of the body's height) and the nearest
/// keypoints. A true pair of the same pictures goes. Rebuild the view graph afterwards. False: too
/// few matches.
bool AddLookAlikePair(SyntheticWorld& world, ImageId first, ImageId second);

}  // namespace rotunda::test
