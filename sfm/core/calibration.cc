#include "sfm/core/calibration.h"

#include <algorithm>
#include <array>
#include <limits>
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

/// Lower triangle, row by row.
Json CovarianceJson(const Eigen::MatrixXd& covariance) {
  Json numbers = Json::array();
  for (Eigen::Index row = 0; row < covariance.rows(); ++row) {
    for (Eigen::Index column = 0; column <= row; ++column) {
      numbers.push_back(covariance(row, column));
    }
  }
  return numbers;
}

Eigen::MatrixXd ReadCovariance(const JsonField& field, CameraModel model) {
  const size_t size = 6 + CameraParamCount(model);
  const std::vector<double> numbers = field.Numbers(size * (size + 1) / 2);
  Eigen::MatrixXd covariance(size, size);
  size_t next = 0;
  for (Eigen::Index row = 0; row < covariance.rows(); ++row) {
    for (Eigen::Index column = 0; column <= row; ++column) {
      covariance(row, column) = covariance(column, row) = numbers[next++];
    }
  }
  if (!(covariance.diagonal().minCoeff() >= 0)) field.Fail("a variance is negative");
  return covariance;
}

Json FitJson(const CameraFit& fit) {
  Json object;
  object["corners"] = fit.corners;
  object["kept"] = fit.kept;
  object["rms_px"] = fit.rms_px;
  object["projection_mean_px"] = fit.projection_mean_px;
  object["projection_max_px"] = fit.projection_max_px;
  return object;
}

CameraFit ReadFit(const JsonField& object) {
  return {object["corners"].Unsigned(), object["kept"].Unsigned(),
          ReadNotNegative(object["rms_px"]), ReadNotNegative(object["projection_mean_px"]),
          ReadNotNegative(object["projection_max_px"])};
}

Json CameraJson(const CalibratedCamera& camera) {
  Json object;
  object["camera"] = camera.camera;
  object["serial"] = camera.serial;
  AddIntrinsics(camera.intrinsics, object);
  object["cam_from_rig"] = Rigid3Json(camera.cam_from_rig);
  if (camera.sigma) object["sigma"] = SigmaJson(*camera.sigma);
  if (camera.covariance) object["covariance"] = CovarianceJson(*camera.covariance);
  if (camera.fit) object["fit"] = FitJson(*camera.fit);
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
  if (object["covariance"].present()) {
    camera.covariance = ReadCovariance(object["covariance"], camera.intrinsics.model);
  }
  if (object["fit"].present()) camera.fit = ReadFit(object["fit"]);
  return camera;
}

Json PrintJson(const FacePrint& print) {
  Json object;
  object["columns"] = print.columns;
  object["rows"] = print.rows;
  object["square_mm"] = print.square_mm;
  object["marker_mm"] = print.marker_mm;
  object["dictionary"] = print.dictionary;
  object["first_id"] = print.first_id;
  object["legacy_pattern"] = print.legacy_pattern;
  return object;
}

FacePrint ReadPrint(const JsonField& object) {
  const auto whole = [&](const char* name) {
    return static_cast<int>(object[name].Unsigned(0, std::numeric_limits<int>::max()));
  };
  return {whole("columns"),
          whole("rows"),
          object["square_mm"].Number(),
          object["marker_mm"].Number(),
          object["dictionary"].String(),
          whole("first_id"),
          object["legacy_pattern"].Bool()};
}

Json FaceJson(const CalibratedFace& face) {
  Json object;
  object["face"] = face.face;
  object["board_from_face"] = Rigid3Json(face.board_from_face);
  object["bow_m"] = {face.bow_m.x(), face.bow_m.y()};
  if (face.sigma) {
    object["sigma"]["rotation_deg"] = face.sigma->rotation_deg;
    object["sigma"]["position_mm"] = face.sigma->position_mm;
    object["sigma"]["bow_mm"] = face.sigma->bow_mm;
  }
  if (face.print) object["print"] = PrintJson(*face.print);
  return object;
}

CalibratedFace ReadFace(const JsonField& object) {
  CalibratedFace face;
  face.face = object["face"].String();
  if (face.face.empty()) object["face"].Refuse("a face's name");
  face.board_from_face = ReadRigid3(object["board_from_face"]);
  const std::vector<double> bow_m = object["bow_m"].Numbers(2);
  face.bow_m = Eigen::Vector2d(bow_m[0], bow_m[1]);
  if (const JsonField sigma = object["sigma"]; sigma.present()) {
    face.sigma = FaceSigma{ReadNotNegative(sigma["rotation_deg"]),
                           ReadNotNegative(sigma["position_mm"]), ReadNotNegative(sigma["bow_mm"])};
  }
  if (object["print"].present()) face.print = ReadPrint(object["print"]);
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

Json ResidualsJson(const CalibrationResiduals& residuals) {
  Json object;
  object["corners"] = residuals.corners;
  object["kept"] = residuals.kept;
  object["rms_px"] = residuals.rms_px;
  object["noise"] = residuals.noise;
  const auto add = [&](const char* name, const std::optional<double>& value) {
    if (value) object[name] = *value;
  };
  add("held_out_rms_px", residuals.held_out_rms_px);
  add("held_out_p95_px", residuals.held_out_p95_px);
  add("half_split_rotation_ratio", residuals.half_split_rotation_ratio);
  add("half_split_position_ratio", residuals.half_split_position_ratio);
  return object;
}

CalibrationResiduals ReadResiduals(const JsonField& object) {
  CalibrationResiduals residuals;
  residuals.corners = object["corners"].Unsigned();
  residuals.kept = object["kept"].Unsigned();
  residuals.rms_px = ReadNotNegative(object["rms_px"]);
  residuals.noise = ReadNotNegative(object["noise"]);
  const auto read = [&](const char* name) -> std::optional<double> {
    if (!object[name].present()) return std::nullopt;
    return ReadNotNegative(object[name]);
  };
  residuals.held_out_rms_px = read("held_out_rms_px");
  residuals.held_out_p95_px = read("held_out_p95_px");
  residuals.half_split_rotation_ratio = read("half_split_rotation_ratio");
  residuals.half_split_position_ratio = read("half_split_position_ratio");
  return residuals;
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
  if (calibration.residuals) root["residuals"] = ResidualsJson(*calibration.residuals);
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
  if (root["residuals"].present()) calibration.residuals = ReadResiduals(root["residuals"]);
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
