#pragma once

#include <chrono>
#include <cstddef>
#include <string>
#include <vector>

#include "rig/camera.h"
#include "rig/gpiod_trigger_line.h"
#include "sfm/core/result.h"

namespace rotunda::rig {

/// A network link that cameras share on their way to this machine.
struct UplinkOptions {
  std::string name;
  int mbit_per_s = 10000;
  int camera_mbit_per_s = 1000;  // of each camera's own link
};

struct TriggerOptions {
  GpiodLineOptions gpio;
  int pulse_us = 1000;
  std::string camera_input = "Line0";  // where the cable is plugged into the cameras
};

/// What one shot may take. All times count from the pulse unless said otherwise.
struct ShotTiming {
  int arm_ms = 2000;  // for all cameras to say that they are armed; then the pulse comes anyway
  int deadline_ms = 2000;  // a frame that is there later is late
  int late_ms = 1500;      // after the deadline: to tell late frames from missing ones
  int settle_ms = 40;  // after the last packet of all cameras; more frames tell of a second pulse
};

struct CaptureOptions {
  std::vector<CameraPlace> cameras;
  std::vector<UplinkOptions> uplinks;
  TriggerOptions trigger;
  // Common to all cameras; `bandwidth` and `trigger_source` are filled in from the above.
  CameraSettings settings;
  ShotTiming timing;
  double skew_limit_us = 1000;  // |exposure begin - median|; a walking person moves 1 mm in this
  int retries = 1;              // more pulses when a camera missed
  int sets_in_memory = 4;       // how many sets' frames memory may hold, waiting for the disk

  /// All that is wrong, kInvalidArgument each; the context is "table.key" of the configuration.
  /// Checks too that a frame gets over its uplink before the deadline.
  std::vector<Error> Problems() const;
  /// The first of them.
  Status Validate() const;

  /// `settings` for one camera: its share of its uplink, the trigger's input.
  CameraSettings SettingsOf(const CameraPlace& place) const;
};

/// The kernel's limit of socket buffers against what a frame of `payload_bytes` needs; kFailed says
/// what to type. A smaller buffer loses packets whenever the machine is busy.
Status CheckSocketBuffers(size_t payload_bytes);

}  // namespace rotunda::rig
