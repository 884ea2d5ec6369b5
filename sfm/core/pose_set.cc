#include "sfm/core/pose_set.h"

#include <algorithm>
#include <limits>
#include <set>

#include "sfm/core/file_io.h"
#include "sfm/core/json_reader.h"
#include "sfm/core/json_types.h"

namespace rotunda {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kMm = 1000.0;  // millimetres a metre

Json VsCalibrationJson(const VsCalibration& vs) {
  Json object;
  object["rotation_deg"] = vs.rotation_deg;
  object["position_mm"] = vs.position_mm;
  object["sigmas"] = vs.sigmas;
  object["moved"] = vs.moved;
  if (vs.swapped_with) object["swapped_with"] = *vs.swapped_with;
  if (vs.wrong_side) object["wrong_side"] = true;
  if (vs.far_off) object["far_off"] = true;
  return object;
}

Json EvidenceJson(const PoseEvidence& evidence) {
  Json object = Json::object();
  if (evidence.certainty) object["certainty"] = *evidence.certainty;
  if (evidence.other_pose) {
    object["other_pose"] = {{"rotation_deg", evidence.other_pose->rotation_deg},
                            {"against", evidence.other_pose->against},
                            {"in_favour", evidence.other_pose->in_favour}};
  }
  object["doubtful"] = evidence.doubtful;
  object["late"] = evidence.late;
  return object;
}

/// An unregistered camera has no pose and nothing measured, only its lens if that is known.
Json CameraJson(const CameraPose& camera) {
  Json object;
  object["camera"] = camera.camera;
  object["registered"] = camera.registered;
  if (!camera.registered) object["reason"] = camera.reason;
  if (!camera.intrinsics.params.empty()) AddIntrinsics(camera.intrinsics, object);
  if (!camera.registered) return object;
  const Eigen::Vector3d position_mm = kMm * camera.cam_from_rig.OriginInSource();
  object["cam_from_rig"] = Rigid3Json(camera.cam_from_rig);
  object["position_mm"] = {position_mm.x(), position_mm.y(), position_mm.z()};
  if (camera.sigma) object["sigma"] = SigmaJson(*camera.sigma);
  if (!camera.side.empty()) object["side"] = camera.side;
  object["segments"] = camera.segments;
  object["observations"] = camera.observations;
  object["rms_px"] = camera.rms_px;
  if (camera.vs_calibration) object["vs_calibration"] = VsCalibrationJson(*camera.vs_calibration);
  if (camera.evidence) object["evidence"] = EvidenceJson(*camera.evidence);
  return object;
}

uint32_t ReadId(const JsonField& field) {
  return static_cast<uint32_t>(field.Unsigned(0, std::numeric_limits<uint32_t>::max()));
}

std::string ReadSide(const JsonField& field) {
  if (!field.present()) return "";
  const std::string side = field.String();
  if (side != "front" && side != "back" && side != "left" && side != "right") {
    field.Refuse("\"front\", \"back\", \"left\" or \"right\"");
  }
  return side;
}

VsCalibration ReadVsCalibration(const JsonField& object) {
  VsCalibration vs;
  vs.rotation_deg = object["rotation_deg"].Number();
  vs.position_mm = object["position_mm"].Number();
  vs.moved = object["moved"].Bool();
  if (object["sigmas"].present()) vs.sigmas = object["sigmas"].Number();
  if (object["wrong_side"].present()) vs.wrong_side = object["wrong_side"].Bool();
  if (object["far_off"].present()) vs.far_off = object["far_off"].Bool();
  if (vs.wrong_side && vs.moved) object["moved"].Refuse("false for a camera on the wrong side");
  const JsonField swapped_with = object["swapped_with"];
  if (!swapped_with.present()) return vs;
  vs.swapped_with = swapped_with.String();
  if (vs.swapped_with->empty()) swapped_with.Refuse("a camera's name");
  return vs;
}

PoseEvidence ReadEvidence(const JsonField& object) {
  PoseEvidence evidence;
  if (object["certainty"].present()) evidence.certainty = object["certainty"].Number();
  if (const JsonField other = object["other_pose"]; other.present()) {
    evidence.other_pose = OtherPose{other["rotation_deg"].Number(), other["against"].Number(),
                                    other["in_favour"].Number()};
  }
  evidence.doubtful = object["doubtful"].Bool();
  evidence.late = object["late"].Bool();
  return evidence;
}

/// position_mm of the text is not read: it follows from cam_from_rig.
CameraPose ReadCamera(const JsonField& object) {
  CameraPose camera;
  camera.camera = object["camera"].String();
  if (camera.camera.empty()) object["camera"].Refuse("a camera's name");
  camera.registered = object["registered"].Bool();
  if (!camera.registered) camera.reason = object["reason"].String();
  if (camera.registered || object["params"].present()) camera.intrinsics = ReadIntrinsics(object);
  if (!camera.registered) return camera;
  camera.cam_from_rig = ReadRigid3(object["cam_from_rig"]);
  if (object["sigma"].present()) camera.sigma = ReadSigma(object["sigma"]);
  camera.side = ReadSide(object["side"]);
  for (const JsonField& id : object["segments"].Items()) camera.segments.push_back(ReadId(id));
  camera.observations = object["observations"].Unsigned();
  camera.rms_px = object["rms_px"].Number();
  if (object["vs_calibration"].present()) {
    camera.vs_calibration = ReadVsCalibration(object["vs_calibration"]);
  }
  if (object["evidence"].present()) camera.evidence = ReadEvidence(object["evidence"]);
  return camera;
}

Json SegmentJson(const SegmentSummary& segment) {
  Json object;
  object["id"] = segment.id;
  object["community"] = segment.community;
  object["ambiguous"] = segment.ambiguous;
  if (!segment.side.empty()) object["side"] = segment.side;
  object["tracks"] = segment.tracks;
  object["cameras"] = segment.cameras;
  if (!segment.look_alikes.empty()) object["look_alikes"] = segment.look_alikes;
  return object;
}

SegmentSummary ReadSegment(const JsonField& object) {
  SegmentSummary segment;
  segment.id = ReadId(object["id"]);
  segment.community = ReadId(object["community"]);
  segment.ambiguous = object["ambiguous"].Bool();
  segment.side = ReadSide(object["side"]);
  segment.tracks = object["tracks"].Unsigned();
  segment.cameras = object["cameras"].Unsigned();
  if (object["look_alikes"].present()) {
    for (const JsonField& id : object["look_alikes"].Items()) {
      segment.look_alikes.push_back(ReadId(id));
    }
  }
  return segment;
}

Json SummaryJson(const PoseSummary& summary) {
  Json object;
  object["registered"] = summary.registered;
  object["of"] = summary.of;
  object["rms_px"] = summary.rms_px;
  object["mean_reprojection_px"] = summary.mean_reprojection_px;
  object["points"] = summary.points;
  object["models"] = summary.models;
  if (summary.mean_rotation_deg) object["mean_rotation_deg"] = *summary.mean_rotation_deg;
  if (summary.mean_position_mm) object["mean_position_mm"] = *summary.mean_position_mm;
  object["ambiguous_communities"] = summary.ambiguous_communities;
  if (summary.folded) object["folded"] = *summary.folded;
  if (!summary.verdict.empty()) {
    object["verdict"] = summary.verdict;
    object["verdict_reason"] = summary.verdict_reason;
  }
  if (!summary.verdict_of_pictures.empty()) {
    object["verdict_of_pictures"] = summary.verdict_of_pictures;
  }
  if (summary.margin) object["margin"] = *summary.margin;
  if (summary.view_graph_margin) object["view_graph_margin"] = *summary.view_graph_margin;
  return object;
}

std::string ReadVerdict(const JsonField& field) {
  if (!field.present()) return "";
  const std::string verdict = field.String();
  if (verdict != "sure" && verdict != "unsure" && verdict != "folded") {
    field.Refuse("\"sure\", \"unsure\" or \"folded\"");
  }
  return verdict;
}

PoseSummary ReadSummary(const JsonField& object) {
  PoseSummary summary;
  summary.registered = object["registered"].Unsigned();
  summary.of = object["of"].Unsigned();
  summary.rms_px = object["rms_px"].Number();
  summary.mean_reprojection_px = object["mean_reprojection_px"].Number();
  summary.points = object["points"].Unsigned();
  summary.models = object["models"].Unsigned();
  const JsonField rotation = object["mean_rotation_deg"];
  const JsonField position = object["mean_position_mm"];
  if (rotation.present()) summary.mean_rotation_deg = rotation.Number();
  if (position.present()) summary.mean_position_mm = position.Number();
  summary.ambiguous_communities = object["ambiguous_communities"].Unsigned();
  if (object["folded"].present()) summary.folded = object["folded"].Bool();
  summary.verdict = ReadVerdict(object["verdict"]);
  if (object["verdict_reason"].present()) {
    summary.verdict_reason = object["verdict_reason"].String();
  }
  summary.verdict_of_pictures = ReadVerdict(object["verdict_of_pictures"]);
  if (object["margin"].present()) summary.margin = object["margin"].Number();
  if (object["view_graph_margin"].present()) {
    summary.view_graph_margin = object["view_graph_margin"].Number();
  }
  return summary;
}

bool ReadMetric(const JsonField& field) {
  const std::string scale = field.String();
  if (scale != "metric" && scale != "arbitrary") field.Refuse("\"metric\" or \"arbitrary\"");
  return scale == "metric";
}

std::vector<CameraPose> ReadCameras(const JsonField& field) {
  std::vector<CameraPose> cameras;
  std::map<std::string, size_t> places;
  for (const JsonField& item : field.Items()) {
    cameras.push_back(ReadCamera(item));
    const auto [place, is_new] = places.emplace(cameras.back().camera, places.size());
    if (!is_new) {
      item["camera"].Fail("camera \"" + place->first + "\" is already cameras[" +
                          std::to_string(place->second) + "]");
    }
  }
  std::sort(cameras.begin(), cameras.end(),
            [](const CameraPose& a, const CameraPose& b) { return a.camera < b.camera; });
  return cameras;
}

}  // namespace

