#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>
#include <sstream>

#include "daemon/api_answers.h"
#include "daemon/openapi.h"
#include "daemon/slow_look.h"
#include "daemon/store_calibrations.h"
#include "daemon/store_captures.h"
#include "daemon/store_jobs.h"
#include "daemon/store_reconstructions.h"
#include "sfm/core/name_list.h"

namespace rotunda::daemon {
namespace {

using Json = nlohmann::ordered_json;

// For the status: more that wait for their reconstruction, or have none, are not looked behind.
constexpr size_t kCapturesLookedAt = 20;

/// Whether the calibration in force can be read. Its file is parsed when it has changed, not at
/// every look: fifty clients may ask for the status.
class CalibrationCheck {
 public:
  /// What an operator is to know of it; empty: all is well.
  std::string Problem(const Store& store, const std::string& id) {
    const std::optional<Seen> seen =
        look_.Look([&](const Seen& last) { return Look(store, id, last); });
    if (seen) return seen->problem;
    return "the file of the calibration in force does not answer, and a capture would wait for it: "
           "is its disk or share there?";
  }

 private:
  struct Seen {
    std::string id;  // empty: look again
    timespec changed = {};
    std::string problem;
  };

  static Seen Look(const Store& store, const std::string& id, const Seen& last) {
    const std::filesystem::path file = store.CalibrationFolder(id) / "calibration.json";
    struct stat now {};
    const bool is_there = ::stat(file.c_str(), &now) == 0;
    // The time of the last change of contents, owner or mode.
    if (is_there && id == last.id && now.st_ctim.tv_sec == last.changed.tv_sec &&
        now.st_ctim.tv_nsec == last.changed.tv_nsec) {
      return last;
    }
    const Result<std::string> text = CalibrationText(store, id);
    // What is wrong with the machine, not with the file, may be over at the next look.
    const bool may_pass = !text && text.error().code == ErrorCode::kIo;
    return {
        may_pass ? "" : id, now.st_ctim,
        text ? ""
             : "captures are taken without the calibration in force: " + text.error().ToString()};
  }

  SlowLook<Seen> look_{Seen()};
};

/// What status and metrics tell.
struct Overview {
  std::vector<std::string> not_ready;  // cameras
  size_t cameras = 0;
  std::vector<CameraDrift> moved;
  std::vector<JobRecord> running;
  size_t queued_jobs = 0;
  std::optional<CalibrationRecord> calibration;
  std::optional<CaptureRecord> last_capture;
  DiskRoom room;
  uint64_t reserve_bytes = 0;
  std::vector<std::string> problems;
};

void LookAtDisks(const ApiParts& parts, Overview& overview) {
  const Result<DiskRoom> room = parts.store.LeastRoom();
  overview.reserve_bytes = parts.disk_reserve_bytes();
  if (!room) {
    overview.problems.push_back("the disk cannot be asked, captures are refused: " +
                                room.error().ToString());
    return;
  }
  overview.room = *room;
  if (room->free_bytes < overview.reserve_bytes) {
    overview.problems.push_back("the disk of " + room->folder.string() +
                                " has less room than the reserve: captures are refused. Remove "
                                "captures, or lower storage.reserve_mb and reload");
  }
}

void LookAtCameras(const CaptureStation& station, Overview& overview) {
  const std::vector<rig::CameraState> states = station.States();
  overview.cameras = station.CameraNames().size();
  for (const rig::CameraState& state : states) {
    if (state.condition != rig::CameraCondition::kReady) {
      overview.not_ready.push_back(state.camera);
    }
  }
  if (states.empty()) {
    overview.not_ready = station.CameraNames();
    const std::optional<Error> trouble = station.OpenTrouble();
    overview.problems.push_back("the cameras are not open" +
                                (trouble ? ": " + trouble->ToString() : std::string()) +
                                "; the next capture tries again");
  } else if (!overview.not_ready.empty()) {
    overview.problems.push_back(std::to_string(overview.not_ready.size()) + " of " +
                                std::to_string(states.size()) +
                                " cameras are not ready: " + ListOfNames(overview.not_ready) +
                                "; /v1/cameras and `rotunda cameras` say why");
  }
}

void LookAtDevices(const ApiParts& parts, Overview& overview) {
  LookAtCameras(parts.station, overview);
  for (const std::string& waits : parts.jobs.CancelRefusals()) overview.problems.push_back(waits);
  LookAtDisks(parts, overview);
  if (const auto hung = parts.jobs.Hung()) overview.problems.push_back(*hung);
  if (const auto trouble = parts.jobs.Trouble()) overview.problems.push_back(*trouble);
  if (!parts.troubles) return;
  for (const std::string& trouble : parts.troubles()) overview.problems.push_back(trouble);
}

/// Cameras that are not where the calibration has them, or that nobody knows the place of.
Status LookAtDrift(Store& store, Overview& overview) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<CameraDrift> drift, DriftNow(store));
  for (const CameraDrift& camera : drift) {
    if (!camera.moved) continue;
    overview.moved.push_back(camera);
    overview.problems.push_back("camera " + camera.latest.camera +
                                " has moved since the calibration; calibrate again");
  }
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<UnregisteredCamera> unregistered,
                           UnregisteredNow(store));
  for (const UnregisteredCamera& camera : unregistered) {
    overview.problems.push_back(
        "camera " + camera.latest.camera + " has no pose in the last " +
        std::to_string(camera.captures) + " captures (" + camera.latest.reason +
        "): is it turned away, covered or out of focus? Nobody knows whether it has moved");
  }
  return {};
}

