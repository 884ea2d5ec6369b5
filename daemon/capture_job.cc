#include "daemon/capture_job.h"

#include <algorithm>
#include <charconv>
#include <condition_variable>
#include <functional>
#include <map>
#include <mutex>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stop_token>
#include <string_view>
#include <system_error>
#include <thread>
#include <utility>

#include "daemon/job_request.h"
#include "daemon/reconstruction_request.h"
#include "daemon/retention.h"
#include "daemon/store_calibrations.h"
#include "daemon/store_captures.h"
#include "rig/aravis_camera.h"
#include "rig/gpiod_trigger_line.h"
#include "rig/sim/socket_trigger.h"
#include "sfm/core/plain_text.h"

namespace rotunda::daemon {
namespace {

using Json = nlohmann::ordered_json;
using std::chrono::milliseconds;

constexpr auto kPollInterval = milliseconds(50);
constexpr auto kMendInterval = milliseconds(1000);
// After a stop: frames of a pulse that was given are on their way, those of a camera that is gone
// would be waited for longer.
constexpr auto kFramesPatience = milliseconds(1000);
constexpr int kPreviewQuality = 85;
constexpr size_t kMaxSubjectLength = 200;

/// The number N of a camera's input "LineN".
Result<int> LineOf(const std::string& camera_input) {
  constexpr std::string_view kLine = "Line";
  int line = 0;
  if (camera_input.starts_with(kLine)) {
    const char* end = camera_input.data() + camera_input.size();
    const auto [stopped, error] = std::from_chars(camera_input.data() + kLine.size(), end, line);
    if (error == std::errc() && stopped == end && line >= 0) return line;
  }
  return Error{ErrorCode::kBadInput,
               "is \"" + camera_input + "\", expected Line0 or Line1, which simulated cameras have",
               "trigger.camera_input"};
}

struct CaptureRequest {
  std::optional<std::string> subject;
  bool reconstruct = true;
  sfm::RunChoices choices;  // of the reconstruction: preset and prior
};

void ReadChoices(const JsonField& root, CaptureRequest& request) {
  sfm::RunChoices& choices = request.choices;
  for (const char* key : {sfm::kPresetOption, sfm::kPriorOption}) {
    if (request.reconstruct || !root[key].present()) continue;
    root[key].Fail("has no effect on a capture that is not reconstructed");
  }
  choices.preset = ReadChoice(root[sfm::kPresetOption], RequestPresets(), choices.preset);
  choices.calibration_prior =
      ReadChoice(root[sfm::kPriorOption], sfm::PriorsByName(), choices.calibration_prior);
}

/// Also of a body that was stored before today's rules for subjects, and whose shot is to be kept.
Result<CaptureRequest> ParseCaptureRequest(const std::string& body) {
  CaptureRequest request;
  const std::vector<std::string> keys = {"subject", "reconstruct", sfm::kPresetOption,
                                         sfm::kPriorOption};
  ROTUNDA_RETURN_IF_ERROR(ReadRequest(body, keys, [&](const JsonField& root) {
    if (root["reconstruct"].present()) request.reconstruct = root["reconstruct"].Bool();
    ReadChoices(root, request);
    if (root["subject"].present()) request.subject = root["subject"].String();
  }));
  return request;
}

std::string ToBody(const CaptureRequest& request) {
  Json body = Json::object();
  if (request.subject) body["subject"] = *request.subject;
  body["reconstruct"] = request.reconstruct;
  if (!request.reconstruct) return body.dump();
  body[sfm::kPresetOption] = NameIn(RequestPresets(), request.choices.preset);
  body[sfm::kPriorOption] = NameIn(sfm::PriorsByName(), request.choices.calibration_prior);
  return body.dump();
}

/// Whether what a checked request refers to is there.
Status CheckReferences(Store& store, const CaptureRequest& request) {
  if (!request.choices.calibration_prior) return {};
  ROTUNDA_ASSIGN_OR_RETURN(const std::optional<CalibrationRecord> active, ActiveCalibration(store));
  if (active) return {};
  return Error{ErrorCode::kInvalidArgument, "needs a calibration, and none is in force",
               sfm::kPriorOption};
}

/// Whether a prior was asked for that the set, which is written, has no calibration for.
bool LacksItsPrior(const Store& store, const CaptureRequest& request, const std::string& capture) {
  std::error_code ignored;
  return request.choices.calibration_prior &&
         !std::filesystem::exists(store.CaptureFolder(capture) / "calibration.json", ignored);
}

/// Of a set that is written. Without the prior where it would fail for that.
std::optional<NewJob> FollowUp(const Store& store, const CaptureRequest& request,
                               const std::string& capture) {
  if (!request.reconstruct) return std::nullopt;
  sfm::RunChoices choices = request.choices;
  if (LacksItsPrior(store, request, capture)) choices.calibration_prior = false;
  return NewJob{JobKind::kReconstruction, ReconstructionBody(capture, choices), ""};
}

/// Waits until all cameras are ready or patience is over.
void WaitForCameras(rig::CaptureSession& session, milliseconds patience, JobContext& context) {
  const size_t all = session.options().cameras.size();
  const auto deadline = std::chrono::steady_clock::now() + patience;
  size_t ready = 0;
  while (ready < all && std::chrono::steady_clock::now() < deadline &&
         !context.stop.stop_requested()) {
    ready = session.WaitUntilReady(kPollInterval, context.stop);
    context.progress("cameras", ready, all);
  }
}

/// Waits for the disk. A set that cannot be written stays in memory until it can, or `patience` is
/// over. What the writer has set aside is tried again too: `out` is the store's own folder, and
/// somebody may mend it. Tells of progress only when the writer shows some: one that hangs is a
/// case for the watchdog.
Result<rig::WrittenSet> WaitForDisk(rig::FrameSetWriter& writer, rig::FrameSetWriter::Ticket ticket,
                                    const std::filesystem::path& out, const DiskPatience& patience,
                                    JobContext& context) {
  std::stop_source at_once;
  at_once.request_stop();
  std::optional<uint64_t> told;
  while (true) {
    Result<rig::WrittenSet> written = writer.Wait(ticket, at_once.get_token());
    if (written) return written;
    const bool set_aside = written.error().code != ErrorCode::kCancelled;
    const uint64_t signs = writer.signs_of_life();  // before the trouble, which changes first
    const auto trouble = writer.trouble();
    const bool in_trouble = set_aside || (trouble && trouble->out == out);
    if (in_trouble && !patience(set_aside ? written.error() : trouble->error)) break;
    if (told != signs) context.progress(trouble ? kWaitingForDisk : "writing", 0, 1);
    told = signs;
    std::this_thread::sleep_for(set_aside ? kMendInterval : kPollInterval);
    if (set_aside) ROTUNDA_RETURN_IF_ERROR(writer.Redirect(ticket, out));
  }
  writer.Abandon(ticket);
  return writer.Wait(ticket);
}

/// A token that is set a while after another.
class LaterStop {
 public:
  LaterStop(std::stop_token stop, milliseconds delay)
      : wake_when_stopped_(stop, [this] { Wake(); }), thread_([this, stop, delay](auto over) {
          std::unique_lock lock(mutex_);
          const bool is_stopped = wake_.wait(lock, over, [&] { return stop.stop_requested(); });
          if (!is_stopped) return;
          wake_.wait_for(lock, over, delay, [] { return false; });
          later_.request_stop();
        }) {}

