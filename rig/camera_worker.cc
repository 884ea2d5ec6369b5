#include "rig/camera_worker.h"

#include <algorithm>
#include <utility>

#include "rig/camera_discovery.h"

namespace rotunda::rig {
namespace {

using std::chrono::milliseconds;

// An idle camera is looked at this often: control, temperature, clock.
constexpr auto kIdleInterval = milliseconds(1000);
// And a lost one is looked for. Its heartbeat (3 s) holds it for whoever had it before.
constexpr auto kReopenInterval = milliseconds(500);

// A camera answers in well under a millisecond; the machine may be busy for much longer. One
// datagram may get lost.
constexpr auto kProbePatience = milliseconds(250);
constexpr int kProbeTries = 3;

/// Why a camera could not be opened, as a verdict on it.
Verdict VerdictOf(const Error& error) {
  switch (error.code) {
    case ErrorCode::kBadInput:
      return Verdict::kWrongCamera;
    case ErrorCode::kNotFound:
      return Verdict::kDisconnected;
    case ErrorCode::kAlreadyExists:
      return Verdict::kControlLost;
    default:
      return Verdict::kCameraError;
  }
}

constexpr char kArmedCheck[] = "the camera";
constexpr char kClockCheck[] = "its clock does not follow the PTP master";

// A clock that has heard its PTP master follows it after some seconds.
constexpr auto kPtpPatience = milliseconds(15000);
constexpr auto kPtpPollInterval = milliseconds(100);

// A trigger by software, and the frame of it.
constexpr auto kTriggerPatience = milliseconds(2000);
constexpr int kTriggerTries = 2;  // some cameras swallow the first one after idling

// Who waits for a frame looks so often whether it is still wanted.
constexpr auto kFetchInterval = milliseconds(50);
// How often is looked whether packets still come.
constexpr auto kQuietLook = milliseconds(10);
// To report what has come, besides the time in which a second frame is looked for.
constexpr auto kGiveUpPatience = milliseconds(500);

// Clocks: no sample better than this is looked for.
constexpr int64_t kGoodClock_ns = 100'000;
constexpr int kClockTries = 4;
// Two quartzes drift apart by at most this part: 50 ppm each.
constexpr double kClockDrift = 1e-4;

}  // namespace

const char* ConditionName(const CameraState& state) {
  switch (state.condition) {
    case CameraCondition::kOpening:
      return "opening";
    case CameraCondition::kReady:
      return "ready";
    case CameraCondition::kLost:
      return VerdictName(state.lost_as);
  }
  return "";
}

std::optional<double> LastFrameAge_s(const CameraState& state) {
  if (!state.last_frame_at) return std::nullopt;
  return std::chrono::duration<double>(Camera::Clock::now() - *state.last_frame_at).count();
}

bool PulseTask::closed() const {
  const std::lock_guard lock(mutex_);
  return closed_;
}

bool PulseTask::given_up() const {
  const std::lock_guard lock(mutex_);
  return given_up_;
}

void PulseTask::ReportArmed() {
  {
    const std::lock_guard lock(mutex_);
    ++armed_;
  }
  report_came_.notify_all();
}

void PulseTask::ReportFetched() {
  {
    const std::lock_guard lock(mutex_);
    ++fetched_;
  }
  all_fetched_.notify_all();
}

void PulseTask::WaitForOthers(Clock::time_point deadline) {
  std::unique_lock lock(mutex_);
  all_fetched_.wait_until(lock, deadline,
                          [&] { return fetched_ >= taking_part_ || given_up_ || closed_; });
}

void PulseTask::ReportPackets(Clock::time_point when) {
  const std::lock_guard lock(mutex_);
  last_packets_ = std::max(last_packets_, when);
}

PulseTask::Clock::time_point PulseTask::last_packets() const {
  const std::lock_guard lock(mutex_);
  return last_packets_;
}

void PulseTask::ReportResult(size_t camera, CameraShot result) {
  {
    const std::lock_guard lock(mutex_);
    if (closed_) return;
    results_[camera] = std::move(result);
    ++reported_;
  }
  report_came_.notify_all();
}

std::optional<PulseTask::Clock::time_point> PulseTask::WaitForPulse() {
  std::unique_lock lock(mutex_);
  pulse_published_.wait(lock, [&] { return pulse_known_; });
  return pulse_;
}

void PulseTask::WaitForArmed(Clock::time_point deadline, std::stop_token stop) {
  std::unique_lock lock(mutex_);
  // Who cannot be armed reports at once.
  report_came_.wait_until(lock, stop, deadline, [&] { return armed_ + reported_ >= taking_part_; });
}

void PulseTask::PublishPulse(std::optional<Clock::time_point> pulse) {
  {
    const std::lock_guard lock(mutex_);
    pulse_ = pulse;
    pulse_known_ = true;
  }
  pulse_published_.notify_all();
}

void PulseTask::Abandon() {
  PublishPulse(std::nullopt);
  const std::lock_guard lock(mutex_);
  closed_ = true;
}

std::vector<std::optional<CameraShot>> PulseTask::TakeResults(Clock::time_point deadline,
                                                              std::stop_token give_up) {
  const auto all_reported = [&] { return reported_ >= taking_part_; };
  std::unique_lock lock(mutex_);
  if (!report_came_.wait_until(lock, give_up, deadline, all_reported) && give_up.stop_requested()) {
    given_up_ = true;
    all_fetched_.notify_all();
    const auto last =
        Clock::now() + milliseconds(timing_.settle_ms) + kFetchInterval + kGiveUpPatience;
    report_came_.wait_until(lock, std::min(last, deadline), all_reported);
  }
  closed_ = true;
  return std::move(results_);
}

void CameraWorker::ClockTrack::Add(const ClockSample& sample, Clock::time_point at) {
  const std::optional<ClockSample> old = At(at);
  if (old && old->uncertainty_ns <= sample.uncertainty_ns) return;
  best_ = sample;
  taken_ = at;
}

std::optional<ClockSample> CameraWorker::ClockTrack::At(Clock::time_point when) const {
  if (!best_) return std::nullopt;
  ClockSample aged = *best_;
  const auto age = std::chrono::duration_cast<std::chrono::nanoseconds>(when - taken_);
  aged.uncertainty_ns += static_cast<int64_t>(kClockDrift * static_cast<double>(age.count()));
  return aged;
}

CameraWorker::CameraWorker(Setup setup) : setup_(std::move(setup)) {
  state_.camera = setup_.place.camera;
  state_.identity.address = setup_.place.address;
  state_.identity.serial = setup_.place.serial;
  thread_ = std::thread([this] { Run(); });
}

CameraWorker::~CameraWorker() {
  {
    const std::lock_guard lock(mutex_);
    quit_ = true;
  }
  posted_.notify_all();
  thread_.join();
}

CameraState CameraWorker::state() const {
  const std::lock_guard lock(mutex_);
  return state_;
}

template <typename Change>
void CameraWorker::UpdateState(const Change& change) {
  const std::lock_guard lock(mutex_);
  change(state_);
}

void CameraWorker::Post(Job job) {
  {
    const std::lock_guard lock(mutex_);
    jobs_.push_back(std::move(job));
  }
  posted_.notify_all();
}

std::optional<CameraWorker::Job> CameraWorker::NextJob(milliseconds patience) {
  std::unique_lock lock(mutex_);
  posted_.wait_for(lock, patience, [&] { return quit_ || !jobs_.empty(); });
  if (jobs_.empty()) return std::nullopt;
  Job job = std::move(jobs_.front());
  jobs_.pop_front();
  return job;
}

void CameraWorker::Run() {
  const auto quits = [this] {
    const std::lock_guard lock(mutex_);
    return quit_ && jobs_.empty();
  };
  TryOpen();
  while (!quits()) {
    if (const auto job = NextJob(camera_ ? kIdleInterval : kReopenInterval)) {
      (*job)();
    } else if (!quits()) {
      Idle();
    }
  }
  camera_.reset();
  if (closing_.valid()) closing_.wait();
}

bool CameraWorker::Answers(int tries) const {
  for (int i = 0; i < tries; ++i) {
    if (ProbeCamera(camera_->identity().address, kProbePatience)) return true;
  }
  return false;
}

void CameraWorker::Idle() {
  if (!camera_) {
    TryOpen();
    return;
  }
  // Aravis would take seconds to find out that nobody answers.
  if (!Answers(kProbeTries)) {
    Lose({Verdict::kDisconnected, kSilent});
    return;
  }
  const Result<CameraHealth> health = camera_->ReadHealth();
  if (!health) {
    Lose(FindOut(health.error()));
    return;
  }
  SampleClock(1);
  UpdateState([&](CameraState& state) {
    state.health = *health;
    state.counters = camera_->counters();
  });
}

CameraWorker::Loss CameraWorker::FindOut(const Error& error) const {
  if (!Answers(kProbeTries)) return {Verdict::kDisconnected, kSilent};
  if (camera_->LostControl()) {
    return {Verdict::kControlLost,
            "it answers, but control was lost: restarted, or taken by another program (" +
                error.ToString() + ")"};
  }
  if (error.context.starts_with(kClockCheck)) return {Verdict::kNoClock, error.ToString()};
  return {Verdict::kCameraError, "it answers, but: " + error.ToString()};
}

void CameraWorker::Lose(const Loss& loss) {
  if (closing_.valid()) closing_.wait();
  auto close = [memory = std::move(warm_up_memory_), camera = std::move(camera_)]() mutable {
    camera.reset();
    memory.reset();
  };
  closing_ = std::async(std::launch::async, std::move(close));
  UpdateState([&](CameraState& state) {
    state.condition = CameraCondition::kLost;
    state.problem = loss.problem;
    state.lost_as = loss.verdict;
    state.health = {};
  });
}

void CameraWorker::TryOpen() {
  const Status opened = OpenAndWarmUp();
  if (opened.ok()) return;
  if (camera_) {
    Lose(FindOut(opened.error()));
    return;
  }
  const Loss loss{VerdictOf(opened.error()), opened.error().ToString()};
  UpdateState([&](CameraState& state) {
    state.condition = CameraCondition::kLost;
    state.problem = loss.problem;
    state.lost_as = loss.verdict;
  });
}

Status CameraWorker::OpenAndWarmUp() {
  ROTUNDA_ASSIGN_OR_RETURN(const CameraPlace place, setup_.locate(setup_.place));
  ROTUNDA_ASSIGN_OR_RETURN(camera_, setup_.open(place));
  ROTUNDA_ASSIGN_OR_RETURN(const AppliedSettings applied, camera_->Apply(setup_.settings));
  if (setup_.settings.ptp) ROTUNDA_RETURN_IF_ERROR(WaitForPtp());
  ids_ = {};
  clock_ = {};
  earlier_trigger_.reset();
  UpdateState([&](CameraState& state) {
    state.identity = camera_->identity();
    state.settings = applied;
  });
  ROTUNDA_RETURN_IF_ERROR(WarmUp());
  ROTUNDA_ASSIGN_OR_RETURN(const CameraHealth health, camera_->ReadHealth());
  if (!setup_.settings.ptp) SampleClock(kClockTries);
  UpdateState([&](CameraState& state) {
    state.condition = CameraCondition::kReady;
    state.problem.clear();
    state.health = health;
    state.counters = camera_->counters();
  });
  return {};
}

bool CameraWorker::QuitsWithin(milliseconds patience) {
  std::unique_lock lock(mutex_);
  return posted_.wait_for(lock, patience, [&] { return quit_; });
}

/// Tells meanwhile what it waits for.
Status CameraWorker::WaitForPtp() {
  const auto deadline = Clock::now() + kPtpPatience;
  Status follows = camera_->CheckPtp();
  while (!follows && Clock::now() < deadline && Answers(kProbeTries)) {
    const Error lacking = follows.error().In(kClockCheck);
    UpdateState([&](CameraState& state) { state.problem = lacking.ToString(); });
    if (QuitsWithin(kPtpPollInterval)) return lacking;
    follows = camera_->CheckPtp();
  }
  return follows ? follows : Status(follows.error().In(kClockCheck));
}

/// Takes a frame that nobody needs: the kernel applies the size of a stream's socket buffer with
/// its first frame, and some cameras lose that.
Status CameraWorker::WarmUp() {
  warm_up_memory_ = std::make_unique<FrameMemory>(1, state().settings.payload_bytes);
  std::vector<FrameBlock> block = warm_up_memory_->Take(1, Clock::now());
  Result<CameraFrame> frame = TakeByNow(std::move(block.front()));
  // Aravis would take seconds to find out when it is told to stop.
  if (!(frame && frame->complete) && !Answers(kProbeTries)) {
    return Error{ErrorCode::kNotFound, kSilent, ""};
  }
  ROTUNDA_RETURN_IF_ERROR(camera_->Disarm());
  if (!frame) return frame.error();
  frame->memory = {};
  warm_up_memory_.reset();
  return {};
}

/// The camera stays armed between tries: some swallow the first trigger whenever they were armed.
Result<CameraFrame> CameraWorker::TakeByNow(FrameBlock memory) {
  ROTUNDA_RETURN_IF_ERROR(camera_->Arm(TriggerBy::kSoftware, std::move(memory)));
  std::optional<CameraFrame> frame;
  int unseen = -1;  // triggers besides that of the frame
  while (!frame && ++unseen < kTriggerTries) {
    ROTUNDA_ASSIGN_OR_RETURN([[maybe_unused]] const bool armed,
                             camera_->WaitArmed(Clock::now() + kTriggerPatience));
    ROTUNDA_RETURN_IF_ERROR(camera_->SoftwareTrigger());
    earlier_trigger_ = Clock::now();
    frame = camera_->Fetch(Clock::now() + kTriggerPatience);
    if (!frame && !Answers(kProbeTries)) return Error{ErrorCode::kNotFound, kSilent, ""};
  }
  if (frame && frame->complete) {
    ids_.Begin(frame->frame_id);
    NoteFrame(*frame);
  } else {
    ids_.Miss();
  }
  for (int i = 0; i < unseen; ++i) ids_.Miss();
  if (frame) return std::move(*frame);
  return Error{ErrorCode::kFailed, "no frame came when it was triggered by software", ""};
}

void CameraWorker::NoteFrame(const CameraFrame& frame) {
  UpdateState([&](CameraState& state) {
    state.last_frame_id = frame.frame_id;
    state.last_frame_at = Clock::now();
  });
}

void CameraWorker::SampleClock(int tries) {
  for (int i = 0; i < tries; ++i) {
    const std::optional<ClockSample> known = clock_.At(Clock::now());
    if (known && known->uncertainty_ns <= kGoodClock_ns) return;
    const Result<ClockSample> sample = camera_->SampleClock();
    if (!sample) return;  // a camera without latch: its skew stays unknown
    clock_.Add(*sample, Clock::now());
  }
}

CameraShot CameraWorker::EmptyShot() const {
  CameraShot shot;
  shot.camera = setup_.place.camera;
  const CameraState now = state();
  shot.settings = now.settings;
  shot.serial = now.identity.serial;
  return shot;
}

void CameraWorker::JoinPulse(std::shared_ptr<PulseTask> task, size_t index, FrameBlock memory,
                             bool stay_armed) {
  auto block = std::make_shared<FrameBlock>(std::move(memory));  // std::function wants copies
  Post([this, task = std::move(task), index, block, stay_armed] {
    if (task->closed()) return;
    CameraShot shot = TakePulse(*task, std::move(*block), stay_armed);
    UpdateState([&](CameraState& state) {
      state.last_verdict = VerdictName(shot.verdict);
      if (camera_) state.counters = camera_->counters();
    });
    const Loss loss{shot.verdict, shot.reason};
    const bool lost = loss.verdict == Verdict::kDisconnected ||
                      loss.verdict == Verdict::kControlLost ||
                      loss.verdict == Verdict::kCameraError;
    task->ReportResult(index, std::move(shot));
    if (lost && camera_) Lose(loss);
  });
}

void CameraWorker::EndShot() {
  Post([this] {
    if (!camera_) return;
    if (const Status status = camera_->Disarm(); !status) Lose(FindOut(status.error()));
  });
}

std::future<Result<CameraFrame>> CameraWorker::Preview(FrameBlock memory) {
  auto block = std::make_shared<FrameBlock>(std::move(memory));
  auto promise = std::make_shared<std::promise<Result<CameraFrame>>>();
  std::future<Result<CameraFrame>> future = promise->get_future();
  if (owes_preview_.exchange(true)) {
    promise->set_value(Error{ErrorCode::kFailed, kSilent, setup_.place.camera});
    return future;
  }
  Post([this, block, promise] {
    if (!camera_) {
      owes_preview_ = false;
      promise->set_value(Error{ErrorCode::kFailed, state().problem, setup_.place.camera});
      return;
    }
    Result<CameraFrame> frame = TakeByNow(std::move(*block));
    const Status disarmed = camera_->Disarm();
    if (frame && !frame->complete) frame = Error{ErrorCode::kFailed, frame->problem, ""};
    owes_preview_ = false;
    promise->set_value(frame ? std::move(frame) : frame.error().In(setup_.place.camera));
    if (!disarmed) Lose(FindOut(disarmed.error()));
  });
  return future;
}

Result<CameraWorker::Clock::time_point> CameraWorker::PrepareForPulse(const PulseTask& task,
                                                                      FrameBlock memory,
                                                                      bool stay_armed) {
  // What an earlier pulse has brought since its deadline is not the next one's.
  while (const auto late = stay_armed ? camera_->Fetch(Clock::now()) : std::nullopt) {
    if (late->complete) ids_.Accept(late->frame_id);
  }
  ROTUNDA_RETURN_IF_ERROR(stay_armed ? camera_->Refill(std::move(memory))
                                     : camera_->Arm(TriggerBy::kLine, std::move(memory)));
  ROTUNDA_ASSIGN_OR_RETURN(const bool armed, camera_->WaitArmed(task.arm_deadline()));
  if (!armed) {
    return Error{ErrorCode::kFailed, "does not say that it waits for a trigger", kArmedCheck};
  }
  const auto armed_at = Clock::now();
  if (setup_.settings.ptp) {
    ptp_ = camera_->CheckPtp();
    clock_ = {};  // it may have been set since the last sample
    SampleClock(1);
  } else {
    SampleClock(kClockTries);
  }
  return armed_at;
}

CameraShot CameraWorker::TakePulse(PulseTask& task, FrameBlock memory, bool stay_armed) {
  CameraShot shot = EmptyShot();
  const StreamCounters before = camera_ ? camera_->counters() : StreamCounters{};
  const std::optional<Clock::time_point> pulse =
      ArmAndFetch(task, std::move(memory), stay_armed, shot);
  task.ReportFetched();
  if (!pulse) return shot;
  if (shot.frame) {
    AwaitQuiet(task, *pulse);
    CheckForSecondFrame(before.frames_without_memory, shot);
  }
  shot.resent_packets = camera_->counters().resent_packets - before.resent_packets;
  if (!shot.frame && shot.verdict != Verdict::kInterrupted) Diagnose(shot);
  return shot;
}

std::optional<CameraWorker::Clock::time_point> CameraWorker::ArmAndFetch(PulseTask& task,
                                                                         FrameBlock memory,
                                                                         bool stay_armed,
                                                                         CameraShot& shot) {
  const auto failed = [&shot](const Loss& loss) {
    shot.verdict = loss.verdict;
    shot.reason = loss.problem;
    return std::nullopt;
  };
  if (!camera_) {
    const CameraState now = state();
    return failed({now.lost_as, now.problem});
  }
  if (!Answers(kProbeTries)) return failed({Verdict::kDisconnected, kSilent});
  const Result<Clock::time_point> armed = PrepareForPulse(task, std::move(memory), stay_armed);
  if (!armed && armed.error().context == kArmedCheck) {
    return failed({Verdict::kNotArmed, armed.error().message});
  }
  if (!armed) return failed(FindOut(armed.error()));
  const StreamCounters when_armed = camera_->counters();
  task.ReportArmed();
  const std::optional<Clock::time_point> pulse = task.WaitForPulse();
  if (!pulse) return failed({shot.verdict, "there was no pulse"});
  FetchPulse(task, *pulse, stay_armed, shot);
  if (shot.verdict == Verdict::kMissing) TellWhatCame(when_armed, shot);
  if (shot.verdict == Verdict::kMissing && *armed > *pulse) {
    shot.verdict = Verdict::kArmedLate;
    shot.reason =
        "it waited for a trigger only " +
        std::to_string(std::chrono::duration_cast<milliseconds>(*armed - *pulse).count()) +
        " ms after the pulse (slow to answer? capture.arm_ms?)";
  }
  return pulse;
}

/// By the camera's own clock: also a warm-up frame may come seconds late, and must not be taken for
/// that of the pulse.
bool CameraWorker::IsOfEarlierTrigger(const CameraFrame& frame, Clock::time_point pulse) const {
  const std::optional<ClockSample> clock = clock_.At(Clock::now());
  if (!frame.complete || !clock || !earlier_trigger_) return false;
  const std::chrono::nanoseconds at_the_latest(static_cast<int64_t>(frame.timestamp_ns) +
                                               clock->host_minus_camera_ns + clock->uncertainty_ns);
  return at_the_latest < (*earlier_trigger_ + (pulse - *earlier_trigger_) / 2).time_since_epoch();
}

std::optional<CameraFrame> CameraWorker::FetchUnlessGivenUp(const PulseTask& task,
                                                            Clock::time_point deadline) const {
  while (true) {
    const auto next_look = std::min(deadline, Clock::now() + kFetchInterval);
    std::optional<CameraFrame> frame = camera_->Fetch(next_look);
    if (frame || next_look == deadline || task.given_up()) return frame;
  }
}

std::optional<CameraFrame> CameraWorker::FetchOwnFrame(const PulseTask& task,
                                                       Clock::time_point pulse, bool stay_armed) {
  const auto deadline = pulse + milliseconds(task.timing().deadline_ms + task.timing().late_ms);
  std::optional<CameraFrame> frame = FetchUnlessGivenUp(task, deadline);
  while (frame && IsOfEarlierTrigger(*frame, pulse)) {
    ids_.Accept(frame->frame_id);
    const Status waits = stay_armed ? camera_->Refill(std::move(frame->memory))
                                    : camera_->StartOver(std::move(frame->memory));
    if (!waits) return std::nullopt;
    frame = FetchUnlessGivenUp(task, deadline);
  }
  earlier_trigger_ = pulse;
  return frame;
}

void CameraWorker::FetchPulse(const PulseTask& task, Clock::time_point pulse, bool stay_armed,
                              CameraShot& shot) {
  const ShotTiming& timing = task.timing();
  std::optional<CameraFrame> frame = FetchOwnFrame(task, pulse, stay_armed);
  const auto now = Clock::now();
  if (!frame) {
    ids_.Miss();
    const bool given_up = task.given_up();
    shot.verdict = given_up ? Verdict::kInterrupted : Verdict::kMissing;
    shot.reason = given_up ? kGivenUp : "armed and answering, but no frame came: trigger cable?";
    return;
  }
  if (!frame->complete) {
    ids_.Miss();
    shot.verdict = Verdict::kIncomplete;
    shot.reason = frame->problem;
    return;
  }
  NoteFrame(*frame);
  shot.frame = std::move(frame);
  shot.arrival_ms = std::chrono::duration<double, std::milli>(now - pulse).count();
  shot.verdict = Verdict::kOk;
  CheckFrame(shot);
  if (*shot.arrival_ms > timing.deadline_ms && shot.verdict == Verdict::kOk) {
    shot.verdict = Verdict::kLate;
    shot.reason = "came " + std::to_string(static_cast<int>(*shot.arrival_ms)) +
                  " ms after the pulse, allowed are " + std::to_string(timing.deadline_ms);
  }
}

/// Of a camera without a frame: when packets came, it has seen the pulse.
void CameraWorker::TellWhatCame(const StreamCounters& when_armed, CameraShot& shot) const {
  const StreamCounters now = camera_->counters();
  const uint64_t came = now.received_packets - when_armed.received_packets;
  if (came == 0) return;
  if (came == now.ignored_packets - when_armed.ignored_packets) {
    shot.verdict = Verdict::kWrongId;
    shot.reason = "packets came, but with the number of an earlier frame";
    return;
  }
  shot.verdict = Verdict::kIncomplete;
  shot.reason = "only " + std::to_string(came) + (came == 1 ? " packet" : " packets") +
                " had come by the deadline";
}

void CameraWorker::CheckFrame(CameraShot& shot) {
  const CameraFrame& frame = *shot.frame;
  if (setup_.settings.ptp && !ptp_) {
    shot.verdict = Verdict::kNoClock;
    shot.reason = "when it exposed is not known: " + ptp_.error().ToString();
  } else if (setup_.settings.ptp) {
    shot.exposed_ns = static_cast<int64_t>(frame.timestamp_ns);
  } else if (const std::optional<ClockSample> clock = clock_.At(Clock::now())) {
    shot.exposed_ns = static_cast<int64_t>(frame.timestamp_ns) + clock->host_minus_camera_ns;
    shot.clock_uncertainty_us = 1e-3 * static_cast<double>(clock->uncertainty_ns);
  }
  const AppliedSettings& wanted = shot.settings;
  if (frame.width_px != wanted.width_px || frame.height_px != wanted.height_px ||
      frame.pixel_format != wanted.pixel_format) {
    shot.verdict = Verdict::kWrongPicture;
    shot.reason = "sent " + std::to_string(frame.width_px) + "x" + std::to_string(frame.height_px) +
                  " " + frame.pixel_format + ", expected " + std::to_string(wanted.width_px) + "x" +
                  std::to_string(wanted.height_px) + " " + wanted.pixel_format;
  }
  const uint64_t last = ids_.last();
  if (!ids_.Accept(frame.frame_id)) {
    ids_.Miss();
    shot.verdict = Verdict::kWrongId;
    shot.reason = "its frame has number " + std::to_string(frame.frame_id) +
                  ", expected 1 or the one after " + std::to_string(last);
  }
}

/// Until no camera has got packets for settle_ms since the last one's frame: what a second pulse
/// brings of ninety cameras comes one behind the other, and ends later than a camera's own.
void CameraWorker::AwaitQuiet(PulseTask& task, Clock::time_point pulse) const {
  const ShotTiming& timing = task.timing();
  const milliseconds settle(timing.settle_ms);
  const auto deadline = pulse + milliseconds(timing.deadline_ms + timing.late_ms);
  task.WaitForOthers(deadline);
  const auto begin = Clock::now();
  uint64_t packets = camera_->counters().received_packets;
  auto quiet_at = begin + settle;
  while (Clock::now() < quiet_at) {
    std::this_thread::sleep_for(std::min(kQuietLook, settle));
    const uint64_t now = camera_->counters().received_packets;
    if (now > packets) task.ReportPackets(Clock::now());
    packets = now;
    if (task.given_up()) continue;
    quiet_at = std::min(std::max(begin, task.last_packets()), deadline) + settle;
  }
}

void CameraWorker::CheckForSecondFrame(uint64_t unasked_before, CameraShot& shot) {
  // Memory that an earlier pulse left unfilled takes it in.
  const bool came = camera_->Fetch(Clock::now()).has_value();
  if (!came && camera_->counters().frames_without_memory == unasked_before) return;
  ids_.Miss();
  if (shot.verdict != Verdict::kOk) return;
  shot.verdict = Verdict::kSecondFrame;
  shot.reason = "it sent another frame: a second pulse on its trigger input (cable, interference)?";
}

void CameraWorker::Diagnose(CameraShot& shot) {
  const auto blame = [&](const Loss& loss) {
    shot.reason = (shot.verdict == Verdict::kIncomplete ? shot.reason + "; " : "") + loss.problem;
    shot.verdict = loss.verdict;
  };
  if (!Answers(kProbeTries)) {
    blame({Verdict::kDisconnected, kSilent});
    return;
  }
  if (const Result<CameraHealth> health = camera_->ReadHealth(); !health) {
    blame(FindOut(health.error()));
  }
}

}  // namespace rotunda::rig
