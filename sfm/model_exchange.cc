#include "sfm/model_exchange.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <map>
#include <nlohmann/json.hpp>
#include <span>
#include <utility>

#include "sfm/colmap_io.h"
#include "sfm/core/file_io.h"

namespace rotunda::sfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using RowMajor4 = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;
using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

constexpr double kFilmWidth_mm = 36.0;  // of the "35 mm equivalent"

/// The lens of the header.
struct BrownLens {
  int width_px = 0, height_px = 0;
  double fx_px = 0, fy_px = 0, cx_px = 0, cy_px = 0;
  double k1 = 0, k2 = 0, k3 = 0, p1 = 0, p2 = 0;
};

Result<BrownLens> BrownLensOf(const CameraIntrinsics& camera) {
  BrownLens lens;
  lens.width_px = camera.width_px;
  lens.height_px = camera.height_px;
  lens.fx_px = camera.fx_px();
  lens.fy_px = camera.fy_px();
  lens.cx_px = camera.cx_px();
  lens.cy_px = camera.cy_px();
  const std::vector<double>& params = camera.params;
  switch (camera.model) {
    case CameraModel::kSimplePinhole:
    case CameraModel::kPinhole:
      break;
    case CameraModel::kRadial:
      lens.k2 = params[4];
      [[fallthrough]];
    case CameraModel::kSimpleRadial:
      lens.k1 = params[3];
      break;
    case CameraModel::kFullOpencv:
      if (params[9] != 0 || params[10] != 0 || params[11] != 0) {
        return Error{ErrorCode::kInvalidArgument,
                     "has a FULL_OPENCV lens with k4, k5 or k6 other than 0, which this format "
                     "cannot hold; it holds SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV "
                     "and FULL_OPENCV without these: export as colmap, or calibrate with the model "
                     "opencv",
                     ""};
      }
      lens.k3 = params[8];
      [[fallthrough]];
    case CameraModel::kOpencv:
      lens.k1 = params[4];
      lens.k2 = params[5];
      lens.p1 = params[6];
      lens.p2 = params[7];
      break;
  }
  return lens;
}

/// A registered picture.
struct View {
  std::string name;  // of its file, as in the model
  std::string stem;  // without folder and ending
  size_t lens_index = 0;
  BrownLens lens;
  Rigid3 cam_from_model;
};

Result<std::vector<View>> ViewsOf(const Reconstruction& reconstruction,
                                  const std::vector<std::string>& image_names) {
  std::vector<View> views;
  for (size_t i = 0; i < image_names.size(); ++i) {
    const ImageId id(i);
    if (!reconstruction.Registered(id)) continue;
    const auto lens = BrownLensOf(reconstruction.intrinsics.of(id));
    std::string stem = fs::path(image_names[i]).stem().string();
    if (!lens) return lens.error().In("camera " + stem);
    views.push_back({image_names[i], std::move(stem), reconstruction.intrinsics.lens_of_image[i],
                     *lens, *reconstruction.cam_from_model[i]});
  }
  return views;
}

Status CheckStemsDiffer(const std::vector<View>& views) {
  std::map<std::string, std::string> names;
  for (const View& view : views) {
    const auto [other, is_new] = names.emplace(view.stem, view.name);
    if (is_new) continue;
    return Error{ErrorCode::kInvalidArgument,
                 "has the same name without folder and ending as " + other->second +
                     "; this format tells pictures apart by that",
                 view.name};
  }
  return {};
}

/// The shortest text that is read back as the same number.
std::string Text(double value) {
  char digits[32];
  return {digits, std::to_chars(digits, digits + sizeof(digits), value).ptr};
}

std::string Texts(std::span<const double> values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : " ") + Text(value);
  return text;
}

std::string InXml(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    switch (c) {
      case '&':
        escaped += "&amp;";
        break;
      case '<':
        escaped += "&lt;";
        break;
      case '>':
        escaped += "&gt;";
        break;
      case '"':
        escaped += "&quot;";
        break;
      default:
        escaped += c;
    }
  }
  return escaped;
}

RowMajor4 ModelFromCam(const Rigid3& cam_from_model) {
  RowMajor4 matrix = RowMajor4::Identity();
  matrix.topRows<3>() = cam_from_model.Inverse().Matrix();
  return matrix;
}

