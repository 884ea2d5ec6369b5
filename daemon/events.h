#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace rotunda::daemon {

/// One line of the event log. Kinds and what their `about` names:
///   job_queued, job_started, job_progress, job_done, job_failed, job_cancelled, job_interrupted:
///     number of the job
///   capture_stored, capture_adopted (found on disk after a crash), capture_gone (its files are
///     missing), capture_removed (by the retention policy), capture_waits (the disk refuses a shot
///     that is taken), capture_lost (it refused until the daemon had ended): id of the capture
///   calibration_stored, calibration_activated: id of the calibration
///   reconstruction_stored: id of the reconstruction
///   camera_moved, camera_back, camera_unregistered (several captures in a row have no pose of it),
///     camera_registered (again): name of the camera
struct EventRecord {
  int64_t number = 0;  // rises; gaps are possible
  std::string at;      // RFC 3339
  std::string kind;
  std::string about;
  std::string data;  // a JSON object
};

/// Hands stored events to whoever listens, in the order of their numbers. Events are published by
/// the thread that stored them: listeners must be quick and must not call the store.
class EventHub {
 public:
  using Listener = std::function<void(const EventRecord& event)>;

  /// Ends the subscription when it goes; the listener is not running and will not run any more
  /// when the destructor returns. Must not outlive the hub.
  class Subscription {
   public:
    Subscription(EventHub* hub, uint64_t key) : hub_(hub), key_(key) {}
    ~Subscription();
    Subscription(const Subscription&) = delete;
    Subscription& operator=(const Subscription&) = delete;

   private:
    EventHub* hub_;
    uint64_t key_;
  };

  /// A client that resumes subscribes first, reads what it missed (ListEvents) and then drops what
  /// the listener brings a second time, by number.
  std::unique_ptr<Subscription> Subscribe(Listener listener);
  void Publish(const std::vector<EventRecord>& events);

 private:
  std::mutex mutex_;
  uint64_t last_key_ = 0;
  std::map<uint64_t, Listener> listeners_;
};

}  // namespace rotunda::daemon
