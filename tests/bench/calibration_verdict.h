#pragma once

#include <cstdio>
#include <string>

#include "tests/bench/calibration_run.h"

namespace rotunda::bench {

/// What a calibration of simulated cameras must keep, in the mean.
struct TruthLimits {
  double rotation_deg, position_mm, focal_percent, board_mm;
};

/// Counts what is not as it must be, naming each.
class Verdict {
 public:
  void AtMost(const std::string& what, double value, double limit) {
    Check(value <= limit, what, value, limit);
  }
  void AtLeast(const std::string& what, double value, double limit) {
    Check(value >= limit, what, value, limit);
  }
  void Keep(const std::string& run, const TruthErrors& errors, const TruthLimits& limits) {
    AtLeast(run + ": cameras found (share)", errors.found, 1);
    AtMost(run + ": mean rotation, deg", errors.rotation_deg, limits.rotation_deg);
    AtMost(run + ": mean position, mm", errors.position_mm, limits.position_mm);
    AtMost(run + ": focal length, %", errors.focal_percent, limits.focal_percent);
    AtMost(run + ": board, mm", errors.board_mm, limits.board_mm);
  }
  void Must(const std::string& what, bool holds) {
    if (holds) return;
    ++broken_;
    std::printf("NOT AS IT MUST BE  %s\n", what.c_str());
  }
  int broken() const { return broken_; }

 private:
  void Check(bool kept, const std::string& what, double value, double limit) {
    if (kept) return;
    ++broken_;
    std::printf("LIMIT BROKEN  %s: %.4g, limit %.4g\n", what.c_str(), value, limit);
  }
  int broken_ = 0;
};

}  // namespace rotunda::bench