  std::stop_token token() const { return later_.get_token(); }

 private:
  void Wake() {
    const std::lock_guard lock(mutex_);
    wake_.notify_all();
  }

  std::mutex mutex_;
  std::condition_variable_any wake_;
  std::stop_source later_;
  std::stop_callback<std::function<void()>> wake_when_stopped_;
  std::jthread thread_;
};

/// Colours as they are seen; `frame` is complete.
cv::Mat Demosaiced(const rig::CameraFrame& frame) {
  const int channels = frame.pixel_format == "RGB8" ? 3 : 1;
  auto* pixels = const_cast<uint8_t*>(frame.memory.data());
  const cv::Mat raw(frame.height_px, frame.width_px, CV_8UC(channels), pixels);
  const std::map<std::string, int> conversions = {{"RGB8", cv::COLOR_RGB2BGR},
                                                  {"BayerRG8", cv::COLOR_BayerRGGB2BGR},
                                                  {"BayerGB8", cv::COLOR_BayerGBRG2BGR},
                                                  {"BayerGR8", cv::COLOR_BayerGRBG2BGR},
                                                  {"BayerBG8", cv::COLOR_BayerBGGR2BGR}};
  const auto conversion = conversions.find(frame.pixel_format);
  if (conversion == conversions.end()) return raw;
  cv::Mat picture;
  cv::cvtColor(raw, picture, conversion->second);
  return picture;
}

Result<std::string> ToJpeg(const rig::CameraFrame& frame) {
  try {
    std::vector<uint8_t> bytes;
    cv::imencode(".jpg", Demosaiced(frame), bytes, {cv::IMWRITE_JPEG_QUALITY, kPreviewQuality});
    return std::string(bytes.begin(), bytes.end());
  } catch (const cv::Exception& error) {
    return Error{ErrorCode::kFailed, error.what(), "preview"};
  }
}

Json ResultOf(const CaptureRecord& capture, const std::optional<rig::Shot>& shot,
              const std::vector<std::string>& notes) {
  Json result = {{"capture", capture.id},
                 {"ok", capture.ok_frames},
                 {"of", capture.frames},
                 {"complete", capture.ok_frames == capture.frames}};
  if (!notes.empty()) result["notes"] = notes;
  if (!shot) return result;  // taken before the daemon was interrupted
  result["summary"] = shot->Summary();
  result["pulses"] = shot->pulses;
  if (shot->skew.known()) {
    result["median_skew_us"] = shot->skew.median_us;
    result["max_skew_us"] = shot->skew.max_us;
    result["max_skew_camera"] = shot->skew.worst;
  }
  result["resent_packets"] = shot->ResentPackets();
  return result;
}

/// A shot that is taken and that the disk refuses: tells of it once, refuses to be cancelled for
/// the reason of the time, and waits until the daemon has been ending for as long as it may.
class ShotWait {
 public:
  ShotWait(Store& store, const CaptureJobOptions& options, const std::string& id,
           JobContext& context)
      : store_(store), options_(options), id_(id), context_(context) {}

