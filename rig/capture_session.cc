#include "rig/capture_session.h"

#include <algorithm>
#include <future>
#include <optional>
#include <thread>

#include "rig/camera_discovery.h"
#include "sfm/core/bytes_text.h"

namespace rotunda::rig {
namespace {

using Clock = Camera::Clock;
using std::chrono::milliseconds;

constexpr char kStillOpening[] = "it was still being opened";

constexpr auto kReadyPollInterval = milliseconds(10);
constexpr auto kTurnPollInterval = milliseconds(10);
// A picture of pure noise grows by a thousandth when it is coded; the rest is for the other files.
constexpr size_t kCodingReserve = 50;
// How long a shot waits for the disk before it says that memory is full.
constexpr auto kMemoryPatience = milliseconds(3000);
// For a frame by software trigger: a camera is given twice 2 s to get ready and 2 s to send.
constexpr auto kPreviewTime = milliseconds(8000);
// After the deadlines: settling, and finding out why a camera is silent (three probes).
constexpr auto kDiagnosisPatience = milliseconds(1500);
// One broadcast serves all cameras that are looked for at the same time.
constexpr auto kDiscoveryPatience = milliseconds(500);
constexpr auto kDiscoveryAge = milliseconds(3000);

/// Simulated cameras on this machine wait for who receives: small buffers do no harm there.
Status CheckBuffers(const CaptureOptions& options, size_t payload_bytes) {
  const bool on_loopback =
      std::all_of(options.cameras.begin(), options.cameras.end(),
                  [](const CameraPlace& camera) { return camera.address.starts_with("127."); });
  return on_loopback ? Status() : CheckSocketBuffers(payload_bytes);
}

Error Stopped() { return {ErrorCode::kCancelled, "stopped before the pulse", ""}; }

/// The summaries of pulses, one after the other; "the same" for one like that of the shot.
std::string TellOthers(const std::vector<std::string>& summaries, const std::string& of_shot) {
  std::string text;
  for (const std::string& each : summaries) {
    text += (text.empty() ? "" : "; then ") + (each == of_shot ? "the same" : each);
  }
  return text;
}

/// What becomes of a camera that has not told.
CameraShot SilentShot(const CameraState& state, bool given_up) {
  CameraShot silent;
  silent.camera = state.camera;
  silent.serial = state.identity.serial;
  silent.settings = state.settings;
  switch (state.condition) {
    case CameraCondition::kOpening:
      silent.verdict = Verdict::kNotArmed;
      silent.reason = kStillOpening + (state.problem.empty() ? "" : ": " + state.problem);
      break;
    case CameraCondition::kReady:
      silent.verdict = given_up ? Verdict::kInterrupted : Verdict::kDisconnected;
      silent.reason = given_up ? kGivenUp : kSilent;
      break;
    case CameraCondition::kLost:
      silent.verdict = state.lost_as;
      silent.reason = state.problem;
  }
  return silent;
}

/// Waits for the end of another shot or a preview; not locked when it is stopped.
std::unique_lock<std::mutex> WaitForTurn(std::mutex& one_shot, const std::stop_token& stop) {
  std::unique_lock turn(one_shot, std::try_to_lock);
  while (!turn && !stop.stop_requested()) {
    std::this_thread::sleep_for(kTurnPollInterval);
    static_cast<void>(turn.try_lock());
  }
  return turn;
}

/// Counts while it lives.
class Wanted {
 public:
  explicit Wanted(std::atomic<int>& count) : count_(count) { ++count_; }
  ~Wanted() { --count_; }
  Wanted(const Wanted&) = delete;
  Wanted& operator=(const Wanted&) = delete;

 private:
  std::atomic<int>& count_;
};

}  // namespace

class CaptureSession::Locator {
 public:
  explicit Locator(std::vector<CameraPlace> cameras) : cameras_(std::move(cameras)) {}

  Result<CameraPlace> Locate(const CameraPlace& place) {
    if (!place.address.empty()) return place;
    ROTUNDA_ASSIGN_OR_RETURN(const CameraMatch match, Match(place));
    if (match.problems.empty()) return match.places.front();
    return Error{match.problems.front().code, match.problems.front().message, ""};
  }

  /// The same error, with the name of the camera whose serial was found instead, or where the
  /// place's serial was found, and without the address that is known to be the place's.
  Error Explain(const CameraPlace& place, Error error) {
    for (const CameraPlace& other : cameras_) {
      if (error.code == ErrorCode::kBadInput && !other.serial.empty() &&
          other.camera != place.camera && error.message.ends_with("found " + other.serial)) {
        error.message += " (which belongs to " + other.camera + ": cables swapped?)";
      }
    }
    if (error.context == place.address) error.context.clear();
    if (error.code != ErrorCode::kNotFound || !IsConfigured(place.address)) return error;
    const Result<CameraMatch> match = Match(place);
    const bool is_elsewhere =
        match && !match->problems.empty() && match->problems.front().code == ErrorCode::kBadInput;
    if (is_elsewhere) error.message = match->problems.front().message;
    return error;
  }

