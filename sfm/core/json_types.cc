#include "sfm/core/json_types.h"

#include <algorithm>
#include <cmath>

namespace rotunda {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kMaxNormError = 1e-6;
/// Below this a norm differs from 1 by rounding alone, and the numbers are kept as they are, so
/// that writing what was read gives the same text.
constexpr double kRoundingNormError = 1e-14;

std::string Scalar(const Json& value) {
  return value.dump(-1, ' ', false, Json::error_handler_t::replace);
}

bool OnOneLine(const Json& value) {
  return value.empty() ||
         (value.is_array() && std::all_of(value.begin(), value.end(),
                                          [](const Json& item) { return item.is_primitive(); }));
}

void AppendText(const Json& value, size_t indent, std::string& text) {
  if (value.is_primitive() || OnOneLine(value)) {
    text += Scalar(value);
    return;
  }
  const bool is_object = value.is_object();
  text += is_object ? '{' : '[';
  const char* separator = "\n";
  for (auto item = value.begin(); item != value.end(); ++item) {
    text += separator + std::string(indent + 1, ' ');
    if (is_object) text += Scalar(Json(item.key())) + ": ";
    AppendText(*item, indent + 1, text);
    separator = ",\n";
  }
  text += '\n' + std::string(indent, ' ') + (is_object ? '}' : ']');
}

}  // namespace

std::string JsonText(const Json& value) {
  std::string text;
  AppendText(value, 0, text);
  return text + '\n';
}

void AddIntrinsics(const CameraIntrinsics& intrinsics, Json& object) {
  object["width"] = intrinsics.width_px;
  object["height"] = intrinsics.height_px;
  object["model"] = CameraModelName(intrinsics.model);
  object["params"] = intrinsics.params;
}

CameraIntrinsics ReadIntrinsics(const JsonField& object) {
  CameraIntrinsics intrinsics;
  intrinsics.width_px = static_cast<int>(object["width"].Unsigned(1, kMaxPictureSide_px));
  intrinsics.height_px = static_cast<int>(object["height"].Unsigned(1, kMaxPictureSide_px));
  const Result<CameraModel> model = CameraModelFromName(object["model"].String());
  if (!model) {
    object["model"].Fail(model.error().message);
    return intrinsics;
  }
  intrinsics.model = *model;
  intrinsics.params = object["params"].Numbers(CameraParamCount(*model));
  if (const Status status = intrinsics.Validate(); !status) {
    object["params"].Fail(status.error().message);
  }
  return intrinsics;
}

Json Rigid3Json(const Rigid3& transform) {
  const Eigen::Quaterniond& q = transform.rotation;
  const Eigen::Vector3d& t = transform.translation;
  Json object;
  object["rotation_wxyz"] = {q.w(), q.x(), q.y(), q.z()};
  object["translation_m"] = {t.x(), t.y(), t.z()};
  return object;
}

Rigid3 ReadRigid3(const JsonField& field) {
  const std::vector<double> q = field["rotation_wxyz"].Numbers(4);
  const std::vector<double> t = field["translation_m"].Numbers(3);
  Rigid3 transform{Eigen::Quaterniond(q[0], q[1], q[2], q[3]), Eigen::Vector3d(t[0], t[1], t[2])};
  const double norm_error = std::abs(transform.rotation.norm() - 1.0);
  if (!(norm_error <= kMaxNormError)) {
    field["rotation_wxyz"].Fail("expected a quaternion of norm 1, found norm " +
                                Scalar(Json(transform.rotation.norm())));
  } else if (norm_error > kRoundingNormError) {
    transform.rotation.normalize();
  }
  return transform;
}

Json SigmaJson(const PoseSigma& sigma) {
  Json object;
  object["rotation_deg"] = sigma.rotation_deg;
  object["position_mm"] = sigma.position_mm;
  if (sigma.focal_px) object["focal_px"] = *sigma.focal_px;
  return object;
}

double ReadNotNegative(const JsonField& field) {
  const double value = field.Number();
  if (value < 0) field.Refuse("a number of at least 0");
  return value;
}

PoseSigma ReadSigma(const JsonField& field) {
  PoseSigma sigma;
  sigma.rotation_deg = ReadNotNegative(field["rotation_deg"]);
  sigma.position_mm = ReadNotNegative(field["position_mm"]);
  if (field["focal_px"].present()) sigma.focal_px = ReadNotNegative(field["focal_px"]);
  return sigma;
}

}  // namespace rotunda
