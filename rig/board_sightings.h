#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "rig/board.h"
#include "rig/board_detection.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"

namespace rotunda::rig {

/// A camera that took part in at least one shot.
struct SightedCamera {
  std::string camera;  // "c07r2"; unique
  std::string serial;  // empty when the pictures do not say
  int width_px = 0;    // 0 when none of its pictures could be read
  int height_px = 0;
};

/// All cameras' pictures of the board at one place.
struct BoardShot {
  std::string id;                // of the frame set, or "shot 3" of a folder of cameras
  std::filesystem::path folder;  // where its pictures are
};

/// One camera in one shot: a detection, or why there is none ("no picture in this shot", "status
/// is missing", "cannot be read: ...").
struct BoardSighting {
  std::filesystem::path picture;  // empty when there is none
  std::optional<BoardDetection> detection;
  std::string missing;  // empty when there is a detection
};

/// What a calibration starts from.
struct BoardSightings {
  std::vector<SightedCamera> cameras;                 // sorted by name
  std::vector<BoardShot> shots;                       // in the order they were given
  std::vector<std::vector<BoardSighting>> sightings;  // [shot][camera], a row for every shot
};

/// Where the pictures are, before they are read. `pictures[shot][camera]` as in BoardSightings.
struct ShotPicture {
  std::filesystem::path file = {};  // empty: `missing` says why
  std::string pixel_format = {};    // "Bayer...": see DetectBoardInMosaic
  std::string xxh3 = {};            // checksum as in the frame set; empty when not known
  std::string missing = {};
};
struct ShotPictures {
  std::vector<SightedCamera> cameras;
  std::vector<BoardShot> shots;
  std::vector<std::vector<ShotPicture>> pictures;
};

/// Each of `folders` is a frame set (one shot), a folder whose subfolders are frame sets
/// (placement_00, ...: one shot each, by name), or a folder whose subfolders are cameras with the
/// same number of pictures each: the k-th picture of every camera, in natural order ("2" before
/// "10"), is one shot. Frame sets may have different cameras. Errors (kBadInput, kNotFound) name
/// the folder; so do a shot given twice and two serials or two sizes under one camera name.
Result<ShotPictures> FindShots(const std::vector<std::filesystem::path>& folders);

/// Detects the board in every picture, in parallel over pictures (stage "board"). A picture that
/// cannot be read, has another checksum than its frame set says or another size than its camera's
/// others is a sighting that says so.
/// kCancelled when stopped; other errors as DetectBoard.
Result<BoardSightings> DetectBoards(const ShotPictures& shots, const Board& board,
                                    const BoardDetectionOptions& options, RunContext& context);

/// Markers, or corners, that were not used for one reason, in all pictures.
struct RejectedCount {
  RejectionText text;
  size_t count = 0;
  std::vector<std::pair<std::string, size_t>> cameras;  // those with the most first
};
/// The most frequent reason first.
std::vector<RejectedCount> CountRejectedMarkers(const BoardSightings& sightings);
std::vector<RejectedCount> CountRejectedCorners(const BoardSightings& sightings);
/// "c03r2 4, c04r2 3": the cameras with the most, and how many each.
std::string WorstCameras(const RejectedCount& rejected);

}  // namespace rotunda::rig
