#pragma once

#include <optional>
#include <vector>

#include "rig/rig_model.h"
#include "rig/rig_solver.h"

namespace rotunda::rig {

/// Faces that are known relative to each other: all of a board as drawn, or one.
struct Body {
  std::vector<size_t> faces;
  std::vector<Rigid3> body_from_face;  // parallel to `faces`
};

/// The faces that a camera sees, and what poses are looked for with.
struct BodySearch {
  const RigProblem& problem;
  const std::vector<Body>& bodies;
  int min_corners = 0;  // of a face in a picture that gives a pose
};

/// What a camera saw of one body in one shot.
struct BodyViews {
  size_t body = 0;  // place in BodySearch::bodies
  std::vector<const FaceView*> views;
};

/// A camera's pose relative to a body, and how well it explains the body's corners.
struct PoseHypothesis {
  Rigid3 cam_from_body;
  double error_px = 0;  // root mean square, each corner's error capped
};

/// Poses of a camera for one picture of a body: the best, and the other ones that explain the
/// corners nearly as well (a plane has two). Empty when there are too few corners.
std::vector<PoseHypothesis> PoseHypotheses(const BodySearch& search, const BodyViews& picture,
                                           const CameraIntrinsics& intrinsics);

/// Intrinsics (OPENCV) of one camera from all its pictures. nullopt when none has enough corners.
std::optional<CameraIntrinsics> StartLens(const BodySearch& search,
                                          const std::vector<BodyViews>& seen,
                                          const SightedCamera& camera);

}  // namespace rotunda::rig
