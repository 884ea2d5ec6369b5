#include "tests/bench/calibration_real.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "config/board_config.h"
#include "rig/calibration_comparison.h"
#include "tests/bench/bench_process.h"
#include "tests/bench/calibration_mrcal.h"
#include "tests/bench/calibration_run.h"

namespace rotunda::bench {
namespace {

RealFit PrintFit(const rig::Board& board, const TimedSightings& timed, const CalibrationRun& run) {
  const rig::BoardSightings& sightings = timed.sightings;
  size_t shots = 0;
  for (const auto& shot : run.result.model.rig_from_board) shots += shot.has_value();
  const CalibrationResiduals& residuals = *run.file.residuals;
  const auto share = [](size_t part, size_t of) {
    return static_cast<double>(part) / static_cast<double>(of);
  };
  const RealFit fit = {residuals.rms_px, share(residuals.kept, residuals.corners),
                       std::min(share(run.file.cameras.size(), sightings.cameras.size()),
                                share(shots, sightings.shots.size())),
                       DoubtsOn(board, sightings, run)};
  std::printf("  cameras %zu of %zu, shots %zu of %zu, kept %zu of %zu corners (%.1f %%)\n",
              run.file.cameras.size(), sightings.cameras.size(), shots, sightings.shots.size(),
              residuals.kept, residuals.corners, 100 * fit.kept);
  std::printf(
      "  RMS %.3f px, held-out RMS %.3f px, P95 %.3f px; noise %.2f times the detector's sigma; "
      "halves over sigma: rotation %.2f, position %.2f\n",
      residuals.rms_px, run.validation.held_out_rms_px.value_or(NAN),
      run.validation.held_out_p95_px.value_or(NAN), run.result.noise,
      run.validation.rotation_ratio.value_or(NAN), run.validation.position_ratio.value_or(NAN));
  std::printf("  time: %s%s\n", timed.TimeText().c_str(), run.times.c_str());
  for (const std::string& doubt : fit.doubts) std::printf("  doubt: %s\n", doubt.c_str());
  return fit;
}

/// The faces as found, against the drawing.
void PrintFaces(const rig::Board& board, const CalibrationRun& run) {
  for (const CalibratedFace& face : run.file.board) {
    for (const CalibratedFace& drawn : rig::DrawnFaces(board)) {
      if (drawn.face != face.face) continue;
      const Rigid3 change = drawn.board_from_face.Inverse() * face.board_from_face;
      std::printf(
          "  %-8s %.2f mm, %.2f deg from its drawing (sigma %.3f mm, %.3f deg), bow %.3f "
          "%.3f mm\n",
          face.face.c_str(), 1e3 * change.translation.norm(),
          DegFromRad(RotationAngle_rad(change.rotation, Eigen::Quaterniond::Identity())),
          face.sigma->position_mm, face.sigma->rotation_deg, 1e3 * face.bow_m.x(),
          1e3 * face.bow_m.y());
    }
  }
}

/// mrcal's cameras with the covariances that such a calibration has by ours.
Calibration AsCalibration(const MrcalOutcome& peer, const CalibrationRun& run) {
  Calibration calibration = run.file;
  for (size_t c = 0; c < calibration.cameras.size(); ++c) {
    calibration.cameras[c].intrinsics = peer.cameras[c].intrinsics;
    calibration.cameras[c].cam_from_rig = peer.cameras[c].cam_from_first;
  }
  return calibration;
}

/// Mean distance between where both put the corners that a camera saw.
double ProjectionDifference_px(const CalibrationRun& run, size_t camera,
                               const CalibratedCamera& theirs, const Rigid3& theirs_from_ours) {
  const CalibratedCamera& ours = run.file.cameras[camera];
  const Rigid3 peer_from_cam = theirs.cam_from_rig * theirs_from_ours * ours.cam_from_rig.Inverse();
  double sum = 0;
  size_t count = 0;
  for (const rig::FaceView& view : run.result.kept) {
    if (view.camera != camera) continue;
    const double distance_m =
        (ours.cam_from_rig * run.result.model.rig_from_board[view.shot]->translation).z();
    for (const rig::SeenCorner& corner : view.corners) {
      const auto ray = ours.intrinsics.NormalizedFromPixel(corner.pixel);
      if (!ray) continue;
      const auto other = theirs.intrinsics.Project(
          peer_from_cam * Eigen::Vector3d(distance_m * ray->homogeneous()));
      if (!other) continue;
      sum += (*other - corner.pixel).norm();
      ++count;
    }
  }
  return sum / static_cast<double>(count);
}

/// Returns the greatest difference over both sigmas.
double CompareWithMrcal(const rig::Board& board, const rig::BoardSightings& sightings,
                        const CalibrationRun& run, const std::string& lens_model) {
  const MrcalOutcome peer = RunMrcal(board, sightings, run.result.kept, lens_model,
                                     run.file.cameras[0].intrinsics.MeanFocal_px());
  const Calibration theirs = AsCalibration(peer, run);
  const auto comparison = OrDie(rig::CompareCalibrations(run.file, theirs, {}));
  std::printf("  mrcal %s: %s%.1f s\n", lens_model.c_str(), peer.summary.c_str(), peer.seconds);
  std::printf(
      "    camera   focal/px ours  mrcal     difference, sigma   pose: difference/deg, mm    sigma/"
      "deg, mm   points/px: difference where seen, sigma over the picture\n");
  const double both = std::sqrt(2.0);
  double greatest = 0;
  for (size_t c = 0; c < run.file.cameras.size(); ++c) {
    const CalibratedCamera& ours = run.file.cameras[c];
    const rig::CameraChange& change = comparison.cameras[c];
    const double focal_px = theirs.cameras[c].intrinsics.MeanFocal_px();
    std::printf(
        "    %-8s %12.2f %9.2f %10.2f %6.2f %19.4f %7.3f %12.4f %7.3f %18.3f %8.3f\n",
        ours.camera.c_str(), ours.intrinsics.MeanFocal_px(), focal_px,
        ours.intrinsics.MeanFocal_px() - focal_px, both * ours.sigma->focal_px.value_or(0),
        change.rotation_deg, change.position_mm, both * ours.sigma->rotation_deg,
        both * ours.sigma->position_mm,
        ProjectionDifference_px(run, c, theirs.cameras[c], comparison.before_from_after.Inverse()),
        both * ours.fit->projection_mean_px);
    const double difference_px = std::abs(ours.intrinsics.MeanFocal_px() - focal_px);
    greatest = std::max({greatest, difference_px / (both * ours.sigma->focal_px.value_or(0)),
                         change.rotation_deg / (both * ours.sigma->rotation_deg),
                         change.position_mm / (both * ours.sigma->position_mm)});
  }
  return greatest;
}

}  // namespace

std::optional<RealFit> BenchReal(const std::filesystem::path& board_file,
                                 const std::filesystem::path& folder, ThreadPool& threads) {
  std::printf("\nReal: %s\n", folder.filename().c_str());
  if (!std::filesystem::exists(folder)) {
    std::printf("  left out: %s is not there\n", folder.c_str());
    return std::nullopt;
  }
  const rig::Board board = OrDie(config::ReadBoard(board_file));
  const TimedSightings timed = Detect(folder, board, threads);
  const CalibrationRun run = Calibrate(board, timed.sightings, {}, threads);
  RealFit fit = PrintFit(board, timed, run);
  if (board.faces.size() > 1) {
    PrintFaces(board, run);
    return fit;
  }
  CompareWithMrcal(board, timed.sightings, run, "LENSMODEL_OPENCV4");
  std::printf("  with k3 (--model opencv5)\n");
  const CalibrationRun with_k3 =
      Calibrate(board, timed.sightings, {.model = rig::LensModel::kOpencv5}, threads);
  PrintFit(board, timed, with_k3);
  fit.peer_sigmas = CompareWithMrcal(board, timed.sightings, with_k3, "LENSMODEL_OPENCV5");
  return fit;
}

}  // namespace rotunda::bench
