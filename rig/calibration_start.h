#pragma once

#include <optional>
#include <string>
#include <vector>

#include "rig/rig_model.h"
#include "rig/rig_solver.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"

namespace rotunda::rig {

struct CalibrationStartOptions {
  /// A face with fewer corners in a picture gives no pose to start from.
  int min_corners = 8;
  /// Poses of one thing seen twice agree when they differ by less: rotation, and position as a
  /// share of the distance. Several times what a planar pose with a roughly known lens is off.
  double agree_rad = 0.06;
  double agree_share = 0.05;
  /// Above these the drawing's faces are no start: where they are is found from the pictures.
  double max_face_rotation_sigma_rad = 0.1;
  double max_face_position_sigma = 0.1;  // as a share of the face's smaller side
  /// Nor when they leave a larger median error, as a share of the pictures' width, and the faces
  /// on their own much less.
  double max_start_error = 0.005;
};

/// Poses good enough for an adjustment to converge from. What could not be posed says why.
struct CalibrationStart {
  RigModel model;
  std::vector<std::string> camera_problem;  // by camera; empty when it has a pose
  std::vector<std::string> shot_problem;    // by shot
  /// The pictures contradict the drawing's faces: poses come from the pictures alone.
  bool drawing_refused = false;
};

/// What the pictures show of the board, and what is known of the cameras that took them.
struct StartInput {
  const std::vector<FaceView>& views;
  const std::vector<SightedCamera>& cameras;  // for their pictures' sizes
  /// By camera; nullopt: to be found.
  const std::vector<std::optional<CameraIntrinsics>>& known_intrinsics;
};

/// Intrinsics of each camera from all faces it saw (a search over the focal length, then the lens
/// and all poses together), unless they are known; then poses of cameras, shots and, where the
/// drawing does not say, faces by maximum spanning trees over shared sightings, weighted by corners
/// and area. Each link is what most sightings agree on, so that a wrong one, or the other of a
/// plane's two poses, spoils nothing. kFailed when no camera can be posed.
Result<CalibrationStart> StartCalibration(const RigProblem& problem, const StartInput& input,
                                          const CalibrationStartOptions& options,
                                          RunContext& context);

/// Standard deviation of the corners' errors in units of their sigma_px, from the median, which
/// wrong corners do not move.
double NoiseScale(const RigModel& model, const BoardShape& shape,
                  const std::vector<FaceView>& views);

}  // namespace rotunda::rig
