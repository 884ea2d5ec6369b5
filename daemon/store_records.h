#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace rotunda::daemon {

/// What the daemon keeps in its database, as plain values. Times are RFC 3339 in UTC with
/// milliseconds; paths are relative to the state folder.

/// Which part of a list, newest first: at most `limit` items after `after`: `next` of the page
/// before, or the id of an item that is there; empty: from the first.
struct Page {
  size_t limit = 50;
  std::string after;
};
inline constexpr size_t kMaxPageLimit = 500;

template <typename T>
struct Listing {
  std::vector<T> items;
  std::string next;  // `after` of the next page; empty when this is the last
};

/// A frame set under captures/<id>.
struct CaptureRecord {
  std::string id;
  std::string captured_at;
  std::optional<std::string> subject;
  uint64_t ok_frames = 0;  // frames whose status is "ok"
  uint64_t frames = 0;
  std::optional<std::string> calibration;  // in force when it was taken
  bool files_gone = false;                 // the folder was missing when the daemon started
  // The newest reconstruction that is sure and speaks of the rig (drift.h), else the newest sure
  // one, else the newest: its id and what it says ("sure", "unsure", "folded" or empty), and why.
  std::optional<std::string> reconstruction;
  std::string verdict;
  std::string verdict_reason;
};

struct FrameRecord {
  std::string camera;
  std::string serial;
  std::string file;  // relative to the state folder; empty when there is no picture
  std::string status;
  std::string reason;  // why it is not "ok", in words; may be empty
  std::string xxh3;
  uint64_t width_px = 0;
  uint64_t height_px = 0;
};

/// A folder calibrations/<id> with calibration.json and, when it was made here, report.html and
/// made_from.json.
struct CalibrationRecord {
  std::string id;
  std::string created_at;
  std::string source;  // "charuco", "sfm", "truth"
  uint64_t cameras = 0;
  std::optional<double> rms_px;
  std::optional<double> held_out_rms_px;
  bool active = false;  // in force
  std::optional<std::string> activated_at;
  bool files_gone = false;
  std::string made_from;  // the text of its made_from.json; empty: it has none
};

/// A folder reconstructions/<id> with poses.json, sparse/0, points.ply and report.html.
struct ReconstructionRecord {
  std::string id;
  std::string capture;
  std::optional<std::string> calibration;  // its poses are compared with
  std::string created_at;                  // when its poses.json was written
  std::string method;
  std::string preset;          // empty: the method has none
  std::string prior = "none";  // "calibration": its poses are no evidence of where cameras stand
  uint64_t registered = 0;
  uint64_t of = 0;
  double rms_px = 0;
  std::string verdict;  // "sure", "unsure", "folded"; empty: the method gives none
  std::string verdict_reason;
  bool folded = false;
  bool used_for_drift = false;                                // it may speak of it (drift.h)
  std::optional<double> mean_rotation_deg, mean_position_mm;  // against the calibration
  bool files_gone = false;
};

/// How far from its calibrated pose a camera may be found. Lengths are about two pixels of the
/// rig's cameras (f = 1600 px) for a subject 2 m away; less does not hurt a reconstruction.
struct DriftLimits {
  double position_mm = 2.5;
  double rotation_deg = 0.07;
  /// From how many captures in a row on a camera that is beyond a limit counts as moved: a single
  /// one may be a subject that was in its way.
  size_t captures = 2;
};

/// How far a camera was from its calibrated pose in one capture.
struct DriftRecord {
  std::string capture;
  std::string captured_at;
  std::string reconstruction;
  std::string calibration;
  std::string camera;
  double rotation_deg = 0;
  double position_mm = 0;
  // One standard deviation, of reconstruction and calibration together; absent when neither says.
  std::optional<double> rotation_sigma_deg, position_sigma_mm;
  bool beyond_limit = false;
  std::optional<std::string> swapped_with;  // the camera in whose place it stands
};

/// A camera against the calibration in force.
struct CameraDrift {
  DriftRecord latest;
  size_t captures = 0;  // compared
  size_t beyond = 0;    // how many in a row, the newest first, are beyond the limit
  bool moved = false;   // beyond for as many captures as the policy asks
};

/// A camera that has no pose in a reconstruction that may speak of drift.
struct UnregisteredRecord {
  std::string capture;
  std::string captured_at;
  std::string calibration;
  std::string camera;
  std::string reason;
};

/// A camera that the newest captures have no pose of.
struct UnregisteredCamera {
  UnregisteredRecord latest;
  size_t captures = 0;  // how many in a row
};

enum class JobKind { kCapture, kCalibration, kReconstruction };
const char* JobKindName(JobKind kind);  // "capture", "calibration", "reconstruction"
std::optional<JobKind> JobKindFromName(const std::string& name);

enum class JobState { kQueued, kRunning, kDone, kFailed, kCancelled, kInterrupted };
const char* JobStateName(JobState state);  // "queued", ...
std::optional<JobState> JobStateFromName(const std::string& name);

struct NewJob {
  JobKind kind = JobKind::kCapture;
  std::string body;             // a JSON object
  std::string idempotency_key;  // empty: none
};

struct JobRecord {
  int64_t number = 0;
  JobKind kind = JobKind::kCapture;
  JobState state = JobState::kQueued;
  std::string stage;  // of the progress; empty before the first
  uint64_t done = 0, total = 0;
  std::string idempotency_key;  // empty: none
  std::string body;             // the request, a JSON object
  std::string product;          // id of what it makes; reserved before a run's work begins
  std::string result;           // a JSON object; empty unless done
  std::string error;            // empty unless failed or interrupted
  std::string created_at;
  std::optional<std::string> started_at, ended_at;
  bool cancel_requested = false;
};

}  // namespace rotunda::daemon
