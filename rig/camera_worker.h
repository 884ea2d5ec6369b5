#pragma once

#include <atomic>
#include <condition_variable>
#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>

#include "rig/camera.h"
#include "rig/capture_options.h"
#include "rig/shot.h"

namespace rotunda::rig {

/// Why a camera that no longer answers is not used.
inline constexpr char kSilent[] = "it does not answer (power, cable and network of the camera?)";
/// Why a camera whose frame was no longer waited for has none.
inline constexpr char kGivenUp[] = "capture was interrupted before its frame came";

enum class CameraCondition { kOpening, kReady, kLost };

/// A camera as it was last seen.
struct CameraState {
  std::string camera;
  CameraIdentity identity;  // as configured until it has answered
  CameraCondition condition = CameraCondition::kOpening;
  std::string problem;  // why it is not ready, and what to do; may be empty while it is opened
  Verdict lost_as = Verdict::kDisconnected;  // the same as a verdict, while it is not ready
  AppliedSettings settings;
  CameraHealth health;
  StreamCounters counters;
  // Of the last complete frame, whatever it was taken for.
  std::optional<uint64_t> last_frame_id;
  std::optional<Camera::Clock::time_point> last_frame_at;
  std::string last_verdict;  // of the last shot
};
/// "opening", "ready", else what it is instead: "disconnected", "wrong camera", "control lost", ...
const char* ConditionName(const CameraState& state);
/// How long ago its last complete frame came, seconds; nullopt: none has.
std::optional<double> LastFrameAge_s(const CameraState& state);

/// What all workers of one pulse share. The session makes it, every worker that takes part holds
/// it: one whose camera hangs may come back to it when the session has long gone on.
class PulseTask {
 public:
  using Clock = Camera::Clock;
  /// `taking_part` of the rig's `cameras` will report.
  PulseTask(size_t cameras, size_t taking_part, const ShotTiming& timing,
            Clock::time_point arm_deadline)
      : timing_(timing),
        arm_deadline_(arm_deadline),
        taking_part_(taking_part),
        results_(cameras) {}

  const ShotTiming& timing() const { return timing_; }
  Clock::time_point arm_deadline() const { return arm_deadline_; }

  // Of the workers.
  bool closed() const;    // the session no longer listens
  bool given_up() const;  // nor waits for frames that have not come
  void ReportArmed();
  /// The camera's frame has come, or none will.
  void ReportFetched();
  /// Until all that take part have fetched or shots are given up; not beyond `deadline`.
  void WaitForOthers(Clock::time_point deadline);
  /// Packets that came to any camera behind its frame, and when the last did.
  void ReportPackets(Clock::time_point when);
  Clock::time_point last_packets() const;
  void ReportResult(size_t camera, CameraShot result);
  /// The time of the pulse; nullopt when there will be none.
  std::optional<Clock::time_point> WaitForPulse();

  // Of the session.
  void WaitForArmed(Clock::time_point deadline, std::stop_token stop);
  void PublishPulse(std::optional<Clock::time_point> pulse);
  /// Ends a task that gets no pulse, at once.
  void Abandon();
  /// Ends the task. Those that have not reported by then stay empty. Once `give_up` is set workers
  /// have a moment to report what they have.
  std::vector<std::optional<CameraShot>> TakeResults(Clock::time_point deadline,
                                                     std::stop_token give_up);

 private:
  const ShotTiming timing_;
  const Clock::time_point arm_deadline_;
  const size_t taking_part_;
  mutable std::mutex mutex_;
  // Apart, or every camera that is armed would wake all that wait for the pulse.
  std::condition_variable pulse_published_;  // to the workers
  std::condition_variable_any report_came_;  // to the session
  std::condition_variable all_fetched_;      // to the workers
  size_t armed_ = 0;
  size_t fetched_ = 0;
  size_t reported_ = 0;
  bool pulse_known_ = false;
  bool closed_ = false;
  bool given_up_ = false;
  std::optional<Clock::time_point> pulse_;
  Clock::time_point last_packets_ = Clock::time_point::min();
  std::vector<std::optional<CameraShot>> results_;
};

/// Owns one camera and the only thread that speaks to it: opens it, watches it while idle, opens it
/// again when it is lost, takes part in shots. Nobody waits for a camera that hangs.
class CameraWorker {
 public:
  /// `locate` gives the place with its address filled in.
  using Locate = std::function<Result<CameraPlace>(const CameraPlace&)>;
  struct Setup {
    CameraPlace place;
    CameraSettings settings;
    OpenCamera open;
    Locate locate;
  };
  explicit CameraWorker(Setup setup);
  /// Closes the camera; seconds when it is gone.
  ~CameraWorker();
  CameraWorker(const CameraWorker&) = delete;
  CameraWorker& operator=(const CameraWorker&) = delete;

