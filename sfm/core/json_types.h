#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "sfm/core/calibration.h"
#include "sfm/core/camera.h"
#include "sfm/core/json_reader.h"
#include "sfm/core/rigid3.h"

// Private to the .cc files of this folder: no public header shows the JSON library.

namespace rotunda {

/// Keys in the order in which they were set, one field a line (indented by one space), arrays of
/// numbers or strings on one line, doubles so that reading gives the same bits, a newline at the
/// end. Bytes that are not UTF-8 become U+FFFD.
std::string JsonText(const nlohmann::ordered_json& value);

/// The pieces that calibration.json and poses.json share. The writers add to or make an object, the
/// readers record what is wrong in the field's reader.
void AddIntrinsics(const CameraIntrinsics& intrinsics, nlohmann::ordered_json& object);
CameraIntrinsics ReadIntrinsics(const JsonField& object);
nlohmann::ordered_json Rigid3Json(const Rigid3& transform);
Rigid3 ReadRigid3(const JsonField& field);
nlohmann::ordered_json SigmaJson(const PoseSigma& sigma);
/// Refuses negative numbers: of standard deviations and lengths of errors.
double ReadNotNegative(const JsonField& field);
PoseSigma ReadSigma(const JsonField& field);

}  // namespace rotunda
