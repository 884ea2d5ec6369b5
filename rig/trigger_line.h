#pragma once

#include <chrono>

#include "sfm/core/result.h"

namespace rotunda::rig {

/// The line that fires all cameras at once.
class TriggerLine {
 public:
  using Clock = std::chrono::steady_clock;
  virtual ~TriggerLine() = default;

  /// Raises the line for `width` and lowers it again; gives the time of the rising edge. On an
  /// error the line is low, as far as it can still be set.
  virtual Result<Clock::time_point> Pulse(std::chrono::microseconds width) = 0;
};

}  // namespace rotunda::rig
