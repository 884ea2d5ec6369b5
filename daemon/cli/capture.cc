#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>
#include <utility>

#include "config/capture_config.h"
#include "daemon/api_json.h"
#include "daemon/capture_job.h"
#include "daemon/cli/commands.h"
#include "daemon/cli/daemon_commands.h"
#include "daemon/cli/daemon_tables.h"
#include "daemon/cli/serve_cameras.h"
#include "daemon/cli/terminal.h"
#include "rig/aravis_camera.h"
#include "rig/camera_discovery.h"
#include "rig/capture_session.h"
#include "rig/complaints.h"
#include "rig/frame_set_writer.h"
#include "sfm/core/bytes_text.h"
#include "sfm/core/calibration.h"
#include "sfm/core/file_io.h"
#include "sfm/core/name_list.h"

namespace rotunda::cli {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using std::chrono::milliseconds;

// So long after the last camera became ready, or was still being opened, the others are given up. A
// camera whose program died is held for the 3 s of its heartbeat.
constexpr auto kReadyPatience = milliseconds(5000);
constexpr auto kPollInterval = milliseconds(50);
constexpr auto kDiskPollInterval = milliseconds(10);
constexpr auto kBroadcastPatience = milliseconds(1000);
// A picture is coded and written in a hundredth of this; only making ninety of them durable may
// take as long, and is then told for nothing.
constexpr auto kDiskPatience = milliseconds(3000);

struct CaptureArguments {
  fs::path rig;
  fs::path out;
  std::optional<fs::path> simulated;  // socket of the simulated cameras
  std::optional<fs::path> calibration;
  std::optional<std::string> subject;
};

std::string NowText(const char* format) {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char text[32];
  std::strftime(text, sizeof(text), format, &utc);
  return text;
}

/// A camera's clock may take many seconds to follow the PTP master.
bool IsOpening(const rig::CaptureSession& session) {
  const std::vector<rig::CameraState> states = session.States();
  return std::any_of(states.begin(), states.end(), [](const rig::CameraState& state) {
    return state.condition == rig::CameraCondition::kOpening;
  });
}

/// Waits for the cameras, telling how many there are. kCancelled.
Status WaitForCameras(rig::CaptureSession& session, const CommonOptions& common) {
  ProgressLine progress(!common.json);
  const size_t all = session.options().cameras.size();
  auto deadline = std::chrono::steady_clock::now() + kReadyPatience;
  size_t ready = 0;
  while (ready < all && std::chrono::steady_clock::now() < deadline &&
         !common.stop.stop_requested()) {
    const size_t before = ready;
    ready = session.WaitUntilReady(kPollInterval, common.stop);
    if (ready > before || IsOpening(session)) {
      deadline = std::chrono::steady_clock::now() + kReadyPatience;
    }
    progress.Update("cameras", ready, all);
  }
  if (common.stop.stop_requested()) return Interrupted(" while the cameras were being opened");
  return {};
}

/// What keeps a set from the disk.
class DiskWatch {
 public:
  explicit DiskWatch(const rig::FrameSetWriter& writer)
      : writer_(writer), signs_(writer.signs_of_life()) {}

  /// That it refuses, or does not answer; empty: neither.
  std::string Trouble() {
    const auto now = Clock::now();
    const uint64_t signs = writer_.signs_of_life();
    if (signs != std::exchange(signs_, signs)) alive_ = now;
    const auto trouble = writer_.trouble();
    if (trouble && trouble->tried_again) return trouble->error.ToString();
    return now - alive_ > kDiskPatience ? "the disk does not answer" : "";
  }

