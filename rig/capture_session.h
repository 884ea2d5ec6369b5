#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <vector>

#include "rig/camera_worker.h"
#include "rig/capture_options.h"
#include "rig/frame_memory.h"
#include "rig/shot.h"
#include "rig/trigger_line.h"

namespace rotunda::rig {

/// All cameras of the rig, open and watched, and the line that fires them. Cameras that cannot be
/// opened or are lost are opened again in the background; nothing waits for them.
///
/// One pulse: all armed -> checked -> pulse -> deadline -> a verdict on every camera. Public
/// functions may be called from any thread; shots are taken one after the other.
class CaptureSession {
 public:
  /// What a session drives. `open` is called from many threads. Without a trigger cameras can be
  /// watched, but no shot taken.
  struct Devices {
    OpenCamera open;
    std::unique_ptr<TriggerLine> trigger;
  };

  /// Starts to open the cameras, all at once, and returns: see WaitUntilReady. Errors: options that
  /// are not valid, socket buffers that are too small for cameras on a network.
  static Result<std::unique_ptr<CaptureSession>> Open(CaptureOptions options, Devices devices);
  /// Closes the cameras. Every Shot must be gone by then: its frames' memory is the session's.
  ~CaptureSession();
  CaptureSession(const CaptureSession&) = delete;
  CaptureSession& operator=(const CaptureSession&) = delete;

  /// How many cameras are ready; waits until all are, or `patience` is over, or `stop` is set.
  size_t WaitUntilReady(std::chrono::milliseconds patience, std::stop_token stop = {});

  /// Takes a shot; fires again, at most options.retries times, when a camera missed, and gives the
  /// pulse with most good frames. A shot with missing cameras is a result. Once `stop` is set there
  /// are no more pulses, and nothing is waited for before one; once `give_up` is, frames that have
  /// not come are not waited for either, and those that have are the shot. kFailed: no camera is
  /// ready; or frames of earlier shots fill the memory because the disk does not keep up (nothing
  /// is lost, try again). kIo: the trigger line. kCancelled: stopped before the pulse, or given up
  /// before any frame came.
  Result<Shot> Capture(std::stop_token stop = {}, std::stop_token give_up = {});

  /// One camera's frame by software trigger, between shots. Its memory is the session's. Shots come
  /// first: kFailed, at once, while one is taken or waits, or another preview is under way.
  Result<CameraFrame> Preview(const std::string& camera);

  /// In the order of the configuration.
  std::vector<CameraState> States() const;
  const CaptureOptions& options() const { return options_; }
  /// The most memory frames will take, by the cameras seen so far.
  size_t MemoryLimit_bytes() const { return memory_.limit_bytes(); }
  /// What the files of a shot may take: frames hardly grow when they are coded.
  size_t ShotLimit_bytes() const;

 private:
  CaptureSession(CaptureOptions options, Devices devices);
  /// Where cameras are that have no address or are not there; asks the networks at most every few
  /// seconds.
  class Locator;

  /// Makes room for the frames of the largest camera seen.
  Status FitMemory();
  Result<Shot> TakePulse(bool stay_armed, std::stop_token stop, std::stop_token give_up);
  std::vector<CameraWorker*> ReadyWorkers() const;

  const CaptureOptions options_;
  const Devices devices_;
  std::unique_ptr<Locator> locator_;
  std::mutex one_shot_;
  std::atomic<int> shots_wanted_ = 0;  // taken or waiting for `one_shot_`
  FrameMemory memory_;
  std::vector<std::unique_ptr<CameraWorker>> workers_;
};

}  // namespace rotunda::rig