// --- nerfstudio

Json NerfstudioFrame(const View& view) {
  RowMajor4 world_from_gl = ModelFromCam(view.cam_from_model);
  world_from_gl.block<3, 2>(0, 1) *= -1.0;  // y down, z forward -> y up, z back
  Json rows = Json::array();
  for (int row = 0; row < 4; ++row) {
    const double* begin = world_from_gl.data() + 4 * row;
    rows.push_back(std::vector<double>(begin, begin + 4));
  }
  const BrownLens& lens = view.lens;
  return {{"file_path", "images/" + view.name},
          {"w", lens.width_px},
          {"h", lens.height_px},
          {"fl_x", lens.fx_px},
          {"fl_y", lens.fy_px},
          {"cx", lens.cx_px},
          {"cy", lens.cy_px},
          {"k1", lens.k1},
          {"k2", lens.k2},
          {"k3", lens.k3},
          {"p1", lens.p1},
          {"p2", lens.p2},
          {"transform_matrix", std::move(rows)}};
}

// --- Metashape

std::string MetashapeSensor(size_t id, const BrownLens& lens) {
  const std::string resolution = "<resolution width=\"" + std::to_string(lens.width_px) +
                                 "\" height=\"" + std::to_string(lens.height_px) + "\"/>\n";
  std::string text = "      <sensor id=\"" + std::to_string(id) + "\" label=\"lens " +
                     std::to_string(id) + "\" type=\"frame\">\n        " + resolution +
                     "        <property name=\"layer_index\" value=\"0\"/>\n"
                     "        <calibration type=\"frame\" class=\"adjusted\">\n          " +
                     resolution;
  const std::pair<const char*, double> parameters[] = {{"f", lens.fy_px},
                                                       {"cx", lens.cx_px - 0.5 * lens.width_px},
                                                       {"cy", lens.cy_px - 0.5 * lens.height_px},
                                                       {"b1", lens.fx_px - lens.fy_px},
                                                       {"b2", 0.0},
                                                       {"k1", lens.k1},
                                                       {"k2", lens.k2},
                                                       {"k3", lens.k3},
                                                       {"p1", lens.p2},
                                                       {"p2", lens.p1}};
  for (const auto& [name, value] : parameters) {
    text += std::string("          <") + name + ">" + Text(value) + "</" + name + ">\n";
  }
  return text + "        </calibration>\n      </sensor>\n";
}

std::string MetashapeComponent(size_t cameras) {
  std::string ids;
  for (size_t i = 0; i < cameras; ++i) ids += (i == 0 ? "" : " ") + std::to_string(i);
  return "    <components next_id=\"1\" active_id=\"0\">\n"
         "      <component id=\"0\" label=\"Component 1\">\n"
         "        <transform>\n"
         "          <rotation>1 0 0 0 1 0 0 0 1</rotation>\n"
         "          <translation>0 0 0</translation>\n"
         "          <scale>1</scale>\n"
         "        </transform>\n"
         "        <partition>\n"
         "          <camera_ids>" +
         ids +
         "</camera_ids>\n"
         "        </partition>\n"
         "      </component>\n"
         "    </components>\n";
}

std::string MetashapeDocument(const std::vector<View>& views) {
  std::map<size_t, size_t> sensors;  // by lens
  std::string sensor_lines, camera_lines;
  for (size_t i = 0; i < views.size(); ++i) {
    const auto [sensor, is_new] = sensors.emplace(views[i].lens_index, sensors.size());
    if (is_new) sensor_lines += MetashapeSensor(sensor->second, views[i].lens);
    const RowMajor4 chunk_from_cam = ModelFromCam(views[i].cam_from_model);
    camera_lines += "      <camera id=\"" + std::to_string(i) + "\" sensor_id=\"" +
                    std::to_string(sensor->second) + "\" component_id=\"0\" label=\"" +
                    InXml(views[i].stem) + "\">\n        <transform>" +
                    Texts({chunk_from_cam.data(), 16}) +
                    "</transform>\n        <orientation>1</orientation>\n      </camera>\n";
  }
  return "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<document version=\"2.0.0\">\n"
         "  <chunk label=\"Rotunda\" enabled=\"true\">\n    <sensors next_id=\"" +
         std::to_string(sensors.size()) + "\">\n" + sensor_lines + "    </sensors>\n" +
         MetashapeComponent(views.size()) + "    <cameras next_id=\"" +
         std::to_string(views.size()) + "\" next_group_id=\"0\">\n" + camera_lines +
         "    </cameras>\n  </chunk>\n</document>\n";
}

