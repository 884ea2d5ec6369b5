#include "daemon/api_json.h"

#include <optional>
#include <string>

namespace rotunda::daemon {
namespace {

using Json = nlohmann::ordered_json;

template <typename T>
void AddIfKnown(Json& object, const char* key, const std::optional<T>& value) {
  if (value) object[key] = *value;
}
void AddIfAny(Json& object, const char* key, const std::string& value) {
  if (!value.empty()) object[key] = value;
}

/// A JSON text that the store keeps; what cannot be read is left as text.
Json Stored(const std::string& text) {
  Json value = Json::parse(text, nullptr, false);
  return value.is_discarded() ? Json(text) : value;
}

}  // namespace

Json ToJson(const CaptureRecord& capture) {
  Json object = {{"id", capture.id}, {"captured_at", capture.captured_at}};
  AddIfKnown(object, "subject", capture.subject);
  object["ok"] = capture.ok_frames;
  object["of"] = capture.frames;
  object["complete"] = capture.ok_frames == capture.frames;
  AddIfKnown(object, "calibration", capture.calibration);
  AddIfKnown(object, "reconstruction", capture.reconstruction);
  AddIfAny(object, "verdict", capture.verdict);
  if (capture.files_gone) object["files_gone"] = true;
  return object;
}

Json ToJson(const FrameRecord& frame) {
  Json object = {{"camera", frame.camera}, {"serial", frame.serial}, {"status", frame.status}};
  AddIfAny(object, "reason", frame.reason);
  object["has_picture"] = !frame.file.empty();
  AddIfAny(object, "xxh3", frame.xxh3);
  object["width"] = frame.width_px;
  object["height"] = frame.height_px;
  return object;
}

Json ToJson(const CalibrationRecord& calibration) {
  Json object = {{"id", calibration.id},
                 {"created_at", calibration.created_at},
                 {"source", calibration.source},
                 {"cameras", calibration.cameras},
                 {"active", calibration.active}};
  AddIfKnown(object, "activated_at", calibration.activated_at);
  AddIfKnown(object, "rms_px", calibration.rms_px);
  AddIfKnown(object, "held_out_rms_px", calibration.held_out_rms_px);
  if (!calibration.made_from.empty()) object["made_from"] = Stored(calibration.made_from);
  if (calibration.files_gone) object["files_gone"] = true;
  return object;
}

Json ToJson(const ReconstructionRecord& reconstruction) {
  Json object = {{"id", reconstruction.id},
                 {"capture", reconstruction.capture},
                 {"created_at", reconstruction.created_at},
                 {"method", reconstruction.method},
                 {"prior", reconstruction.prior},
                 {"registered", reconstruction.registered},
                 {"of", reconstruction.of},
                 {"rms_px", reconstruction.rms_px},
                 {"verdict", reconstruction.verdict},
                 {"verdict_reason", reconstruction.verdict_reason},
                 {"used_for_drift", reconstruction.used_for_drift}};
  AddIfAny(object, "preset", reconstruction.preset);
  if (reconstruction.verdict == "sure" || reconstruction.verdict == "folded")
    object["folded"] = reconstruction.folded;
  AddIfKnown(object, "calibration", reconstruction.calibration);
  AddIfKnown(object, "mean_rotation_deg", reconstruction.mean_rotation_deg);
  AddIfKnown(object, "mean_position_mm", reconstruction.mean_position_mm);
  if (reconstruction.files_gone) object["files_gone"] = true;
  return object;
}

Json ToJson(const DriftRecord& drift) {
  Json object = {{"camera", drift.camera},           {"capture", drift.capture},
                 {"captured_at", drift.captured_at}, {"reconstruction", drift.reconstruction},
                 {"calibration", drift.calibration}, {"rotation_deg", drift.rotation_deg},
                 {"position_mm", drift.position_mm}, {"beyond_limit", drift.beyond_limit}};
  AddIfKnown(object, "rotation_sigma_deg", drift.rotation_sigma_deg);
  AddIfKnown(object, "position_sigma_mm", drift.position_sigma_mm);
  AddIfKnown(object, "swapped_with", drift.swapped_with);
  return object;
}

Json ToJson(const CameraDrift& drift) {
  Json object = ToJson(drift.latest);
  object["captures"] = drift.captures;
  object["beyond_in_a_row"] = drift.beyond;
  object["moved"] = drift.moved;
  return object;
}

Json ToJson(const JobRecord& job) {
  Json object = {{"id", job.number},
                 {"kind", JobKindName(job.kind)},
                 {"state", JobStateName(job.state)},
                 {"request", Stored(job.body)},
                 {"created_at", job.created_at}};
  if (job.state == JobState::kRunning && !job.stage.empty()) {
    object["progress"] = {{"stage", job.stage}, {"done", job.done}, {"total", job.total}};
  }
  AddIfAny(object, "product", job.product);
  if (!job.result.empty()) object["result"] = Stored(job.result);
  AddIfAny(object, "error", job.error);
  AddIfKnown(object, "started_at", job.started_at);
  AddIfKnown(object, "ended_at", job.ended_at);
  if (job.cancel_requested) object["cancel_requested"] = true;
  return object;
}

Json ToJson(const EventRecord& event) {
  return {{"number", event.number},
          {"at", event.at},
          {"kind", event.kind},
          {"about", event.about},
          {"data", Stored(event.data)}};
}

Json ToJson(const rig::CameraState& camera) {
  Json object = {{"camera", camera.camera},
                 {"condition", rig::ConditionName(camera)},
                 {"address", camera.identity.address},
                 {"serial", camera.identity.serial},
                 {"vendor", camera.identity.vendor},
                 {"model", camera.identity.model},
                 {"firmware", camera.identity.firmware},
                 {"control_held", camera.health.control_held},
                 {"width", camera.settings.width_px},
                 {"height", camera.settings.height_px},
                 {"pixel_format", camera.settings.pixel_format},
                 {"exposure_us", camera.settings.exposure_us},
                 {"gain_db", camera.settings.gain_db},
                 {"packet_size_bytes", camera.settings.packet_size_bytes},
                 {"packet_delay_ns", camera.settings.packet_delay_ns},
                 {"resent_packets", camera.counters.resent_packets},
                 {"missing_packets", camera.counters.missing_packets}};
  AddIfAny(object, "problem", camera.problem);
  AddIfKnown(object, "temperature_deg_c", camera.health.temperature_deg_c);
  AddIfKnown(object, "ptp_offset_ns", camera.health.ptp_offset_ns);
  AddIfKnown(object, "last_frame_id", camera.last_frame_id);
  AddIfKnown(object, "last_frame_age_s", rig::LastFrameAge_s(camera));
  AddIfAny(object, "last_verdict", camera.last_verdict);
  return object;
}

std::string AnswerText(const Json& value) {
  return value.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace rotunda::daemon
