#pragma once

#include <optional>
#include <vector>

#include "rig/calibration_start.h"

namespace rotunda::rig {

/// Faces that are known relative to each other: all of a board as drawn, or one.
struct Body {
  std::vector<size_t> faces;
  std::vector<Rigid3> body_from_face;  // parallel to `faces`
};

/// A camera's pose relative to a body, and how well it explains the body's corners.
struct PoseHypothesis {
  Rigid3 cam_from_body;
  double error_px = 0;  // root mean square, each corner's error capped
};

/// Poses of a camera for what it saw of one body in one shot: the best, and the other ones that
/// explain the corners nearly as well (a plane has two). Empty when there are too few corners.
std::vector<PoseHypothesis> PoseHypotheses(const RigProblem& problem, const Body& body,
                                           const std::vector<const FaceView*>& views,
                                           const CameraIntrinsics& intrinsics, int min_corners);

/// Intrinsics (OPENCV) of one camera from its views: one list for each shot and body. nullopt when
/// no view has enough corners.
struct BodyViews {
  size_t body = 0;
  std::vector<const FaceView*> views;
};
std::optional<CameraIntrinsics> StartLens(const RigProblem& problem,
                                          const std::vector<Body>& bodies,
                                          const std::vector<BodyViews>& seen, int width_px,
                                          int height_px, const CalibrationStartOptions& options);

}  // namespace rotunda::rig
