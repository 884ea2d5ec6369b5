#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "sfm/core/camera.h"
#include "sfm/core/result.h"
#include "sfm/core/rigid3.h"

namespace rotunda {

/// One standard deviation of a camera's pose (root of the trace over the axes) and focal length.
struct PoseSigma {
  double rotation_deg = 0.0;
  double position_mm = 0.0;
  std::optional<double> focal_px;
};

/// One camera of a calibration; the rig frame is in metres (sfm/core/CONVENTIONS.md).
struct CalibratedCamera {
  std::string camera;
  std::string serial;
  CameraIntrinsics intrinsics;
  Rigid3 cam_from_rig;
  std::optional<PoseSigma> sigma;
};

/// A face of the calibration target as it really is. Which target, and what bow means, is the
/// rig's business (rig/board.h).
struct CalibratedFace {
  std::string face;
  Rigid3 board_from_face;
  Eigen::Vector2d bow_m = Eigen::Vector2d::Zero();
};

enum class CalibrationSource { kCharuco, kSfm, kTruth };

/// What calibration.json and truth.json hold. Cameras are sorted by name.
struct Calibration {
  std::string id;
  std::string created_at;  // RFC 3339
  CalibrationSource source = CalibrationSource::kCharuco;
  std::vector<CalibratedCamera> cameras;
  std::vector<CalibratedFace> board;  // in the order of the board's file; empty: not known

  /// nullptr when there is no such camera.
  const CalibratedCamera* Find(std::string_view camera) const;
};

inline constexpr char kCalibrationFormat[] = "rotunda-calibration/1";

std::string CalibrationToJson(const Calibration& calibration);
/// `source` names the text in errors. Refuses: wrong format version, missing or mistyped fields, an
/// unknown model, a wrong number of parameters, values that are not finite, a rotation whose norm
/// is off 1 by more than 1e-6, a camera or a face twice.
Result<Calibration> CalibrationFromJson(const std::string& text, const std::string& source);
Result<Calibration> ReadCalibration(const std::filesystem::path& file);
/// Writes to a temporary file beside `file`, fsyncs and renames.
Status WriteCalibration(const Calibration& calibration, const std::filesystem::path& file);

}  // namespace rotunda
