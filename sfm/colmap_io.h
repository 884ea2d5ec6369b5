#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "sfm/core/frame_set.h"
#include "sfm/core/result.h"
#include "sfm/matching.h"
#include "sfm/reconstruction.h"

namespace rotunda::sfm {

enum class ColmapEncoding { kBinary, kText };

/// Writes cameras, images and points3D (.bin or .txt) of COLMAP 3.8 into `folder`, which must
/// exist. Camera ids are lens + 1, image ids are ImageId + 1, names are the frames' files without
/// their folder, or with it for the whole set where two files would have one name. Unregistered
/// images are left out. kInvalidArgument: a keypoint in two points, a name with white space in
/// text.
Status WriteColmapModel(const Reconstruction& reconstruction, const Features& features,
                        const FrameSet& set, const std::filesystem::path& folder,
                        ColmapEncoding encoding);

/// A COLMAP model as written; the keypoints come from images.bin.
struct ColmapModel {
  Reconstruction reconstruction;
  Features features;                     // positions only
  std::vector<std::string> image_names;  // by ImageId, sorted by COLMAP's image id
};
/// Reads cameras.bin, images.bin, points3D.bin (or .txt). kBadInput names file and what was cut
/// short or out of range. Where a track has two keypoints of one picture, the first is kept.
Result<ColmapModel> ReadColmapModel(const std::filesystem::path& folder);

/// Keypoints, descriptors (when there) and verified matches of a COLMAP database.db; images are
/// matched to the frames of `set` by file name (with or without folder). Colours are not in a
/// database and stay empty. kBadInput names file, table and row: not such a database, an image of
/// the set (status "ok") not in it, another size than the set says, a blob of another length than
/// its rows and columns, a match outside of the keypoints, an open write-ahead log.
struct ColmapDatabase {
  Features features;
  Matches matches;
  Matches verified_inliers;  // two_view_geometries with at least one inlier
};
Result<ColmapDatabase> ReadColmapDatabase(const std::filesystem::path& file, const FrameSet& set);

/// ASCII-header binary PLY: x y z red green blue.
Status WritePly(const Reconstruction& reconstruction, const std::filesystem::path& file);

}  // namespace rotunda::sfm
