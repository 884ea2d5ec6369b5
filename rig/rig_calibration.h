#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "rig/calibration_start.h"
#include "rig/lens_models.h"
#include "rig/rig_uncertainty.h"
#include "sfm/core/calibration.h"

namespace rotunda::rig {

struct RigCalibrationOptions {
  LensModel model = LensModel::kOpencv;  // of intrinsics that are found
  /// Holds the intrinsics of these cameras, and takes the target's geometry found then as prior.
  const Calibration* intrinsics_from = nullptr;
  /// Rig frame: that of this calibration, by a rigid fit that cameras which moved do not drag;
  /// else as Board::rig_frame says.
  const Calibration* frame_from = nullptr;
  CalibrationStartOptions start;
  /// How many good corners may be lost to the outlier threshold, in all pictures together.
  double lost_corners = 0.5;
  /// A picture with more of its corners beyond the threshold is dropped whole, and a shot with more
  /// of its pictures.
  double max_wrong_corners = 0.5;
  double max_wrong_pictures = 0.3;
  /// When corners fit worse, a shot that disagrees with all others is looked for, and left out.
  double max_rms_px = 1;
  /// A camera with fewer corners is not calibrated.
  size_t min_camera_corners = 24;
};

/// A picture or shot that was left out, and why.
struct DroppedPicture {
  size_t shot = 0;
  std::optional<size_t> camera;  // nullopt: the whole shot
  std::string reason;
};

/// Everything a calibration found. Indices are those of BoardSightings and Board.
struct RigCalibration {
  RigModel model;               // in the rig frame
  std::vector<FaceView> found;  // all corners of usable pictures, without repeated ones
  std::vector<FaceView> kept;   // those that the result stands on
  double noise = 0;             // of the corners, in units of their sigma_px
  /// By camera: that noise, or the camera's own where its corners scatter much more.
  std::vector<double> camera_noise;
  RigUncertainty uncertainty;  // with the cameras' noise
  FreeUnknowns free;
  std::vector<std::string> camera_problem;  // by camera; empty when it is calibrated
  std::vector<std::string> shot_problem;    // by shot; empty when it was used
  std::vector<DroppedPicture> dropped;
  std::vector<FacePrior> priors;
  std::vector<Eigen::MatrixXd> held_intrinsics;  // as AdjustedUnknowns takes them
  std::string frame;  // what the rig frame hangs on: "the target in simulated-1-placement-0"
  /// Why it does not hang on what was set, and what to do; empty when it does.
  std::string frame_problem;
  /// The faces stand otherwise than the board file draws them: they were found from the pictures.
  bool drawing_refused = false;
};

/// Root of the mean squared distance of the kept corners.
double ResidualRms_px(const BoardShape& shape, const RigCalibration& result);

/// kBadInput unless `other` has at least `least` of the cameras: known before anything is solved.
Status CheckShared(const std::vector<SightedCamera>& cameras, const Calibration& other,
                   size_t least);

/// kBadInput unless these cameras' lenses can be taken from `from`: one is in it, and all that are
/// have the same serial numbers and, where it is known, size of pictures. The context is the
/// camera.
Status CheckKeptLenses(const std::vector<SightedCamera>& cameras, const Calibration& from);

/// kBadInput unless the shot that the rig frame is to hang on is among `shots`; the context is the
/// key of the board file. Of no concern where the frame is an earlier calibration's.
Status CheckFrameShot(const std::vector<BoardShot>& shots, const RigFrameSetting& setting);

/// Joint adjustment of all cameras, shots and faces: start, robust rounds, whole pictures and shots
/// that do not fit taken out, then corners beyond the threshold that the noise itself gives, until
/// the set stays the same. Pictures that a camera sent twice count once. Errors name what is
/// missing and shots given twice. The stages reported are "start" and "adjustment".
Result<RigCalibration> CalibrateRig(const Board& board, const BoardSightings& sightings,
                                    const RigCalibrationOptions& options, RunContext& context);

/// One least-squares adjustment from `model`: what cross-validation repeats with a part of the
/// corners.
Result<RigModel> Readjust(const RigProblem& problem, const std::vector<FaceView>& views,
                          const FreeUnknowns& free, const RigModel& model, RunContext& context);

}  // namespace rotunda::rig
