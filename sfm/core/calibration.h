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

/// How a camera's corners fitted, and how far a point of the rig frame may be off in its picture.
struct CameraFit {
  size_t corners = 0;             // found
  size_t kept = 0;                // of them, not outliers
  double rms_px = 0;              // of the kept ones
  double projection_mean_px = 0;  // one standard deviation over the picture
  double projection_max_px = 0;
};

/// One camera of a calibration; the rig frame is in metres (sfm/core/CONVENTIONS.md).
struct CalibratedCamera {
  std::string camera;
  std::string serial;
  CameraIntrinsics intrinsics;
  Rigid3 cam_from_rig;
  std::optional<PoseSigma> sigma = std::nullopt;
  /// Of the turn (left tangent of cam_from_rig, radians, camera axes), the centre (rig frame,
  /// metres) and the intrinsics' parameters, relative to the rigid fit of all camera centres.
  std::optional<Eigen::MatrixXd> covariance = std::nullopt;
  std::optional<CameraFit> fit = std::nullopt;
};

/// One standard deviation of a face (roots of the traces), relative to the rigid fit of all faces.
struct FaceSigma {
  double rotation_deg = 0;
  double position_mm = 0;  // of its middle
  double bow_mm = 0;
};

/// What is printed on a face: squares, and markers in every other one.
struct FacePrint {
  int columns = 0, rows = 0;  // squares
  double square_mm = 0, marker_mm = 0;
  std::string dictionary;
  int first_id = 0;
  bool legacy_pattern = false;  // of no effect with odd rows
};

/// A face of the calibration target as it really is. Which target, and what bow means, is the
/// rig's business (rig/board.h).
struct CalibratedFace {
  std::string face;
  Rigid3 board_from_face;
  Eigen::Vector2d bow_m = Eigen::Vector2d::Zero();
  std::optional<FaceSigma> sigma = std::nullopt;
  std::optional<FacePrint> print = std::nullopt;  // absent: the calibration does not say
};

/// How a calibration's corners fitted altogether.
struct CalibrationResiduals {
  size_t corners = 0;  // found
  size_t kept = 0;     // of them, not outliers
  double rms_px = 0;   // of the kept ones, root of the mean squared distance
  double noise = 0;    // their standard deviation over the one the detector claims
  /// Of corners that the calibration was not fitted to; absent when it was not tried.
  std::optional<double> held_out_rms_px, held_out_p95_px;
  /// Root mean square over cameras of (difference of two half calibrations / its sigma).
  std::optional<double> half_split_rotation_ratio, half_split_position_ratio;
};

enum class CalibrationSource { kCharuco, kSfm, kTruth };

/// What calibration.json and truth.json hold. Cameras are sorted by name.
struct Calibration {
  std::string id;
  std::string created_at;  // RFC 3339
  CalibrationSource source = CalibrationSource::kCharuco;
  std::vector<CalibratedCamera> cameras;
  std::vector<CalibratedFace> board;  // in the order of the board's file; empty: not known
  std::optional<CalibrationResiduals> residuals;

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