 private:
  /// Else it was found.
  bool IsConfigured(const std::string& address) const {
    return std::any_of(cameras_.begin(), cameras_.end(),
                       [&](const CameraPlace& place) { return place.address == address; });
  }

  Result<CameraMatch> Match(const CameraPlace& place) {
    const std::lock_guard lock(mutex_);
    // That nobody was there is an answer too.
    if (!asked_ || Clock::now() > *asked_ + kDiscoveryAge) {
      ROTUNDA_ASSIGN_OR_RETURN(found_, DiscoverCameras(kDiscoveryPatience));
      asked_ = Clock::now();
    }
    return MatchCameras({place}, found_);
  }

  const std::vector<CameraPlace> cameras_;
  std::mutex mutex_;
  std::vector<CameraIdentity> found_;
  std::optional<Clock::time_point> asked_;
};

CaptureSession::CaptureSession(CaptureOptions options, Devices devices)
    : options_(std::move(options)),
      devices_(std::move(devices)),
      locator_(std::make_unique<Locator>(options_.cameras)),
      memory_(options_.cameras.size() * options_.sets_in_memory, options_.settings.PayloadBytes()) {
  for (const CameraPlace& place : options_.cameras) {
    const auto open = [this](const CameraPlace& at) -> Result<std::unique_ptr<Camera>> {
      Result<std::unique_ptr<Camera>> camera = devices_.open(at);
      return camera ? std::move(camera) : locator_->Explain(at, camera.error());
    };
    const auto locate = [this](const CameraPlace& at) { return locator_->Locate(at); };
    workers_.push_back(std::make_unique<CameraWorker>(
        CameraWorker::Setup{place, options_.SettingsOf(place), open, locate}));
  }
}

Result<std::unique_ptr<CaptureSession>> CaptureSession::Open(CaptureOptions options,
                                                             Devices devices) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  ROTUNDA_RETURN_IF_ERROR(CheckBuffers(options, options.settings.PayloadBytes()));
  std::sort(options.cameras.begin(), options.cameras.end(),
            [](const CameraPlace& a, const CameraPlace& b) { return a.camera < b.camera; });
  return std::unique_ptr<CaptureSession>(
      new CaptureSession(std::move(options), std::move(devices)));
}

CaptureSession::~CaptureSession() {
  // All at once: closing a camera that is gone takes seconds.
  std::vector<std::thread> closing;
  for (std::unique_ptr<CameraWorker>& worker : workers_) {
    closing.emplace_back([&worker] { worker.reset(); });
  }
  for (std::thread& each : closing) each.join();
}

std::vector<CameraState> CaptureSession::States() const {
  std::vector<CameraState> states;
  for (const auto& worker : workers_) states.push_back(worker->state());
  return states;
}

std::vector<CameraWorker*> CaptureSession::ReadyWorkers() const {
  std::vector<CameraWorker*> ready;
  for (const auto& worker : workers_) {
    if (worker->state().condition == CameraCondition::kReady) ready.push_back(worker.get());
  }
  return ready;
}

size_t CaptureSession::WaitUntilReady(milliseconds patience, std::stop_token stop) {
  const auto deadline = Clock::now() + patience;
  size_t ready = ReadyWorkers().size();
  while (ready < workers_.size() && Clock::now() < deadline && !stop.stop_requested()) {
    std::this_thread::sleep_for(kReadyPollInterval);
    ready = ReadyWorkers().size();
  }
  return ready;
}

Status CaptureSession::FitMemory() {
  for (const CameraState& state : States()) memory_.Grow(state.settings.payload_bytes);
  return CheckBuffers(options_, memory_.block_bytes());
}

size_t CaptureSession::ShotLimit_bytes() const {
  size_t sum = 0;
  for (const CameraState& state : States()) sum += state.settings.payload_bytes;
  return sum + sum / kCodingReserve;
}

