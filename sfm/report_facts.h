#pragma once

#include <optional>
#include <string>
#include <vector>

#include "sfm/report.h"

namespace rotunda::sfm::report {

/// How much attention something asks for.
enum class Level { kGood, kUnknown, kLook, kBad };

/// CSS class of a level: "good", "unknown", "look", "bad".
std::string_view LevelName(Level level);

/// A figure that every camera may have. `values` is by camera; nullopt: not known.
struct Quantity {
  std::string key;    // CSS name
  std::string label;  // plain text
  std::string unit;
  std::vector<std::optional<double>> values;
  bool graded = false;  // says how good the camera is (has bars, a plot and a colour)
  int decimals = 0;
  double mean = 0, median = 0, max = 0;
  double low = 0, high = 0;  // 5th and 95th percentile
  size_t worst = 0;          // camera with the largest value

  bool Known() const;
};

struct CameraFacts {
  Level level = Level::kGood;
  bool moved = false;
  bool swapped = false;
  bool wrong_side = false;
  std::vector<std::string> notes;  // plain text, why the level is not good
};

struct Verdict {
  Level level = Level::kUnknown;
  std::string mark;                  // the answer in two or three words
  std::string headline;              // plain text
  std::vector<std::string> details;  // plain text
};

/// What the report says, before it is drawn.
struct Facts {
  std::vector<CameraFacts> cameras;  // in the order of PoseSet::cameras
  std::vector<Quantity> quantities;  // those known of at least one camera
  Verdict shot;                      // is this reconstruction good
  Verdict rig;                       // do the cameras stand where the calibration says
  size_t observations = 0;
  bool has_sides = false;

  const Quantity* Find(std::string_view key) const;
};

/// `poses.cameras` and `set.frames` name the same cameras in the same order.
Facts BuildFacts(const ReportInput& input);

}  // namespace rotunda::sfm::report
