#include "rig/rig_model.h"

#include <algorithm>
#include <cmath>

namespace rotunda::rig {
namespace {

void AddViews(const BoardDetection& detection, size_t camera, size_t shot,
              std::vector<FaceView>& views) {
  for (const BoardCorner& corner : detection.corners) {
    const auto face = static_cast<size_t>(corner.face);
    if (views.empty() || views.back().camera != camera || views.back().shot != shot ||
        views.back().face != face) {
      views.push_back({camera, shot, face, {}});
    }
    views.back().corners.push_back({corner.corner, corner.pixel, corner.sigma_px});
  }
}

}  // namespace

std::vector<FaceView> ViewsOf(const BoardSightings& sightings) {
  std::vector<FaceView> views;
  for (size_t camera = 0; camera < sightings.cameras.size(); ++camera) {
    for (size_t shot = 0; shot < sightings.shots.size(); ++shot) {
      const auto& detection = sightings.sightings[shot][camera].detection;
      if (detection && detection->unusable.empty()) AddViews(*detection, camera, shot, views);
    }
  }
  return views;
}

size_t CornerCount(const std::vector<FaceView>& views) {
  size_t count = 0;
  for (const FaceView& view : views) count += view.corners.size();
  return count;
}

std::vector<FacePrior> DrawnPriors(const Board& board) {
  std::vector<FacePrior> priors;
  for (const CalibratedFace& face : DrawnFaces(board)) {
    priors.push_back(
        {face, board.face_position_sigma_m, board.face_rotation_sigma_rad, board.bow_sigma_m});
  }
  return priors;
}

Eigen::Vector3d FaceMiddle(const BoardFace& face) {
  return {0.5 * face.Width_m(), 0.5 * face.Height_m(), 0};
}

BoardShape ShapeOf(const Board& board) {
  BoardShape shape;
  for (const BoardFace& face : board.faces) {
    auto& corners = shape.emplace_back();
    for (int corner = 0; corner < face.CornerCount(); ++corner) {
      const Eigen::Vector3d in_face = face.CornerInFace(corner);
      corners.push_back({in_face, BowShape(face, in_face.x(), in_face.y())});
    }
  }
  return shape;
}

std::vector<Eigen::Vector2d> Residuals_px(const RigModel& model, const BoardShape& shape,
                                          const FaceView& view) {
  const CalibratedFace& face = model.faces[view.face];
  const CameraIntrinsics& intrinsics = model.intrinsics[view.camera];
  const Rigid3 cam_from_face =
      *model.cam_from_rig[view.camera] * (*model.rig_from_board[view.shot] * face.board_from_face);
  std::vector<Eigen::Vector2d> residuals;
  residuals.reserve(view.corners.size());
  for (const SeenCorner& seen : view.corners) {
    const CornerShape& corner = shape[view.face][static_cast<size_t>(seen.corner)];
    const Eigen::Vector3d in_face =
        corner.in_face - Eigen::Vector3d(0, 0, corner.bow.dot(face.bow_m));
    const auto pixel = intrinsics.Project(cam_from_face * in_face);
    residuals.push_back(pixel ? Eigen::Vector2d(*pixel - seen.pixel)
                              : Eigen::Vector2d::Constant(kBehind_px));
  }
  return residuals;
}

Eigen::Quaterniond RotationOf(const Eigen::Vector3d& turn_rad) {
  const double angle = turn_rad.norm();
  // sin(a/2)/a by its series where the quotient loses digits.
  const double half_sinc =
      angle < 1e-6 ? 0.5 - angle * angle / 48.0 : std::sin(0.5 * angle) / angle;
  Eigen::Quaterniond rotation;
  rotation.w() = std::cos(0.5 * angle);
  rotation.vec() = half_sinc * turn_rad;
  return rotation.normalized();
}

Eigen::Vector3d TurnOf(const Eigen::Quaterniond& rotation) {
  const Eigen::Quaterniond q = rotation.w() < 0 ? Eigen::Quaterniond(-rotation.coeffs()) : rotation;
  const double sine = q.vec().norm();
  if (sine < 1e-12) return 2.0 * q.vec();
  return 2.0 * std::atan2(sine, q.w()) / sine * q.vec();
}

}  // namespace rotunda::rig
