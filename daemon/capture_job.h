#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "daemon/jobs.h"
#include "daemon/store.h"
#include "rig/capture_session.h"
#include "rig/frame_set_writer.h"

namespace rotunda::daemon {

/// Aravis cameras and the GPIO line of `options`, or, with the socket of simulated cameras, these.
Result<rig::CaptureSession::Devices> OpenDevices(
    const rig::CaptureOptions& options, const std::optional<std::filesystem::path>& simulated);

/// kInvalidArgument, "subject" as context, says what was found and what may stand there.
Status CheckSubject(const std::string& subject);

/// The stage of a capture job whose shot is taken and that the disk refuses.
inline constexpr char kWaitingForDisk[] = "waiting for the disk";
/// What /v1/status says of such a shot, and the refusal of a cancel.
inline constexpr char kShotWaits[] = "is taken and waits for the disk";

/// Asked again and again while the disk refuses a shot, and told why; false: the shot is given up.
using DiskPatience = std::function<bool(const Error& why)>;

/// The cameras of the rig and the way to the disk, held open between shots.
class CaptureStation {
 public:
  struct Options {
    rig::CaptureOptions capture;
    std::optional<std::filesystem::path> simulated;  // socket of simulated cameras
    /// A shot waits so long for cameras that are not ready, then it is taken without them.
    std::chrono::milliseconds ready_patience{5000};
  };
  explicit CaptureStation(Options options);

  /// Begins to open the cameras; does nothing when that was done. Tried again by every shot.
  Status Open();
  /// In the order of the configuration; empty while not open.
  std::vector<rig::CameraState> States() const;
  /// In the order of the configuration.
  std::vector<std::string> CameraNames() const;
  /// Why the cameras are not open; nullopt while they are, or nobody has tried.
  std::optional<Error> OpenTrouble() const;
  /// One camera's picture now, demosaiced, as JPEG. kNotFound: no such camera.
  Result<std::string> PreviewJpeg(const std::string& camera);

  const char* TriggerSource() const;  // "gpio" or "simulated", for the frame set

  /// Takes a shot and makes it a durable frame set. What is told is without the frames. Stopped
  /// before the pulse it is kCancelled. After it frames are waited for a second more, and those
  /// that have come by then are the shot, which is written; without any it is kCancelled. What the
  /// disk refuses waits in memory as long as `patience` wants.
  struct Taken {
    rig::Shot shot;
    rig::WrittenSet written;
  };
  Result<Taken> Take(rig::FrameSetOrder order, const DiskPatience& patience, JobContext& context);

 private:
  Result<rig::CaptureSession*> Session();
  Result<std::unique_ptr<rig::CaptureSession>> NewSession() const;

  const Options options_;
  mutable std::mutex mutex_;  // of session_ while it is made, and of open_trouble_
  std::unique_ptr<rig::CaptureSession> session_;
  std::optional<Error> open_trouble_;
  rig::FrameSetWriter writer_;  // goes before the session, whose memory the frames are
};

/// What the shot was, without its frames.
rig::Shot FactsOf(const rig::Shot& shot);

struct CaptureJobOptions {
  /// With less room on the disk captures are refused. From any thread.
  std::function<uint64_t()> disk_reserve_bytes = [] { return uint64_t{0}; };
  /// For so long after its end has begun the daemon waits for a disk that refuses a shot.
  std::chrono::milliseconds end_patience{0};
  /// Told what becomes of a shot when the store cannot keep the event of it. Null: nobody listens.
  std::function<void(const std::string& trouble)> tell = nullptr;
};

/// The reconstruction that a capture job asks for, of the set that it has taken; nullopt: none. For
/// StoreOptions.
std::optional<NewJob> CaptureFollowUp(const Store& store, const JobRecord& job);

/// POST /v1/captures {"subject": text?, "reconstruct": true?, "preset"?, "prior"?}. The set gets
/// the calibration in force; when that cannot be read the shot is taken, and reconstructed without
/// a prior, and "notes" says so. Its reconstruction is queued unless "reconstruct" is false.
/// Result: {"capture", "ok", "of", "complete", "notes"?, "summary", "pulses", "median_skew_us",
/// "max_skew_us", "max_skew_camera", "resent_packets"}, the figures of the shot only when it was
/// taken in this run, the skew only when it is known. Run again it keeps the shot that it had
/// taken; without one it takes it under a new id. A shot that is taken is given up for the end of
/// the daemon alone: while the disk refuses it the job waits and refuses to be cancelled (event
/// capture_waits); when the daemon has ended without room for it the error and the event
/// capture_lost name it. `store` and `station` outlive the handler.
JobHandler MakeCaptureHandler(Store& store, CaptureStation& station, CaptureJobOptions options);

}  // namespace rotunda::daemon
