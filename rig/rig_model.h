#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "rig/board.h"
#include "rig/board_sightings.h"
#include "sfm/core/calibration.h"
#include "sfm/core/camera.h"
#include "sfm/core/rigid3.h"

namespace rotunda::rig {

/// A corner as one camera saw it.
struct SeenCorner {
  int corner = 0;  // as in BoardFace::CornerInFace
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double sigma_px = 1;
};

/// What one camera saw of one face in one shot.
struct FaceView {
  size_t camera = 0;  // places in BoardSightings::cameras, ::shots and Board::faces
  size_t shot = 0;
  size_t face = 0;
  std::vector<SeenCorner> corners;
};

/// The corners of all usable detections, sorted by camera, shot and face; none is empty.
std::vector<FaceView> ViewsOf(const BoardSightings& sightings);

size_t CornerCount(const std::vector<FaceView>& views);

/// All that calibration solves for. Cameras and shots that could not be posed have no pose.
struct RigModel {
  std::vector<CameraIntrinsics> intrinsics;  // by camera
  std::vector<std::optional<Rigid3>> cam_from_rig;
  std::vector<std::optional<Rigid3>> rig_from_board;  // by shot
  std::vector<CalibratedFace> faces;                  // by face

  bool Has(const FaceView& view) const {
    return cam_from_rig[view.camera] && rig_from_board[view.shot];
  }
};

/// What is known of a face before the pictures: one standard deviation of its middle, of each
/// rotation and of each part of its bow. Infinite: nothing; 0: it is held.
struct FacePrior {
  CalibratedFace face;
  double position_sigma_m = 0;
  double rotation_sigma_rad = 0;
  double bow_sigma_m = 0;
};

/// The drawing as prior.
std::vector<FacePrior> DrawnPriors(const Board& board);

/// Middle of a face's squares, in its frame.
Eigen::Vector3d FaceMiddle(const BoardFace& face);

/// A corner's place on the flat face and what a unit of bow does to its height (BowShape).
struct CornerShape {
  Eigen::Vector3d in_face;
  Eigen::Vector2d bow;
};

/// By face and corner.
using BoardShape = std::vector<std::vector<CornerShape>>;
BoardShape ShapeOf(const Board& board);

/// Reprojection errors of a view's corners (pixels, predicted minus seen), in their order; kBehind
/// for a corner behind the camera. The view's camera and shot have poses.
inline constexpr double kBehind_px = 1e4;
std::vector<Eigen::Vector2d> Residuals_px(const RigModel& model, const BoardShape& shape,
                                          const FaceView& view);

/// The exponential map of SO(3).
Eigen::Quaterniond RotationOf(const Eigen::Vector3d& turn_rad);
/// Its inverse; the angle is in [0, pi].
Eigen::Vector3d TurnOf(const Eigen::Quaterniond& rotation);

}  // namespace rotunda::rig