/// Names the cameras whose frames the newest capture lacks.
Status LookAtFrames(Store& store, const CaptureRecord& capture, Overview& overview) {
  if (capture.ok_frames == capture.frames) return {};
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, ListFrames(store, capture.id));
  std::vector<std::string> bad;
  for (const FrameRecord& frame : frames) {
    if (frame.status != "ok") bad.push_back(frame.camera);
  }
  overview.problems.push_back(
      "the last capture, " + capture.id + ", has " + std::to_string(capture.ok_frames) + " of " +
      std::to_string(capture.frames) + " frames: without " + ListOfNames(bad) +
      "; `rotunda captures " + capture.id + "` says why");
  return {};
}

/// Says so when the newest captures that were reconstructed are all not sure, as many as it takes
/// to name a camera, or half of those looked at. Those that wait for their reconstruction say
/// nothing yet, and those that do not speak of the rig say nothing of what is wrong with it.
Status LookAtVerdicts(Store& store, Overview& overview) {
  const size_t captures_to_tell = std::min(store.options().drift.captures, kCapturesLookedAt / 2);
  ROTUNDA_ASSIGN_OR_RETURN(
      const auto newest,
      ListCaptures(store, {.limit = kCapturesLookedAt, .after = ""}, Speakers::kOfTheRig));
  std::vector<CaptureRecord> not_sure;
  for (const CaptureRecord& capture : newest.items) {
    if (!capture.reconstruction) continue;
    if (capture.verdict != "unsure" && capture.verdict != "folded") break;
    not_sure.push_back(capture);
  }
  if (not_sure.empty() || not_sure.size() < captures_to_tell) return {};
  const CaptureRecord& latest = not_sure.front();
  overview.problems.push_back("of the captures that were reconstructed the newest " +
                              std::to_string(not_sure.size()) + " are not sure; " + latest.id +
                              " is " + latest.verdict + ": " + latest.verdict_reason);
  return {};
}

Status LookAtLastCapture(Store& store, Overview& overview) {
  ROTUNDA_ASSIGN_OR_RETURN(const auto newest, ListCaptures(store, {.limit = 1, .after = ""}));
  if (newest.items.empty()) return {};
  overview.last_capture = newest.items.front();
  return LookAtFrames(store, newest.items.front(), overview);
}

Status LookAtStore(const ApiParts& parts, CalibrationCheck& check, Overview& overview) {
  Store& store = parts.store;
  ROTUNDA_ASSIGN_OR_RETURN(overview.calibration, ActiveCalibration(store));
  ROTUNDA_ASSIGN_OR_RETURN(overview.queued_jobs, CountJobs(store, JobState::kQueued));
  ROTUNDA_ASSIGN_OR_RETURN(const auto running, ListJobs(store, {}, JobState::kRunning));
  overview.running = running.items;
  ROTUNDA_RETURN_IF_ERROR(LookAtLastCapture(store, overview));
  ROTUNDA_RETURN_IF_ERROR(LookAtVerdicts(store, overview));
  ROTUNDA_RETURN_IF_ERROR(LookAtDrift(store, overview));
  if (!overview.calibration) {
    overview.problems.push_back(
        "no calibration is in force: poses have no scale, drift is not "
        "watched");
    return {};
  }
  const std::string wrong = check.Problem(store, overview.calibration->id);
  if (!wrong.empty()) overview.problems.push_back(wrong);
  return {};
}

Result<Overview> LookAround(const ApiParts& parts, CalibrationCheck& check) {
  Overview overview;
  LookAtDevices(parts, overview);
  ROTUNDA_RETURN_IF_ERROR(LookAtStore(parts, check, overview));
  return overview;
}