  CameraState state() const;
  const CameraPlace& place() const { return setup_.place; }

  /// Takes part in a pulse as camera `index`. `stay_armed`: the camera still is from the last one.
  void JoinPulse(std::shared_ptr<PulseTask> task, size_t index, FrameBlock memory, bool stay_armed);
  /// After the last pulse of a shot.
  void EndShot();
  /// One frame by software trigger. kFailed at once when the camera still owes an earlier one.
  std::future<Result<CameraFrame>> Preview(FrameBlock memory);

 private:
  using Clock = Camera::Clock;
  using Job = std::function<void()>;

  /// The camera's clock against the host's over time: the best sample, which ages.
  class ClockTrack {
   public:
    void Add(const ClockSample& sample, Clock::time_point at);
    std::optional<ClockSample> At(Clock::time_point when) const;

   private:
    std::optional<ClockSample> best_;
    Clock::time_point taken_;
  };

  void Post(Job job);
  void Run();
  std::optional<Job> NextJob(std::chrono::milliseconds patience);
  void Idle();
  void TryOpen();
  Status OpenAndWarmUp();
  Status WaitForPtp();
  bool QuitsWithin(std::chrono::milliseconds patience);
  Status WarmUp();
  Result<CameraFrame> TakeByNow(FrameBlock memory);
  bool Answers(int tries) const;
  /// What is wrong with a camera that a call has failed on.
  struct Loss {
    Verdict verdict;
    std::string problem;
  };
  Loss FindOut(const Error& error) const;
  void Lose(const Loss& loss);
  void SampleClock(int tries);
  void NoteFrame(const CameraFrame& frame);
  /// When the camera was seen to be armed.
  Result<Clock::time_point> PrepareForPulse(const PulseTask& task, FrameBlock memory,
                                            bool stay_armed);
  bool IsOfEarlierTrigger(const CameraFrame& frame, Clock::time_point pulse) const;
  std::optional<CameraFrame> FetchUnlessGivenUp(const PulseTask& task,
                                                Clock::time_point deadline) const;
  std::optional<CameraFrame> FetchOwnFrame(const PulseTask& task, Clock::time_point pulse,
                                           bool stay_armed);
  CameraShot TakePulse(PulseTask& task, FrameBlock memory, bool stay_armed);
  /// When the pulse came; nullopt when there was none for this camera.
  std::optional<Clock::time_point> ArmAndFetch(PulseTask& task, FrameBlock memory, bool stay_armed,
                                               CameraShot& shot);
  void FetchPulse(const PulseTask& task, Clock::time_point pulse, bool stay_armed,
                  CameraShot& shot);
  void TellWhatCame(const StreamCounters& when_armed, CameraShot& shot) const;
  void CheckFrame(CameraShot& shot);
  void AwaitQuiet(PulseTask& task, Clock::time_point pulse) const;
  void CheckForSecondFrame(uint64_t unasked_before, CameraShot& shot);
  void Diagnose(CameraShot& shot);
  CameraShot EmptyShot() const;
  template <typename Change>
  void UpdateState(const Change& change);

  const Setup setup_;
  std::unique_ptr<FrameMemory> warm_up_memory_;  // of camera_ until it has taken that frame
  std::unique_ptr<Camera> camera_;               // null: not open
  FrameIdCheck ids_;
  ClockTrack clock_;
  Status ptp_;                                        // of the last pulse
  std::optional<Clock::time_point> earlier_trigger_;  // by line or software, since it was opened
  std::future<void> closing_;                         // a lost camera takes seconds to close

  mutable std::mutex mutex_;
  std::condition_variable posted_;
  std::deque<Job> jobs_;
  std::atomic<bool> owes_preview_ = false;
  bool quit_ = false;
  CameraState state_;
  std::thread thread_;
};

}  // namespace rotunda::rig
