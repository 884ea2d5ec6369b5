#pragma once

#include <memory>
#include <string>

#include "rig/trigger_line.h"
#include "sfm/core/result.h"

namespace rotunda::rig {

struct GpiodLineOptions {
  std::string chip = "/dev/gpiochip0";
  int line = 4;             // offset on the chip
  bool active_low = false;  // an inverting driver sits between line and cameras
};

/// Name under which `gpioinfo` shows who has the line.
inline constexpr char kGpioConsumer[] = "rotunda-trigger";

/// A line of a GPIO chip through libgpiod (version 1 or 2, whichever it was built with). The line
/// is ours, driven inactive, until the object goes. kIo names chip and line: not there, no
/// permission, held by another program.
Result<std::unique_ptr<TriggerLine>> OpenGpiodTriggerLine(const GpiodLineOptions& options);

}  // namespace rotunda::rig
