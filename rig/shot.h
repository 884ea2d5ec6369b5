#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "rig/camera.h"
#include "sfm/core/frame_set.h"

namespace rotunda::rig {

/// What became of one camera in a shot; the first that applies.
enum class Verdict {
  kOk,
  kDisconnected,  // it does not answer: power, cable, network
  kWrongCamera,   // another serial number than configured
  kControlLost,   // it restarted, or another program has taken it
  kCameraError,   // it answers and is ours, but refuses what it is told
  kNotArmed,      // it did not get ready for the trigger, and no frame came
  kArmedLate,     // it was ready only after the pulse, and no frame came
  kMissing,       // it answers and was armed, but nothing came: trigger cable
  kInterrupted,   // its frame was no longer waited for
  kIncomplete,    // packets of its frame were lost
  kLate,          // its frame came after the deadline
  kWrongPicture,  // of another size or format than it was set to
  kWrongId,       // not the frame of this pulse by its number
  kNoClock,       // its clock does not follow the PTP master: when it exposed would not be known
  kSkewed,        // exposed at another moment than the others
  kSecondFrame,   // it saw more than one pulse
};
/// As in frameset.json ("ok", "missing", "wrong id", ...).
const char* VerdictName(Verdict verdict);

struct CameraShot {
  std::string camera;
  Verdict verdict = Verdict::kMissing;
  std::string reason;                // in words, with figures; empty when ok
  std::optional<CameraFrame> frame;  // complete ones, also when the verdict is not ok
  AppliedSettings settings;
  std::string serial;
  uint64_t resent_packets = 0;
  std::optional<double> arrival_ms;  // of the whole frame, after the pulse; unset when none came
  // Begin of exposure on a clock common to all cameras, and how well it is known; unset when the
  // camera's clock could not be read.
  std::optional<int64_t> exposed_ns;
  double clock_uncertainty_us = 0;
  std::optional<double> skew_us;  // exposed_ns less the median of all cameras
};

/// How far apart the exposures began, over all complete frames.
struct SkewSummary {
  double median_us = 0;  // of |skew|
  double max_us = 0;
  std::string worst;  // the camera of the largest; empty when no exposure's time is known

  bool known() const { return !worst.empty(); }
};

/// One pulse and what came of it. The frames' memory is that of the session which took it.
struct Shot {
  std::vector<CameraShot> cameras;  // sorted by name
  SkewSummary skew;
  int pulses = 1;  // 2: the first pulse was missed by a camera, and so on
  std::string
      first_try;  // with pulses > 1: what was wrong with the others, "the same" as with this
  bool interrupted = false;  // frames, or another pulse, were no longer waited for

  size_t OkCount() const;
  bool complete() const { return OkCount() == cameras.size(); }
  uint64_t ResentPackets() const;
  /// "88/90 ok".
  std::string Tally() const;
  /// The tally and what is wrong with whom, a reason that several cameras share said once, with the
  /// range of its measured figures: "86/90 ok; 3 missing (...): c03r1, c03r2, c03r4; c07r2 late
  /// (...)".
  std::string Summary() const;
};

/// Fills in skew_us and the summary, and finds the skewed: a camera is, when it is more than
/// `limit_us` from the median by more than its clock is uncertain.
void JudgeSkew(double limit_us, Shot& shot);

/// The id a frame must have. Many cameras begin at 1 whenever they are armed, others count on; a
/// frame that was sent and never arrived leaves a gap of one. A camera that skips ids is refused
/// once and believed when it counts on from there; one that lags behind never is.
class FrameIdCheck {
 public:
  /// Of the warm-up frame.
  void Begin(uint64_t id) { last_ = id, unseen_ = 0, slipped_to_ = 0; }
  /// True when the id is 1 or follows the last one; remembers it then.
  bool Accept(uint64_t id);
  /// A pulse whose frame was not seen.
  void Miss() { ++unseen_; }
  uint64_t last() const { return last_; }

 private:
  uint64_t last_ = 0;
  uint64_t unseen_ = 0;
  uint64_t slipped_to_ = 0;  // 0: nowhere
};

}  // namespace rotunda::rig
