#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "rig/bandwidth.h"
#include "rig/frame_memory.h"
#include "sfm/core/result.h"

namespace rotunda::rig {

/// A camera of the rig as the configuration has it.
struct CameraPlace {
  std::string camera;   // its name in the rig, e.g. "c07r2"
  std::string serial;   // expected; empty: any
  std::string address;  // IPv4; empty: found by its serial
  std::string uplink;   // name of the network link it shares with others
};

/// What a camera says of itself.
struct CameraIdentity {
  std::string address;
  std::string serial;
  std::string vendor;
  std::string model;
  std::string firmware;
};

/// Of the 8-bit formats that cameras may be set to.
inline size_t BytesPerPixel(std::string_view pixel_format) {
  return pixel_format == "RGB8" ? 3 : 1;
}

/// What is written to a camera; Apply() reads every value back.
struct CameraSettings {
  int width_px = 0;  // 0: the whole sensor
  int height_px = 0;
  std::string pixel_format = "BayerRG8";
  double exposure_us = 4000;
  double gain_db = 0;
  std::string trigger_source = "Line0";  // the camera's input the trigger cable is plugged into
  bool ptp = false;                      // clocks kept together by IEEE 1588
  int packet_size_bytes = 9000;          // at most; less where the path carries less
  UplinkLoad uplink;                     // sets the gap between packets
  int deadline_ms = 2000;                // after the pulse, for a frame to be there
  bool resend = true;                    // ask again for lost packets

  /// Of one frame; 0 while the camera's sensor decides.
  size_t PayloadBytes() const {
    return static_cast<size_t>(width_px) * height_px * BytesPerPixel(pixel_format);
  }
};

/// Exactly the settings that can be read from a camera, as it has them.
struct AppliedSettings {
  int width_px = 0;
  int height_px = 0;
  std::string pixel_format;
  double exposure_us = 0;
  double gain_db = 0;
  int packet_size_bytes = 0;
  int64_t packet_delay_ns = 0;
  size_t payload_bytes = 0;  // of one frame
};

enum class TriggerBy { kLine, kSoftware };

/// One frame that came out of a camera. Only a complete frame has more than `complete`, `problem`
/// and `memory`: what the camera sent with an incomplete one is stale or made up.
struct CameraFrame {
  bool complete = false;
  std::string problem;  // why it is not complete
  FrameBlock memory;    // pixels, row by row, no padding
  uint64_t frame_id = 0;
  uint64_t timestamp_ns = 0;  // start of exposure by the camera's clock
  int width_px = 0;
  int height_px = 0;
  std::string pixel_format;
};

/// host time = camera time + offset; true to +-uncertainty.
struct ClockSample {
  int64_t host_minus_camera_ns = 0;  // host: std::chrono::steady_clock since its epoch
  int64_t uncertainty_ns = 0;        // half of the round trip
};

/// How the stream of a camera fares; counts since it was opened.
struct StreamCounters {
  uint64_t received_packets = 0;
  uint64_t ignored_packets = 0;  // of them: of frames that were not waited for, by their number
  uint64_t resent_packets = 0;
  uint64_t missing_packets = 0;
  uint64_t frames_without_memory = 0;  // a frame came that nobody had asked for
};

struct CameraHealth {
  bool control_held = false;
  std::optional<double> temperature_deg_c;  // where the camera offers it
  std::optional<int64_t> ptp_offset_ns;     // from the master; set while the clock follows it
};

/// An open camera that we control. Not thread-safe: one thread owns it, and calls may block for
/// seconds when the camera is gone. Destruction closes it (blocks likewise).
class Camera {
 public:
  using Clock = std::chrono::steady_clock;
  virtual ~Camera() = default;

  virtual const CameraIdentity& identity() const = 0;

  /// Writes the settings and reads each back. kFailed names the feature, what was wanted and what
  /// the camera has. kInvalidArgument: the uplink is too slow for frames as large as the camera's.
  /// Stops an acquisition. PTP is switched on and not waited for: see CheckPtp.
  virtual Result<AppliedSettings> Apply(const CameraSettings& settings) = 0;

  /// Makes the camera wait for one trigger and lends it memory for one frame (payload_bytes at
  /// least). What an earlier shot left behind is thrown away. kFailed when control was lost or the
  /// camera does not answer.
  virtual Status Arm(TriggerBy by, FrameBlock memory) = 0;
  /// For another trigger while the camera stays armed: memory for one more frame, beside what an
  /// earlier trigger has not filled.
  virtual Status Refill(FrameBlock memory) = 0;
  /// What came is of a trigger before the camera was armed. Waits, with this memory alone, for the
  /// frame of this trigger, which may have the same id.
  virtual Status StartOver(FrameBlock memory) = 0;
  /// True once the camera says that it will answer a trigger (or cannot tell); false at `deadline`.
  virtual Result<bool> WaitArmed(Clock::time_point deadline) = 0;
  /// Fires the camera alone; it must be armed by kSoftware.
  virtual Status SoftwareTrigger() = 0;
  /// The frame, complete or not; nullopt when none came until `deadline`.
  virtual std::optional<CameraFrame> Fetch(Clock::time_point deadline) = 0;
  /// Ends waiting for triggers; gives back memory that was not filled.
  virtual Status Disarm() = 0;

  /// The camera's clock against the host's.
  virtual Result<ClockSample> SampleClock() = 0;
  virtual StreamCounters counters() const = 0;
  virtual Result<CameraHealth> ReadHealth() = 0;
  /// With CameraSettings::ptp: kFailed while the camera's clock does not follow its PTP master
  /// closely.
  virtual Status CheckPtp() = 0;
  /// Asks the camera, after a call has failed: true when another has control, or nobody.
  virtual bool LostControl() = 0;
};

/// Opens the camera of `place` and takes control of it. kNotFound: nobody answers there. kBadInput:
/// another serial than expected, with both. kAlreadyExists: another program has control. kFailed:
/// it answers, but cannot be used.
using OpenCamera = std::function<Result<std::unique_ptr<Camera>>(const CameraPlace& place)>;

}  // namespace rotunda::rig