 private:
  using Clock = std::chrono::steady_clock;
  const rig::FrameSetWriter& writer_;
  uint64_t signs_;
  Clock::time_point alive_ = Clock::now();
};

/// Waits for the disk. A set that cannot be written stays in memory until it can, which is told
/// once; Ctrl-C gives it up then (kCancelled), but not one that nothing is the matter with.
Result<rig::WrittenSet> WaitForDisk(rig::FrameSetWriter& writer, rig::FrameSetWriter::Ticket ticket,
                                    const CommonOptions& common) {
  std::stop_source at_once;
  at_once.request_stop();
  DiskWatch watch(writer);
  bool told = false;
  while (true) {
    Result<rig::WrittenSet> written = writer.Wait(ticket, at_once.get_token());
    if (written || written.error().code != ErrorCode::kCancelled) return written;
    const std::string trouble = watch.Trouble();
    if (!trouble.empty() && common.stop.stop_requested()) {
      writer.Abandon(ticket);
      written = writer.Wait(ticket);  // it may have been written all the same
      if (written) return written;
      return Interrupted(", the pictures are lost and nothing is left: " + trouble);
    }
    if (!trouble.empty() && !std::exchange(told, true)) {
      std::fprintf(stderr,
                   "rotunda: %s; the frames stay in memory until it works (Ctrl-C gives them up)\n",
                   trouble.c_str());
    }
    std::this_thread::sleep_for(kDiskPollInterval);
  }
}

/// A set that cannot be where it was ordered goes to the system's temporary folder: who was
/// photographed may have left. The error says where it is, or that it is lost.
Error Rescue(rig::FrameSetWriter& writer, rig::FrameSetWriter::Ticket ticket, const Error& why,
             const CommonOptions& common) {
  std::error_code ignored;
  const fs::path place =
      fs::temp_directory_path(ignored) /
      ("rotunda-" + NowText("%Y%m%dT%H%M%SZ") + "-" + std::to_string(::getpid()));
  std::fprintf(stderr, "rotunda: %s; the frames are in memory and will be written to %s\n",
               why.ToString().c_str(), place.c_str());
  if (!writer.Redirect(ticket, place)) return why;
  const Result<rig::WrittenSet> written = WaitForDisk(writer, ticket, common);
  if (written) {
    return {why.code, why.message + "; the set is in " + place.string() + " instead: move it",
            why.context};
  }
  return {why.code, why.message + "; nor could it be written to " + written.error().ToString(),
          why.context};
}

Json CameraJson(const rig::CameraShot& camera, const rig::WrittenSet& written) {
  Json row = {{"camera", camera.camera}, {"verdict", rig::VerdictName(camera.verdict)}};
  if (!camera.reason.empty()) row["reason"] = camera.reason;
  if (camera.skew_us) row["skew_us"] = *camera.skew_us;
  if (camera.arrival_ms) row["arrival_ms"] = *camera.arrival_ms;
  row["resent_packets"] = camera.resent_packets;
  row["exposure_us"] = camera.settings.exposure_us;
  if (const auto found = written.figures.find(camera.camera); found != written.figures.end()) {
    row["mean_level"] = found->second.mean_level;
    row["clipped_part"] = found->second.clipped_part;
    row["sharpness"] = found->second.sharpness;
  }
  return row;
}

void PrintShot(const rig::Shot& shot, const rig::WrittenSet& written,
               const std::vector<std::string>& notes, bool json) {
  if (json) {
    Json cameras = Json::array();
    for (const rig::CameraShot& each : shot.cameras) cameras.push_back(CameraJson(each, written));
    Json result = {{"out", written.folder.string()},
                   {"ok", shot.OkCount()},
                   {"of", shot.cameras.size()},
                   {"complete", shot.complete()},
                   {"pulses", shot.pulses}};
    if (shot.interrupted) result["interrupted"] = true;
    if (shot.skew.known()) {
      result["median_skew_us"] = shot.skew.median_us;
      result["max_skew_us"] = shot.skew.max_us;
      result["max_skew_camera"] = shot.skew.worst;
    }
    result["resent_packets"] = shot.ResentPackets();
    result["bytes"] = written.bytes;
    if (!notes.empty()) result["notes"] = notes;
    result["cameras"] = std::move(cameras);
    std::printf("%s\n", result.dump(1).c_str());
    return;
  }
  std::printf("%s\n", shot.Tally().c_str());
  if (!shot.first_try.empty()) std::printf("earlier pulse: %s\n", shot.first_try.c_str());
  if (shot.skew.known()) {
    std::printf("skew: median %.1f us, largest %.1f us (%s)\n", shot.skew.median_us,
                shot.skew.max_us, shot.skew.worst.c_str());
  }
  std::printf("packets sent again: %llu\n", static_cast<unsigned long long>(shot.ResentPackets()));
  std::printf("Wrote %s (%s)\n", written.folder.c_str(), BytesText(written.bytes).c_str());
  for (const std::string& note : notes) std::printf("  note: %s\n", note.c_str());
}

/// The rig's cameras that are not in `calibration`: by name, and by serial number where both say
/// it.
std::vector<std::string> Uncalibrated(const std::vector<rig::CameraPlace>& cameras,
                                      const Calibration& calibration) {
  std::vector<std::string> lacking;
  for (const rig::CameraPlace& place : cameras) {
    const CalibratedCamera* known = calibration.Find(place.camera);
    const bool is_it = known != nullptr && (known->serial.empty() || place.serial.empty() ||
                                            known->serial == place.serial);
    if (!is_it) lacking.push_back(place.camera);
  }
  return lacking;
}

/// The text of the calibration that goes with the set; read before the pulse, so that nothing can
/// be wrong with it afterwards. `notes` gets which of the rig's `cameras` it does not have.
/// kBadInput: it has none of them.
Result<std::string> CalibrationText(const fs::path& file,
                                    const std::vector<rig::CameraPlace>& cameras,
                                    std::vector<std::string>& notes) {
  ROTUNDA_ASSIGN_OR_RETURN(std::string text, ReadFile(file));
  ROTUNDA_ASSIGN_OR_RETURN(const Calibration calibration, CalibrationFromJson(text, file.string()));
  const std::vector<std::string> lacking = Uncalibrated(cameras, calibration);
  const std::string all = std::to_string(cameras.size());
  if (lacking.size() == cameras.size()) {
    return Error{ErrorCode::kBadInput,
                 "has none of the rig's " + all +
                     " cameras by name and serial number, expected a calibration of this rig",
                 file.string()};
  }
  if (!lacking.empty()) {
    notes.push_back(file.string() + " does not have " + std::to_string(lacking.size()) +
                    " of the rig's " + all +
                    " cameras by name and serial number: " + ListOfNames(lacking));
  }
  return text;
}

/// What the set says of itself, but for when it was taken. `notes` gets what the user is to know.
Result<rig::FrameSetOrder> OrderOf(const CaptureArguments& arguments,
                                   const std::vector<rig::CameraPlace>& cameras,
                                   std::vector<std::string>& notes) {
  rig::FrameSetOrder order;
  order.out = arguments.out;
  order.subject = arguments.subject;
  order.trigger_source = arguments.simulated ? "simulated" : "gpio";
  if (arguments.calibration) {
    ROTUNDA_ASSIGN_OR_RETURN(order.calibration,
                             CalibrationText(*arguments.calibration, cameras, notes));
  }
  return order;
}

/// kCancelled: by Ctrl-C, and nothing is left.
Result<rig::Shot> Capture(const CaptureArguments& arguments, const CommonOptions& common) {
  ROTUNDA_RETURN_IF_ERROR(CheckOutputPlace(arguments.out, 0));
  ROTUNDA_ASSIGN_OR_RETURN(const rig::CaptureOptions options,
                           config::ReadCaptureOptions(arguments.rig));
  std::vector<std::string> notes;
  ROTUNDA_ASSIGN_OR_RETURN(rig::FrameSetOrder order, OrderOf(arguments, options.cameras, notes));
  ROTUNDA_ASSIGN_OR_RETURN(rig::CaptureSession::Devices devices,
                           daemon::OpenDevices(options, arguments.simulated));
  ROTUNDA_ASSIGN_OR_RETURN(const std::unique_ptr<rig::CaptureSession> session,
                           rig::CaptureSession::Open(options, std::move(devices)));
  ROTUNDA_RETURN_IF_ERROR(WaitForCameras(*session, common));
  ROTUNDA_RETURN_IF_ERROR(CheckOutputPlace(arguments.out, session->ShotLimit_bytes()));
  order.id = NowText("%Y%m%dT%H%M%SZ");
  order.captured_at = NowText("%Y-%m-%dT%H:%M:%SZ");
  Result<rig::Shot> shot = session->Capture(common.stop, common.stop);
  if (!shot && shot.error().code == ErrorCode::kCancelled) {
    return Interrupted(" before a picture had come, nothing is left");
  }
  if (!shot) return shot.error();
  rig::Shot facts = daemon::FactsOf(*shot);
  rig::FrameSetWriter writer(common.threads);
  const auto ticket = writer.Submit(std::move(order), *std::move(shot));
  const Result<rig::WrittenSet> written = WaitForDisk(writer, ticket, common);
  if (!written && written.error().code == ErrorCode::kCancelled) return written.error();
  if (!written) return Rescue(writer, ticket, written.error(), common);
  PrintShot(facts, *written, notes, common.json);
  return facts;
}

/// What is wrong with whom, a problem that several cameras share said once.
std::vector<std::string> ProblemsOf(const std::vector<rig::CameraState>& states) {
  std::vector<rig::Complaint> complaints;
  for (const rig::CameraState& state : states) {
    if (state.problem.empty()) continue;
    complaints.push_back({state.camera, rig::ConditionName(state), state.problem});
  }
  return rig::GroupComplaints(complaints, states.size());
}

void PrintStates(const std::vector<rig::CameraState>& states,
                 const std::vector<rig::CameraIdentity>& unused) {
  std::printf("%-8s %-12s %-7s %-15s %-12s %-14s %-10s %7s %6s %7s %s\n", "camera", "is", "control",
              "address", "serial", "model", "firmware", "temp", "packet", "resent", "last frame");
  for (const rig::CameraState& state : states) {
    const auto temperature = state.health.temperature_deg_c;
    char degrees[16] = "-";
    if (temperature) std::snprintf(degrees, sizeof(degrees), "%.1f C", *temperature);
    char last_frame[48] = "-";
    if (const auto age_s = rig::LastFrameAge_s(state)) {
      std::snprintf(last_frame, sizeof(last_frame), "%llu, %.1f s ago",
                    static_cast<unsigned long long>(*state.last_frame_id), *age_s);
    }
    std::printf("%-8s %-12s %-7s %-15s %-12s %-14s %-10s %7s %6d %7llu %s\n", state.camera.c_str(),
                rig::ConditionName(state), state.health.control_held ? "held" : "-",
                state.identity.address.c_str(), state.identity.serial.c_str(),
                state.identity.model.c_str(), state.identity.firmware.c_str(), degrees,
                state.settings.packet_size_bytes,
                static_cast<unsigned long long>(state.counters.resent_packets), last_frame);
  }
  for (const std::string& each : ProblemsOf(states)) std::printf("%s\n", each.c_str());
  for (const rig::CameraIdentity& camera : unused) {
    std::printf("not in the configuration: %s %s, serial %s at %s\n", camera.vendor.c_str(),
                camera.model.c_str(), camera.serial.c_str(), camera.address.c_str());
  }
}

/// As the daemon lists its cameras, and those on the network that are not in the configuration.
Json CamerasJson(const std::vector<rig::CameraState>& states,
                 const std::vector<rig::CameraIdentity>& unused) {
  Json others = Json::array();
  for (const rig::CameraIdentity& camera : unused) {
    others.push_back({{"address", camera.address},
                      {"serial", camera.serial},
                      {"vendor", camera.vendor},
                      {"model", camera.model}});
  }
  return {{"items", daemon::ItemsJson(states)}, {"not_in_configuration", std::move(others)}};
}

Status ListCameras(const CaptureArguments& arguments, const CommonOptions& common) {
  ROTUNDA_ASSIGN_OR_RETURN(const rig::CaptureOptions options,
                           config::ReadCaptureOptions(arguments.rig));
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<rig::CameraIdentity> found,
                           rig::DiscoverCameras(kBroadcastPatience));
  ROTUNDA_ASSIGN_OR_RETURN(const std::unique_ptr<rig::CaptureSession> session,
                           rig::CaptureSession::Open(options, {rig::OpenAravisCamera, nullptr}));
  ROTUNDA_RETURN_IF_ERROR(WaitForCameras(*session, common));
  const std::vector<rig::CameraState> states = session->States();
  const rig::CameraMatch match = rig::MatchCameras(options.cameras, found);
  common.json ? cli::PrintJson(CamerasJson(states, match.unused))
              : PrintStates(states, match.unused);
  const auto ready = std::count_if(states.begin(), states.end(), [](const rig::CameraState& state) {
    return state.condition == rig::CameraCondition::kReady;
  });
  if (static_cast<size_t>(ready) == states.size()) return {};
  return Error{ErrorCode::kFailed,
               std::to_string(ready) + " of " + std::to_string(states.size()) + " are ready",
               "cameras"};
}