bool DisagreesAsAWhole(const std::vector<CameraPose>& cameras, double sigmas) {
  size_t compared = 0, beyond = 0;
  for (const CameraPose& camera : cameras) {
    if (!camera.vs_calibration || camera.vs_calibration->swapped_with) continue;
    ++compared;
    beyond += camera.vs_calibration->sigmas > sigmas;
  }
  return compared > 0 && 2 * beyond >= compared;
}

std::vector<std::string> CamerasWithoutFrame(const Calibration& calibration,
                                             const std::vector<CameraPose>& cameras) {
  std::set<std::string> present;
  for (const CameraPose& camera : cameras) present.insert(camera.camera);
  std::vector<std::string> absent;
  for (const CalibratedCamera& camera : calibration.cameras) {
    if (!present.contains(camera.camera)) absent.push_back(camera.camera);
  }
  return absent;
}

std::string PoseSetToJson(const PoseSet& poses) {
  Json root;
  root["format"] = kPosesFormat;
  root["frameset"] = poses.frameset;
  root["method"] = poses.method;
  root["options"] = Json::object();
  for (const auto& [key, value] : poses.options) root["options"][key] = value;
  root["scale"] = poses.metric ? "metric" : "arbitrary";
  if (poses.aligned_to) root["aligned_to"] = *poses.aligned_to;
  root["cameras"] = Json::array();
  for (const CameraPose& camera : poses.cameras) root["cameras"].push_back(CameraJson(camera));
  root["segments"] = Json::array();
  for (const SegmentSummary& segment : poses.segments) {
    root["segments"].push_back(SegmentJson(segment));
  }
  root["summary"] = SummaryJson(poses.summary);
  return JsonText(root);
}

Result<PoseSet> PoseSetFromJson(const std::string& text, const std::string& source) {
  ROTUNDA_ASSIGN_OR_RETURN(const nlohmann::json json, ParseJson(text, source));
  JsonReader reader(source, json);
  const JsonField root = reader.root();
  root.ExpectFormat(kPosesFormat);
  PoseSet poses;
  poses.frameset = root["frameset"].String();
  poses.method = root["method"].String();
  for (const auto& [key, value] : root["options"].Members()) poses.options[key] = value.String();
  poses.metric = ReadMetric(root["scale"]);
  if (root["aligned_to"].present()) poses.aligned_to = root["aligned_to"].String();
  poses.cameras = ReadCameras(root["cameras"]);
  for (const JsonField& item : root["segments"].Items()) {
    poses.segments.push_back(ReadSegment(item));
  }
  poses.summary = ReadSummary(root["summary"]);
  ROTUNDA_RETURN_IF_ERROR(reader.status());
  return poses;
}

Result<PoseSet> ReadPoseSet(const std::filesystem::path& file) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::string text, ReadFile(file));
  return PoseSetFromJson(text, file.string());
}

}  // namespace rotunda