  /// While the disk refuses it for this reason: whether to wait on.
  bool GoesOn(const Error& why) {
    why_ = why;
    const Error waits{ErrorCode::kIo,
                      std::string(kShotWaits) + " (" + why.ToString() + "): make room there",
                      "shot " + id_};
    context_.refuse_cancel(waits.ToString() + "; it is not given up");
    if (!since_) Begin(waits);
    const auto ending = context_.ending();
    given_up_ = ending && *ending >= options_.end_patience;
    return !given_up_;
  }
  bool given_up() const { return given_up_; }

  /// What to say of a shot that is given up, and has not been written all the same.
  Error Lost() const {
    const Error lost{ErrorCode::kIo,
                     "is lost: the disk refused it for " + Seconds() +
                         ", until the end of the daemon (" + why_.ToString() + ")",
                     "shot " + id_};
    store_.FreeSpareRoom();
    Tell("capture_lost", lost);
    return lost;
  }
  /// Likewise of one that is on the disk, but not in the database.
  Error NotRecorded(const Error& why) const {
    return {ErrorCode::kIo,
            "is on the disk, and the next start takes it into the database, which refused it for " +
                Seconds() + " (" + why.ToString() + ")",
            "shot " + id_};
  }

 private:
  using Clock = std::chrono::steady_clock;

  void Begin(const Error& waits) {
    since_ = Clock::now();
    Tell("capture_waits", waits);
  }
  void Tell(const char* kind, const Error& what) const {
    const Json data = {{"reason", what.message}};
    const std::string text = data.dump(-1, ' ', false, Json::error_handler_t::replace);
    const Status stored = store_.Write([&](Database&, std::vector<EventRecord>& events) {
      events.push_back({0, "", kind, id_, text});
      return Status();
    });
    if (!stored && options_.tell) options_.tell(what.ToString());
  }
  std::string Seconds() const {
    const auto waited = std::chrono::duration_cast<std::chrono::seconds>(Clock::now() - *since_);
    return std::to_string(waited.count()) + " s";
  }

  Store& store_;
  const CaptureJobOptions& options_;
  const std::string& id_;
  JobContext& context_;
  std::optional<Clock::time_point> since_;
  Error why_;
  bool given_up_ = false;
};

/// RecordCapture, again and again while the disk refuses.
Result<CaptureRecord> RecordInTheEnd(Store& store, const std::string& id,
                                     const std::optional<NewJob>& follow_up, ShotWait& wait,
                                     JobContext& context) {
  while (true) {
    Result<CaptureRecord> capture = RecordCapture(store, id, follow_up);
    if (capture || capture.error().code != ErrorCode::kIo) return capture;
    if (!wait.GoesOn(capture.error())) return wait.NotRecorded(capture.error());
    context.progress(kWaitingForDisk, 0, 1);
    std::this_thread::sleep_for(kMendInterval);
  }
}

/// What one capture job needs to know of the world.
struct CaptureWork {
  Store& store;
  CaptureStation& station;
  CaptureJobOptions options;