Result<Shot> CaptureSession::TakePulse(bool stay_armed, std::stop_token stop,
                                       std::stop_token give_up) {
  const std::vector<CameraWorker*> ready = ReadyWorkers();
  ROTUNDA_RETURN_IF_ERROR(FitMemory());  // now that it is known who takes part
  std::vector<FrameBlock> blocks = memory_.Take(ready.size(), Clock::now() + kMemoryPatience, stop);
  if (stop.stop_requested()) return Stopped();
  if (blocks.size() < ready.size()) {
    return Error{ErrorCode::kFailed,
                 "memory is full: " + BytesText(memory_.lent() * memory_.block_bytes()) +
                     " of frames wait for the disk, and capture.sets_in_memory allows no more; "
                     "nothing is lost, try again when they are written",
                 "frames"};
  }
  const ShotTiming& timing = options_.timing;
  const auto arm_deadline = Clock::now() + milliseconds(timing.arm_ms);
  const auto task =
      std::make_shared<PulseTask>(workers_.size(), ready.size(), timing, arm_deadline);
  size_t next = 0;
  for (size_t i = 0; i < workers_.size(); ++i) {
    if (next >= ready.size() || workers_[i].get() != ready[next]) continue;
    workers_[i]->JoinPulse(task, i, std::move(blocks[next++]), stay_armed);
  }
  task->WaitForArmed(arm_deadline, stop);
  if (stop.stop_requested()) {
    task->Abandon();
    return Stopped();
  }
  const Result<Clock::time_point> pulse =
      devices_.trigger->Pulse(std::chrono::microseconds(options_.trigger.pulse_us));
  task->PublishPulse(pulse ? std::optional(*pulse) : std::nullopt);
  const auto deadline = Clock::now() +
                        milliseconds(timing.deadline_ms + timing.late_ms + timing.settle_ms) +
                        kDiagnosisPatience;
  std::vector<std::optional<CameraShot>> results = task->TakeResults(deadline, give_up);
  if (!pulse) return pulse.error().In("trigger");
  Shot shot;
  for (size_t i = 0; i < workers_.size(); ++i) {
    shot.cameras.push_back(results[i] ? std::move(*results[i])
                                      : SilentShot(workers_[i]->state(), task->given_up()));
  }
  if (task->given_up() && std::none_of(shot.cameras.begin(), shot.cameras.end(),
                                       [](const CameraShot& each) { return !!each.frame; })) {
    return Error{ErrorCode::kCancelled, "given up before a frame came", ""};
  }
  shot.interrupted =
      std::any_of(shot.cameras.begin(), shot.cameras.end(),
                  [](const CameraShot& each) { return each.verdict == Verdict::kInterrupted; });
  JudgeSkew(options_.skew_limit_us, shot);
  return shot;
}

Result<Shot> CaptureSession::Capture(std::stop_token stop, std::stop_token give_up) {
  const Wanted wanted(shots_wanted_);
  const std::unique_lock turn = WaitForTurn(one_shot_, stop);
  if (!turn) return Stopped();
  if (!devices_.trigger) return Error{ErrorCode::kInvalidArgument, "there is none", "trigger"};
  if (ReadyWorkers().empty()) {
    const std::string problem = workers_.front()->state().problem;
    return Error{ErrorCode::kFailed,
                 "none of " + std::to_string(workers_.size()) +
                     " is ready; the first says: " + (problem.empty() ? kStillOpening : problem),
                 "cameras"};
  }
  Result<Shot> best = TakePulse(false, stop, give_up);
  std::vector<std::string> others;  // what was wrong with them
  for (int i = 0; best && i < options_.retries && !best->complete(); ++i) {
    Result<Shot> next = TakePulse(true, stop, give_up);
    if (!next) {  // what there is is kept
      best->interrupted = next.error().code == ErrorCode::kCancelled;
      break;
    }
    const bool interrupted = next->interrupted;
    if (next->OkCount() < best->OkCount()) std::swap(*next, *best);
    others.push_back(best->Summary());
    best = std::move(next);
    best->interrupted = interrupted;
    best->pulses = i + 2;
  }
  for (const auto& worker : workers_) worker->EndShot();
  if (best) best->first_try = TellOthers(others, best->Summary());
  return best;
}

Result<CameraFrame> CaptureSession::Preview(const std::string& camera) {
  const std::unique_lock lock(one_shot_, std::try_to_lock);
  if (!lock || shots_wanted_ > 0) {
    return Error{ErrorCode::kFailed,
                 "the cameras are busy with a shot or another preview; try again", camera};
  }
  ROTUNDA_RETURN_IF_ERROR(FitMemory());
  for (const auto& worker : workers_) {
    if (worker->place().camera != camera) continue;
    std::vector<FrameBlock> block = memory_.Take(1, Clock::now());
    if (block.empty()) return Error{ErrorCode::kFailed, "frames wait for the disk", "memory"};
    std::future<Result<CameraFrame>> frame = worker->Preview(std::move(block.front()));
    // A camera that hangs must not keep the others from their shots.
    if (frame.wait_for(kPreviewTime) == std::future_status::ready) return frame.get();
    return Error{ErrorCode::kFailed, kSilent, camera};
  }
  return Error{ErrorCode::kNotFound, "no camera has this name", camera};
}

}  // namespace rotunda::rig
