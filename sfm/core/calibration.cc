#include "sfm/core/calibration.h"

#include <algorithm>
#include <array>
#include <utility>

#include "sfm/core/file_io.h"
#include "sfm/core/json_reader.h"
#include "sfm/core/json_types.h"

namespace rotunda {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::array<std::pair<CalibrationSource, const char*>, 3> kSources = {{
    {CalibrationSource::kCharuco, "charuco"},
    {CalibrationSource::kSfm, "sfm"},
    {CalibrationSource::kTruth, "truth"},
}};

Json CameraJson(const CalibratedCamera& camera) {
  Json object;
  object["camera"] = camera.camera;
  object["serial"] = camera.serial;
  AddIntrinsics(camera.intrinsics, object);
  object["cam_from_rig"] = Rigid3Json(camera.cam_from_rig);
  if (camera.sigma) object["sigma"] = SigmaJson(*camera.sigma);
  return object;
}

CalibratedCamera ReadCamera(const JsonField& object) {
  CalibratedCamera camera;
  camera.camera = object["camera"].String();
  if (camera.camera.empty()) object["camera"].Refuse("a camera's name");
  camera.serial = object["serial"].String();
  camera.intrinsics = ReadIntrinsics(object);
  camera.cam_from_rig = ReadRigid3(object["cam_from_rig"]);
  if (object["sigma"].present()) camera.sigma = ReadSigma(object["sigma"]);
  return camera;
}

Json FaceJson(const CalibratedFace& face) {
  Json object;
  object["face"] = face.face;
  object["board_from_face"] = Rigid3Json(face.board_from_face);
  object["bow_m"] = {face.bow_m.x(), face.bow_m.y()};
  return object;
}

CalibratedFace ReadFace(const JsonField& object) {
  CalibratedFace face;
  face.face = object["face"].String();
  if (face.face.empty()) object["face"].Refuse("a face's name");
  face.board_from_face = ReadRigid3(object["board_from_face"]);
  const std::vector<double> bow_m = object["bow_m"].Numbers(2);
  face.bow_m = Eigen::Vector2d(bow_m[0], bow_m[1]);
  return face;
}

std::vector<CalibratedFace> ReadFaces(const JsonField& board) {
  std::vector<CalibratedFace> faces;
  std::map<std::string, size_t> places;
  for (const JsonField& item : board["faces"].Items()) {
    faces.push_back(ReadFace(item));
    const auto [place, is_new] = places.emplace(faces.back().face, places.size());
    if (!is_new) {
      item["face"].Fail("face \"" + place->first + "\" is already board.faces[" +
                        std::to_string(place->second) + "]");
    }
  }
  return faces;
}

CalibrationSource ReadSource(const JsonField& field) {
  const std::string text = field.String();
  for (const auto& [source, name] : kSources) {
    if (text == name) return source;
  }
  field.Refuse("\"charuco\", \"sfm\" or \"truth\"");
  return CalibrationSource::kCharuco;
}

bool ByName(const CalibratedCamera& a, const CalibratedCamera& b) { return a.camera < b.camera; }

}  // namespace

const CalibratedCamera* Calibration::Find(std::string_view camera) const {
  const auto place = std::lower_bound(
      cameras.begin(), cameras.end(), camera,
      [](const CalibratedCamera& a, std::string_view name) { return a.camera < name; });
  return place != cameras.end() && place->camera == camera ? &*place : nullptr;
}

std::string CalibrationToJson(const Calibration& calibration) {
  Json root;
  root["format"] = kCalibrationFormat;
  root["id"] = calibration.id;
  root["created_at"] = calibration.created_at;
  for (const auto& [source, name] : kSources) {
    if (source == calibration.source) root["source"] = name;
  }
  root["cameras"] = Json::array();
  for (const CalibratedCamera& camera : calibration.cameras) {
    root["cameras"].push_back(CameraJson(camera));
  }
  for (const CalibratedFace& face : calibration.board) {
    root["board"]["faces"].push_back(FaceJson(face));
  }
  return JsonText(root);
}

Result<Calibration> CalibrationFromJson(const std::string& text, const std::string& source) {
  ROTUNDA_ASSIGN_OR_RETURN(const nlohmann::json json, ParseJson(text, source));
  JsonReader reader(source, json);
  const JsonField root = reader.root();
  root.ExpectFormat(kCalibrationFormat);
  Calibration calibration;
  calibration.id = root["id"].String();
  calibration.created_at = root["created_at"].String();
  calibration.source = ReadSource(root["source"]);
  std::map<std::string, size_t> places;
  for (const JsonField& item : root["cameras"].Items()) {
    calibration.cameras.push_back(ReadCamera(item));
    const auto [place, is_new] = places.emplace(calibration.cameras.back().camera, places.size());
    if (!is_new) {
      item["camera"].Fail("camera \"" + place->first + "\" is already cameras[" +
                          std::to_string(place->second) + "]");
    }
  }
  if (root["board"].present()) calibration.board = ReadFaces(root["board"]);
  ROTUNDA_RETURN_IF_ERROR(reader.status());
  std::sort(calibration.cameras.begin(), calibration.cameras.end(), ByName);
  return calibration;
}

Result<Calibration> ReadCalibration(const std::filesystem::path& file) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::string text, ReadFile(file));
  return CalibrationFromJson(text, file.string());
}

Status WriteCalibration(const Calibration& calibration, const std::filesystem::path& file) {
  return WriteFileAtomically(file, CalibrationToJson(calibration));
}

}  // namespace rotunda