  Status CheckRoom() const { return CheckDiskReserve(store, options.disk_reserve_bytes()); }
  /// Whether an earlier run, which did not come to its end, had taken its shot.
  bool HasShot(const std::string& id) const {
    std::error_code ignored;
    return !id.empty() &&
           std::filesystem::exists(store.CaptureFolder(id) / "frameset.json", ignored);
  }
  /// `notes` gets what the operator is to know of it.
  Result<rig::FrameSetOrder> Order(const std::string& id, const CaptureRequest& request,
                                   std::vector<std::string>& notes) const;
  Result<std::string> Run(const JobRecord& job, JobContext& context) const;
};

Result<rig::FrameSetOrder> CaptureWork::Order(const std::string& id, const CaptureRequest& request,
                                              std::vector<std::string>& notes) const {
  ROTUNDA_ASSIGN_OR_RETURN(const std::optional<CalibrationRecord> active, ActiveCalibration(store));
  rig::FrameSetOrder order;
  order.out = store.CaptureFolder(id);
  order.id = id;
  order.captured_at = store.Now();
  order.subject = request.subject;
  order.trigger_source = station.TriggerSource();
  if (!active) return order;
  // Who stands there now may not come again: a calibration can be given to the reconstruction
  // later.
  Result<std::string> calibration = CalibrationText(store, active->id);
  if (calibration) {
    order.calibration = *std::move(calibration);
  } else {
    notes.push_back("taken without the calibration in force: " + calibration.error().ToString());
  }
  return order;
}

Result<std::string> CaptureWork::Run(const JobRecord& job, JobContext& context) const {
  ROTUNDA_ASSIGN_OR_RETURN(const CaptureRequest request, ParseCaptureRequest(job.body));
  std::string id = job.product;
  std::optional<rig::Shot> shot;
  std::vector<std::string> notes;
  ShotWait wait(store, options, id, context);
  if (!HasShot(id)) {
    ROTUNDA_RETURN_IF_ERROR(CheckRoom());
    // Also when an earlier run had reserved one: an id tells when its shot was taken.
    ROTUNDA_ASSIGN_OR_RETURN(id, FreeCaptureId(store));
    ROTUNDA_RETURN_IF_ERROR(SetJobProduct(store, job.number, id));
    ROTUNDA_ASSIGN_OR_RETURN(rig::FrameSetOrder order, Order(id, request, notes));
    Result<CaptureStation::Taken> taken = station.Take(
        std::move(order), [&wait](const Error& why) { return wait.GoesOn(why); }, context);
    if (!taken) return wait.given_up() ? wait.Lost() : taken.error();
    shot = std::move(taken->shot);
  }
  if (LacksItsPrior(store, request, id)) {
    notes.push_back(
        "reconstructed without the prior that was asked for: the set has no calibration");
  }
  const std::optional<NewJob> follow_up = FollowUp(store, request, id);
  ROTUNDA_ASSIGN_OR_RETURN(const CaptureRecord capture,
                           RecordInTheEnd(store, id, follow_up, wait, context));
  return ResultOf(capture, shot, notes).dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace

Result<rig::CaptureSession::Devices> OpenDevices(
    const rig::CaptureOptions& options, const std::optional<std::filesystem::path>& simulated) {
  rig::CaptureSession::Devices devices{rig::OpenAravisCamera, nullptr};
  if (simulated) {
    ROTUNDA_ASSIGN_OR_RETURN(const int line, LineOf(options.trigger.camera_input));
    devices.trigger = std::make_unique<sim::SocketTrigger>(*simulated, line);
  } else {
    ROTUNDA_ASSIGN_OR_RETURN(devices.trigger, rig::OpenGpiodTriggerLine(options.trigger.gpio));
  }
  return devices;
}

Status CheckSubject(const std::string& subject) {
  std::string found = NotPlain(subject);
  if (found.empty() && subject.size() > kMaxSubjectLength) {
    found = std::to_string(subject.size()) + " bytes";
  }
  if (found.empty()) return {};
  return Error{ErrorCode::kInvalidArgument,
               "expected at most " + std::to_string(kMaxSubjectLength) +
                   " bytes of UTF-8 without control characters, found " + found,
               "subject"};
}

rig::Shot FactsOf(const rig::Shot& shot) {
  rig::Shot facts;
  facts.skew = shot.skew;
  facts.pulses = shot.pulses;
  facts.first_try = shot.first_try;
  facts.interrupted = shot.interrupted;
  for (const rig::CameraShot& each : shot.cameras) {
    rig::CameraShot& copy = facts.cameras.emplace_back();
    copy.camera = each.camera;
    copy.verdict = each.verdict;
    copy.reason = each.reason;
    copy.settings = each.settings;
    copy.resent_packets = each.resent_packets;
    copy.arrival_ms = each.arrival_ms;
    copy.skew_us = each.skew_us;
  }
  return facts;
}

CaptureStation::CaptureStation(Options options) : options_(std::move(options)), writer_(0) {}

Result<std::unique_ptr<rig::CaptureSession>> CaptureStation::NewSession() const {
  ROTUNDA_ASSIGN_OR_RETURN(rig::CaptureSession::Devices devices,
                           OpenDevices(options_.capture, options_.simulated));
  return rig::CaptureSession::Open(options_.capture, std::move(devices));
}

Result<rig::CaptureSession*> CaptureStation::Session() {
  const std::lock_guard lock(mutex_);
  if (session_) return session_.get();
  Result<std::unique_ptr<rig::CaptureSession>> opened = NewSession();
  open_trouble_ = opened ? std::nullopt : std::optional(opened.error());
  if (!opened) return opened.error();
  session_ = *std::move(opened);
  return session_.get();
}

Status CaptureStation::Open() {
  const auto session = Session();
  return session ? Status() : Status(session.error());
}

std::vector<rig::CameraState> CaptureStation::States() const {
  const std::lock_guard lock(mutex_);
  return session_ ? session_->States() : std::vector<rig::CameraState>();
}

std::vector<std::string> CaptureStation::CameraNames() const {
  std::vector<std::string> names;
  for (const rig::CameraPlace& place : options_.capture.cameras) names.push_back(place.camera);
  return names;
}

std::optional<Error> CaptureStation::OpenTrouble() const {
  const std::lock_guard lock(mutex_);
  return open_trouble_;
}

Result<std::string> CaptureStation::PreviewJpeg(const std::string& camera) {
  ROTUNDA_ASSIGN_OR_RETURN(rig::CaptureSession * session, Session());
  // Asked first: the session takes the size of its frames' memory from the cameras that are open.
  const std::vector<rig::CameraState> states = session->States();
  const auto state = std::find_if(states.begin(), states.end(),
                                  [&](const auto& each) { return each.camera == camera; });
  if (state == states.end()) return Error{ErrorCode::kNotFound, "there is no such camera", camera};
  if (state->condition != rig::CameraCondition::kReady) {
    return Error{ErrorCode::kFailed, "is not ready: " + state->problem, camera};
  }
  ROTUNDA_ASSIGN_OR_RETURN(const rig::CameraFrame frame, session->Preview(camera));
  if (!frame.complete) return Error{ErrorCode::kFailed, frame.problem, camera};
  return ToJpeg(frame);
}

const char* CaptureStation::TriggerSource() const {
  return options_.simulated ? "simulated" : "gpio";
}

Result<CaptureStation::Taken> CaptureStation::Take(rig::FrameSetOrder order,
                                                   const DiskPatience& patience,
                                                   JobContext& context) {
  ROTUNDA_ASSIGN_OR_RETURN(rig::CaptureSession * session, Session());
  WaitForCameras(*session, options_.ready_patience, context);
  const LaterStop give_up(context.stop, kFramesPatience);
  ROTUNDA_ASSIGN_OR_RETURN(rig::Shot shot, session->Capture(context.stop, give_up.token()));
  Taken taken{FactsOf(shot), {}};
  const std::filesystem::path out = order.out;
  const auto ticket = writer_.Submit(std::move(order), std::move(shot));
  ROTUNDA_ASSIGN_OR_RETURN(taken.written, WaitForDisk(writer_, ticket, out, patience, context));
  return taken;
}

std::optional<NewJob> CaptureFollowUp(const Store& store, const JobRecord& job) {
  const Result<CaptureRequest> request = ParseCaptureRequest(job.body);
  return request ? FollowUp(store, *request, job.product) : std::nullopt;
}

JobHandler MakeCaptureHandler(Store& store, CaptureStation& station, CaptureJobOptions options) {
  const CaptureWork work{store, station, std::move(options)};
  JobHandler handler;
  handler.check = [](const std::string& body) -> Result<std::string> {
    ROTUNDA_ASSIGN_OR_RETURN(const CaptureRequest request, ParseCaptureRequest(body));
    if (request.subject) ROTUNDA_RETURN_IF_ERROR(CheckSubject(*request.subject));
    return ToBody(request);
  };
  handler.refers = [&store](const std::string& body) -> Status {
    ROTUNDA_ASSIGN_OR_RETURN(const CaptureRequest request, ParseCaptureRequest(body));
    return CheckReferences(store, request);
  };
  handler.admit = [work] { return work.CheckRoom(); };
  handler.run = [work](const JobRecord& job, JobContext& context) {
    return work.Run(job, context);
  };
  return handler;
}

}  // namespace rotunda::daemon
