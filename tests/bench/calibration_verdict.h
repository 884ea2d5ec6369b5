#pragma once

#include <string>

#include "tests/bench/calibration_run.h"
#include "tests/bench/limits.h"

namespace rotunda::bench {

/// What a calibration of simulated cameras must keep, in the mean.
struct TruthLimits {
  double rotation_deg, position_mm, focal_percent, board_mm;
};

class Verdict : public Limits {
 public:
  void Keep(const std::string& run, const TruthErrors& errors, const TruthLimits& limits) {
    AtLeast(run + ": cameras found (share)", errors.found, 1);
    AtMost(run + ": mean rotation, deg", errors.rotation_deg, limits.rotation_deg);
    AtMost(run + ": mean position, mm", errors.position_mm, limits.position_mm);
    AtMost(run + ": focal length, %", errors.focal_percent, limits.focal_percent);
    AtMost(run + ": board, mm", errors.board_mm, limits.board_mm);
  }
};

}  // namespace rotunda::bench