/// Without a daemon; the exit code.
int CaptureAlone(const CaptureArguments& arguments, const CommonOptions& common) {
  const Result<rig::Shot> shot = Capture(arguments, common);
  const bool interrupted = common.stop.stop_requested();
  if (!shot && interrupted && shot.error().code != ErrorCode::kCancelled) {
    return Fail(Interrupted("; " + shot.error().ToString()));
  }
  if (!shot) return Fail(shot.error());
  const std::string out = arguments.out.string();
  if (interrupted && shot->complete()) {
    return Fail(Interrupted(", but all pictures had come: " + out + " is complete"));
  }
  if (interrupted) {
    return Fail(
        Interrupted(", what had come is in " + out + ", marked incomplete: " + shot->Summary()));
  }
  if (shot->complete()) return kDone;
  return Fail({ErrorCode::kFailed, shot->Summary(), kIncompleteSet});
}

CLI::Option* AddRigOption(CLI::App* command, CaptureArguments& arguments) {
  return command
      ->add_option("--rig", arguments.rig,
                   "Without a daemon: cameras, network, trigger and settings, as in "
                   "config/capture.toml")
      ->type_name("FILE");
}

/// What the daemon is asked for, which --rig has no part in.
void AddShotOptions(CLI::App* command, CLI::Option* rig, DaemonShot& shot) {
  AddSocketOption(command, shot.socket)->excludes(rig);
  CLI::Option* follow =
      command
          ->add_flag("--follow", shot.follow,
                     "Wait for its reconstruction, too: tell the verdict, and cameras that moved")
          ->excludes(rig);
  CLI::Option* none = command->add_flag_callback(
      "--no-reconstruct", [&shot] { shot.reconstruct = false; },
      "Do not reconstruct it afterwards (the calibration target)");
  none->excludes(rig)->excludes(follow);
  AddPresetOption(command, shot.preset)->excludes(rig)->excludes(none);
  AddPriorOption(command, shot.prior)->excludes(rig)->excludes(none);
}

}  // namespace