// --- RealityCapture

std::string RealityCaptureXmp(const View& view) {
  const BrownLens& lens = view.lens;
  const double side_px = std::max(lens.width_px, lens.height_px);
  const RowMajor3 rotation = view.cam_from_model.RotationMatrix();
  const Eigen::Vector3d position = view.cam_from_model.OriginInSource();
  const std::array<double, 6> distortion = {lens.k1, lens.k2, lens.k3, 0, lens.p2, lens.p1};
  const std::pair<const char*, std::string> attributes[] = {
      {"Version", "3"},
      {"PosePrior", "locked"},
      {"Coordinates", "absolute"},
      {"DistortionModel", "brown3t2"},
      {"FocalLength35mm", Text(kFilmWidth_mm * lens.fx_px / side_px)},
      {"Skew", "0"},
      {"AspectRatio", Text(lens.fy_px / lens.fx_px)},
      {"PrincipalPointU", Text((lens.cx_px - 0.5 * lens.width_px) / side_px)},
      {"PrincipalPointV", Text((lens.cy_px - 0.5 * lens.height_px) / side_px)},
      {"CalibrationPrior", "exact"},
      {"CalibrationGroup", "-1"},
      {"DistortionGroup", "-1"},
      {"InTexturing", "1"},
      {"InMeshing", "1"}};
  std::string text =
      "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\">\n"
      "  <rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">\n"
      "    <rdf:Description xmlns:xcr=\"http://www.capturingreality.com/ns/xcr/1.1#\"";
  for (const auto& [name, value] : attributes) {
    text += std::string("\n       xcr:") + name + "=\"" + value + "\"";
  }
  text += ">\n      <xcr:Rotation>" + Texts({rotation.data(), 9}) +
          "</xcr:Rotation>\n      <xcr:Position>" + Texts({position.data(), 3}) +
          "</xcr:Position>\n      <xcr:DistortionCoeficients>" + Texts(distortion) +
          "</xcr:DistortionCoeficients>\n    </rdf:Description>\n  </rdf:RDF>\n</x:xmpmeta>\n";
  return text;
}

}  // namespace

Status WriteNerfstudioModel(const Reconstruction& reconstruction,
                            const std::vector<std::string>& image_names, const fs::path& folder) {
  constexpr char kPoints[] = "sparse_pc.ply";
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<View> views, ViewsOf(reconstruction, image_names));
  Json frames = Json::array();
  for (const View& view : views) frames.push_back(NerfstudioFrame(view));
  const Json document = {{"camera_model", "OPENCV"},
                         {"applied_transform", {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}},
                         {"ply_file_path", kPoints},
                         {"frames", std::move(frames)}};
  ROTUNDA_RETURN_IF_ERROR(
      WriteFileAtomically(folder / "transforms.json",
                          document.dump(1, ' ', false, Json::error_handler_t::replace) + "\n"));
  return WritePly(reconstruction, folder / kPoints);
}

Status WriteMetashapeModel(const Reconstruction& reconstruction,
                           const std::vector<std::string>& image_names, const fs::path& folder) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<View> views, ViewsOf(reconstruction, image_names));
  ROTUNDA_RETURN_IF_ERROR(CheckStemsDiffer(views));
  return WriteFileAtomically(folder / "cameras.xml", MetashapeDocument(views));
}

Status WriteRealityCaptureModel(const Reconstruction& reconstruction,
                                const std::vector<std::string>& image_names,
                                const fs::path& folder) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<View> views, ViewsOf(reconstruction, image_names));
  ROTUNDA_RETURN_IF_ERROR(CheckStemsDiffer(views));
  for (const View& view : views) {
    ROTUNDA_RETURN_IF_ERROR(
        WriteFileAtomically(folder / (view.stem + ".xmp"), RealityCaptureXmp(view)));
  }
  return {};
}

}  // namespace rotunda::sfm
