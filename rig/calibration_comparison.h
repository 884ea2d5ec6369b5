#pragma once

#include <optional>
#include <string>
#include <vector>

#include "sfm/core/calibration.h"
#include "sfm/core/result.h"

namespace rotunda::rig {

struct CalibrationComparisonOptions {
  /// Probability that a comparison of two calibrations of an unchanged rig names any camera as
  /// moved; and again that it names any lens.
  double false_alarm = 5e-4;
  /// Standard deviations of a camera whose calibration does not say them; only their ratio matters,
  /// the cameras' scatter gives the scale.
  double default_rotation_deg = 0.005;
  double default_position_mm = 0.15;
};

/// What changed of one camera, after the rigid alignment.
struct CameraChange {
  std::string camera;
  double rotation_deg = 0;
  double position_mm = 0;
  /// Root of the change's squared Mahalanobis distance over its six degrees of freedom: about 1
  /// when nothing changed. The cameras' scatter is counted in, unless that is of two rigs.
  double sigmas = 0;
  bool moved = false;
  std::optional<std::string> swapped_with;  // the camera in whose place it stands
  double focal_percent = 0;
  /// As `sigmas`, of the lens' parameters (of the focal length alone where models differ or one
  /// calibration has no covariances): 0 when it was kept, absent when sigmas are missing.
  std::optional<double> lens_sigmas;
  bool lens_changed = false;
  bool other_serial = false;
  std::optional<PoseSigma> sigma_before, sigma_after;  // what the calibrations say
};

/// Warmth and lens models that are not quite right scatter the cameras of one rig by a few times
/// their sigmas; what scatters more is another rig, or a calibration that is wrong.
inline constexpr double kOtherRig = 6.0;

struct CalibrationComparison {
  Rigid3 before_from_after;           // rig frames
  std::vector<CameraChange> cameras;  // in both, by name
  std::vector<std::string> only_before, only_after;
  /// Of `only_before`: cameras that took part in the later shots and could not be calibrated. What
  /// the calibrations themselves do not say; the caller's.
  std::vector<std::string> not_calibrated;
  /// Cameras scatter this much more than their sigmas say (1: as they say); taken into account.
  double inflation = 1;
  double lens_inflation = 1;  // the same of lenses
  /// Of CameraChange::sigmas, before it counts as moved; of two rigs: before it stands out.
  double sigmas_limit = 0;
  /// All distances between cameras grew by this share alike, by much more than they scatter; 0 when
  /// they did not.
  double growth = 0;
  std::string target_change;  // TargetChange of the two

  bool SameRig() const { return inflation <= kOtherRig; }
};

/// The rigid motion between two calibrations' rig frames that most cameras agree on. kBadInput with
/// no common camera.
Result<Rigid3> AlignRigs(const Calibration& before, const Calibration& after,
                         const CalibrationComparisonOptions& options);

inline constexpr size_t kMinComparedCameras = 3;  // in both: fewer do not tell who moved

/// Which cameras moved between two calibrations: those whose change, relative to the rest, is
/// beyond what both calibrations' covariances and the number of cameras explain. Likewise which
/// lenses changed. kBadInput below kMinComparedCameras common cameras.
Result<CalibrationComparison> CompareCalibrations(const Calibration& before,
                                                  const Calibration& after,
                                                  const CalibrationComparisonOptions& options);

/// "moved, lens changed"; empty when the camera is as it was.
std::string VerdictOn(const CameraChange& change);

/// What an operator is to know, a sentence each: that the two are not of one rig, cameras that
/// moved, were swapped or exchanged,
/// lenses that changed, cameras that are in one of both only. Empty when all is as it was.
std::vector<std::string> ChangesIn(const CalibrationComparison& comparison);

}  // namespace rotunda::rig
