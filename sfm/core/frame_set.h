#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "sfm/core/ids.h"
#include "sfm/core/result.h"

namespace rotunda {

/// One picture of one camera.
struct Frame {
  std::string camera;  // its name in the rig, e.g. "c07r2"; unique in the set
  std::string serial;
  std::string file;  // relative to the set's folder
  int width_px = 0;
  int height_px = 0;
  std::string pixel_format;  // "Mono8", "RGB8" or a Bayer format ("BayerRG8", ...) as in GenICam
  double exposure_us = 0.0;
  double gain_db = 0.0;
  uint64_t frame_id = 0;
  uint64_t timestamp_ns = 0;
  std::string status = "ok";  // "ok", or why the frame is not usable ("missing", "late", ...)
  std::string xxh3;           // 16 hex digits, XXH3-64 of the picture file; empty when not known
};

/// What a trigger may say of itself, as in JSON; numbers keep their kind.
using TriggerValue = std::variant<std::string, bool, uint64_t, int64_t, double>;

/// A synchronised shot of the rig, or a plain folder of pictures. Frames are sorted by camera name;
/// ImageId is the place in `frames`.
struct FrameSet {
  std::filesystem::path folder;
  std::string id;
  std::string captured_at;  // RFC 3339
  std::optional<std::string> subject;
  std::map<std::string, TriggerValue> trigger;  // e.g. {"source": "simulated"}
  std::vector<Frame> frames;
  bool plain_folder = false;  // true: no frameset.json, made from the pictures found

  const Frame& frame(ImageId id) const { return frames[id.index()]; }
  std::filesystem::path PicturePath(ImageId id) const { return folder / frame(id).file; }
};

/// Format name and version in frameset.json.
inline constexpr char kFrameSetFormat[] = "rotunda-frameset/1";

/// Reads a frame set: `folder`/frameset.json when it is there, else the pictures (*.png, *.jpg,
/// *.jpeg, *.tif, *.tiff, *.bmp, *.ppm, *.pgm, not recursive; a folder "images" or "frames" below
/// is used when `folder` itself has none) with camera = file name without its ending; sizes are
/// then 0: nobody knows them before BuildFeatures has read the pictures. Errors (kBadInput /
/// kNotFound): no such folder, no picture, wrong format version, a field that is missing or of the
/// wrong type, a camera twice, two sizes under one camera, a file outside of the folder, a file
/// that is listed with status "ok" and is not there.
Result<FrameSet> ReadFrameSet(const std::filesystem::path& folder);

/// How a set leaves out a picture or camera that cannot be used, for the end of an error's text.
std::string HowToLeaveOut(const FrameSet& set);

/// frameset.json text of `set` (the pictures are the writer's business).
std::string FrameSetToJson(const FrameSet& set);
/// The inverse; `source` names the text in errors. Does not look at the disk.
Result<FrameSet> FrameSetFromJson(const std::string& text, const std::string& source);

}  // namespace rotunda