HttpResponse StatusAnswer(const ApiParts& parts, CalibrationCheck& check) {
  const Result<Overview> overview = LookAround(parts, check);
  if (!overview) return Problem(overview.error());
  Json answer = {
      {"version", parts.version},
      {"now", parts.store.Now()},
      {"started_at", parts.started_at},
      {"cameras",
       {{"ready", overview->cameras - overview->not_ready.size()},
        {"of", overview->cameras},
        {"not_ready", overview->not_ready}}},
      {"jobs", {{"queued", overview->queued_jobs}, {"running", ItemsJson(overview->running)}}},
      {"moved", ItemsJson(overview->moved)},
      {"disk",
       {{"folder", overview->room.folder.string()},
        {"free_bytes", overview->room.free_bytes},
        {"reserve_bytes", overview->reserve_bytes}}},
      {"problems", overview->problems}};
  if (overview->calibration) answer["calibration"] = overview->calibration->id;
  if (overview->last_capture) answer["last_capture"] = ToJson(*overview->last_capture);
  return JsonAnswer(answer);
}

/// Prometheus' text format, version 0.0.4.
class Metrics {
 public:
  void Add(const std::string& name, const char* type, const char* help, uint64_t value) {
    text_ << "# HELP rotunda_" << name << ' ' << help << "\n# TYPE rotunda_" << name << ' ' << type
          << "\nrotunda_" << name << ' ' << value << '\n';
  }
  std::string text() const { return text_.str(); }

 private:
  std::ostringstream text_;
};

HttpResponse MetricsAnswer(const ApiParts& parts, CalibrationCheck& check) {
  const Result<Overview> overview = LookAround(parts, check);
  if (!overview) return Problem(overview.error());
  const HttpCounters http = parts.counters();
  Metrics metrics;
  metrics.Add("cameras", "gauge", "Cameras in the configuration", overview->cameras);
  metrics.Add("cameras_ready", "gauge", "Cameras that would answer a trigger",
              overview->cameras - overview->not_ready.size());
  metrics.Add("cameras_moved", "gauge", "Cameras that are not where the calibration has them",
              overview->moved.size());
  metrics.Add("jobs_queued", "gauge", "Jobs that wait", overview->queued_jobs);
  metrics.Add("jobs_running", "gauge", "Jobs under way", overview->running.size());
  metrics.Add("disk_free_bytes", "gauge", "Free on the fullest disk of the state folder",
              overview->room.free_bytes);
  metrics.Add("disk_reserve_bytes", "gauge", "With less captures are refused",
              overview->reserve_bytes);
  metrics.Add("problems", "gauge", "Entries of the list in /v1/status", overview->problems.size());
  metrics.Add("http_requests_total", "counter", "Requests read", http.requests);
  metrics.Add("http_connections", "gauge", "Connections open", http.connections);
  metrics.Add("http_streams", "gauge", "Event streams open", http.streams);
  metrics.Add("http_refused_connections_total", "counter", "Connections over the limit",
              http.refused_connections);
  HttpResponse response;
  response.content_type = "text/plain; version=0.0.4; charset=utf-8";
  response.body = metrics.text();
  return response;
}

}  // namespace

std::vector<Route> ServiceRoutes(const ApiParts& parts) {
  const auto check = std::make_shared<CalibrationCheck>();
  return {{.method = "GET",
           .path = "/v1/status",
           .operation = "getStatus",
           .summary = "How the rig is: cameras, jobs, drift, disk, and what to see to",
           .schema = "Status",
           .handle = [parts, check](const ApiRequest&) { return StatusAnswer(parts, *check); }},
          {.method = "GET",
           .path = "/metrics",
           .operation = "getMetrics",
           .summary = "Figures for Prometheus",
           .content_type = "text/plain; version=0.0.4; charset=utf-8",
           .handle = [parts, check](const ApiRequest&) { return MetricsAnswer(parts, *check); }}};
}

std::vector<Route> ApiRoutes(const ApiParts& parts) {
  std::vector<Route> routes = ServiceRoutes(parts);
  for (const auto& more :
       {CameraRoutes(parts), CaptureRoutes(parts), CalibrationRoutes(parts), JobRoutes(parts)}) {
    routes.insert(routes.end(), more.begin(), more.end());
  }
  routes.push_back({.method = "GET",
                    .path = "/v1/openapi.json",
                    .operation = "getOpenApi",
                    .summary = "This document"});
  // Made once, when the table is whole.
  HttpResponse document;
  document.body = OpenApiDocument(routes, parts.version);
  routes.back().handle = [document](const ApiRequest&) { return document; };
  return routes;
}

}  // namespace rotunda::daemon
