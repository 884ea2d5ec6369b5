#include "tests/support/projected_corners.h"

#include <cmath>

#include "rig/sim/board_object.h"
#include "rig/sim/noise.h"
#include "rig/sim/rig_options.h"
#include "sfm/core/alignment.h"
#include "sfm/core/run_context.h"

namespace rotunda::test {

rig::BoardDetection ProjectView(const ProjectedRig& rig, const CalibratedCamera& camera,
                                const Rigid3& rig_from_board, const ProjectedOptions& options,
                                uint64_t seed) {
  rig::BoardDetection detection;
  sim::Random random(seed);
  const Rigid3 cam_from_board = camera.cam_from_rig * rig_from_board;
  for (size_t f = 0; f < rig.board.faces.size(); ++f) {
    const rig::BoardFace& face = rig.board.faces[f];
    const CalibratedFace& real = rig.truth.board[f];
    const Rigid3 cam_from_face = cam_from_board * real.board_from_face;
    for (int c = 0; c < face.CornerCount(); ++c) {
      const Eigen::Vector3d x =
          cam_from_board * rig::PointOnBoard(face, real, face.CornerInFace(c));
      const double cosine = (cam_from_face.rotation * Eigen::Vector3d::UnitZ()).dot(x.normalized());
      const auto pixel = camera.intrinsics.Project(x);
      if (cosine < std::cos(RadFromDeg(options.max_slant_deg))) continue;
      if (!pixel || !camera.intrinsics.Contains(*pixel)) continue;
      const double sigma_px = options.noise_px / std::sqrt(cosine);
      const Eigen::Vector2d noise(sigma_px * random.Normal(), sigma_px * random.Normal());
      const bool missed = random.Uniform() > options.detected_share;
      const bool wrong = random.Chance(options.wrong_share);
      const Eigen::Vector2d off(random.Uniform(-1, 1), random.Uniform(-1, 1));
      if (missed) continue;
      const double half_square_px = 0.5 * camera.intrinsics.MeanFocal_px() * face.square_m / x.z();
      detection.corners.push_back({static_cast<int>(f), c,
                                   *pixel + noise + (wrong ? half_square_px : 0.0) * off,
                                   sigma_px});
    }
  }
  return detection;
}

ProjectedRig ProjectCorners(const ProjectedOptions& options) {
  return ProjectCorners(options,
                        sim::DrawRig({}, options.rig_seed, options.cameras, options.picture_scale));
}

ProjectedRig ProjectCorners(const ProjectedOptions& options, const Calibration& truth) {
  ProjectedRig rig;
  rig.board = rig::CuboidBoard({});
  rig.truth = truth;
  rig.truth.board = sim::DrawBoard(rig.board, options.board_errors, options.rig_seed);
  for (const CalibratedCamera& camera : rig.truth.cameras) {
    rig.sightings.cameras.push_back(
        {camera.camera, camera.serial, camera.intrinsics.width_px, camera.intrinsics.height_px});
  }
  for (int s = 0; s < options.shots; ++s) {
    rig.rig_from_board.push_back(sim::BoardPlacement(options.first_placement + s));
    rig.sightings.shots.push_back({"shot " + std::to_string(s), {}});
    auto& row = rig.sightings.sightings.emplace_back();
    for (size_t c = 0; c < rig.truth.cameras.size(); ++c) {
      const uint64_t seed = DeriveSeed(DeriveSeed(options.noise_seed, static_cast<uint64_t>(s)), c);
      row.push_back(
          {"", ProjectView(rig, rig.truth.cameras[c], rig.rig_from_board.back(), options, seed),
           ""});
    }
  }
  return rig;
}

double BoardError_mm(const rig::Board& board, const std::vector<CalibratedFace>& found,
                     const std::vector<CalibratedFace>& truth) {
  std::vector<Eigen::Vector3d> from, to;
  for (size_t f = 0; f < board.faces.size(); ++f) {
    for (int c = 0; c < board.faces[f].CornerCount(); ++c) {
      const Eigen::Vector3d in_face = board.faces[f].CornerInFace(c);
      from.push_back(rig::PointOnBoard(board.faces[f], found[f], in_face));
      to.push_back(rig::PointOnBoard(board.faces[f], truth[f], in_face));
    }
  }
  const Result<Sim3> fit = FitSim3(from, to, false);
  if (!fit) return INFINITY;
  double sum = 0;
  for (size_t i = 0; i < from.size(); ++i) sum += (*fit * from[i] - to[i]).squaredNorm();
  return 1e3 * std::sqrt(sum / static_cast<double>(from.size()));
}

}  // namespace rotunda::test
