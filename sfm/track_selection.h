#pragma once

#include <vector>

#include "sfm/features.h"
#include "sfm/tracks.h"

namespace rotunda::sfm {

/// Which tracks a model is grown on: long ones that cover the pictures evenly. Tracks are taken
/// longest first; one is taken when some picture of it has fewer than `per_image` so far and fewer
/// than its even share in the grid cell where the track is seen. By TrackId.
std::vector<bool> SelectTracks(const Features& features, const Tracks& tracks, size_t per_image);

}  // namespace rotunda::sfm