void AddCapture(CLI::App& app, CommonOptions& common, Action& chosen) {
  auto arguments = std::make_shared<CaptureArguments>();
  auto shot = std::make_shared<DaemonShot>();
  CLI::App* command = AddCommand(
      app, common, "capture",
      "Take one synchronised picture with all cameras. With --rig without a daemon, written as a "
      "frame set; else by the daemon, which keeps and reconstructs it. Also a shot that cameras "
      "missed is written, and marked incomplete; the exit status is 1 then. Ctrl-C with --rig "
      "keeps "
      "the pictures that have come, as a set marked incomplete, or leaves nothing when none had; "
      "without, it ends only this command, and the daemon goes on.",
      "rotunda capture --subject \"person 1\" --follow\n"
      "  rotunda capture --rig config/capture.toml --out person1\n"
      "  rotunda capture --rig config/capture.toml --out person1 --simulated");
  const CLI::Validator subject(
      [](const std::string& text) {
        const Status fine = daemon::CheckSubject(text);
        return fine.ok() ? std::string() : fine.error().message;
      },
      "");
  command->add_option("--subject", arguments->subject, "Whom or what the pictures show")
      ->check(subject);
  CLI::Option* rig = AddRigOption(command, *arguments);
  CLI::Option* out =
      command
          ->add_option("--out", arguments->out,
                       "Folder to make, in one that exists; if it is there it must be empty")
          ->type_name("FRAMESET")
          ->needs(rig);
  rig->needs(out);
  command
      ->add_option_function<std::vector<std::string>>(
          "--simulated",
          [arguments](const std::vector<std::string>& socket) {
            const bool is_given = !socket.empty() && !socket.front().empty();
            arguments->simulated = is_given ? fs::path(socket.front()) : DefaultCameraSocket();
          },
          "Fire simulated cameras (`rotunda simulate --serve`) instead of the GPIO line; SOCKET as "
          "given to them, if it was")
      ->expected(0, 1)
      ->type_name("SOCKET")
      ->needs(rig);
  command
      ->add_option("--calibration", arguments->calibration,
                   "The calibration in force, to go with the set; one that has none of the rig's "
                   "cameras is refused")
      ->type_name("FILE")
      ->check(CLI::ExistingFile)
      ->needs(rig);
  AddThreads(command, common)->needs(rig);
  AddShotOptions(command, rig, *shot);
  command->callback([arguments, shot, &common, &chosen] {
    chosen = [arguments, shot, &common] {
      if (!arguments->rig.empty()) return CaptureAlone(*arguments, common);
      shot->subject = arguments->subject;
      return CaptureByDaemon(*shot, common);
    };
  });
}

void AddCameras(CLI::App& app, CommonOptions& common, Action& chosen) {
  auto arguments = std::make_shared<CaptureArguments>();
  auto socket = std::make_shared<fs::path>();
  CLI::App* command = AddCommand(
      app, common, "cameras",
      "Tell how each camera is: with --rig open them and name those that are missing, wrong or not "
      "in the configuration; else ask the daemon, which holds them.",
      "rotunda cameras\n  rotunda cameras --rig config/capture.toml");
  CLI::Option* rig = AddRigOption(command, *arguments);
  AddSocketOption(command, *socket)->excludes(rig);
  command->callback([arguments, socket, &common, &chosen] {
    chosen = [arguments, socket, &common] {
      if (arguments->rig.empty()) return CamerasOfDaemon(*socket, common);
      const Status status = ListCameras(*arguments, common);
      return status.ok() ? kDone : Fail(status.error());
    };
  });
}

}  // namespace rotunda::cli
