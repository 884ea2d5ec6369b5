#include "rig/calibration_checks.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "rig/picture_misfits.h"
#include "rig/short_number.h"

namespace rotunda::rig {
namespace {

size_t CellOf(const Eigen::Vector2d& pixel, const CameraIntrinsics& intrinsics,
              const CalibrationCheckOptions& options) {
  const auto place = [](double x, double size, int cells) {
    return std::clamp(static_cast<int>(x / size * cells), 0, cells - 1);
  };
  return static_cast<size_t>(place(pixel.y(), intrinsics.height_px, options.cells_down) *
                                 options.cells_across +
                             place(pixel.x(), intrinsics.width_px, options.cells_across));
}

/// Share of a part's cells that hold a corner; the part is given in thirds of the picture.
double CoveredPart(const CameraCheck& check, bool rows, int third,
                   const CalibrationCheckOptions& options) {
  int cells = 0, covered = 0;
  for (int row = 0; row < options.cells_down; ++row) {
    for (int column = 0; column < options.cells_across; ++column) {
      const int place = rows ? 3 * row / options.cells_down : 3 * column / options.cells_across;
      if (place != third) continue;
      ++cells;
      covered += check.cells[static_cast<size_t>(row * options.cells_across + column)] > 0;
    }
  }
  return static_cast<double>(covered) / std::max(1, cells);
}

/// A border third of the picture.
struct PicturePart {
  bool rows;
  int third;
  const char* name;
  Eigen::Vector2d towards;  // it, from the picture's middle
};

/// How to bring the target into a part of a camera's picture. Which way is up there, the camera's
/// pose says: cameras stand upside down and on their side, too.
std::string RemedyFor(const PicturePart& part, const Rigid3& cam_from_rig) {
  constexpr double kLeastUp = 0.3;  // sine: what looks straight up or down sees no way up
  constexpr double kAlong = 0.7;    // cosine of 45 deg
  const Eigen::Vector2d up = (cam_from_rig.rotation * Eigen::Vector3d::UnitZ()).head<2>();
  if (up.norm() > kLeastUp) {
    const double upwards = part.towards.dot(up.normalized());
    if (upwards > kAlong) return "raise the target, or tilt it";
    if (upwards < -kAlong) return "lower the target, or tilt it";
  }
  return "shift or turn the target";
}

/// What to do about parts of the picture with hardly a corner.
void AdviseCoverage(const Rigid3& cam_from_rig, const CalibrationCheckOptions& options,
                    CameraCheck& check) {
  const std::array<PicturePart, 4> parts = {{{true, 0, "upper", {0, -1}},
                                             {true, 2, "lower", {0, 1}},
                                             {false, 0, "left", {-1, 0}},
                                             {false, 2, "right", {1, 0}}}};
  for (const PicturePart& part : parts) {
    const double covered = CoveredPart(check, part.rows, part.third, options);
    if (covered >= options.min_covered) continue;
    check.advice.push_back(std::string(covered > 0 ? "few corners" : "no corner") + " in its " +
                           part.name + " third: " + RemedyFor(part, cam_from_rig) +
                           " in another shot, so that it appears there");
  }
}

/// What to do about what the corners leave uncertain. With lenses that are kept, corners need not
/// cover the picture, but must still hold the camera's pose.
void AdviseUncertainty(const RigCalibration& result, size_t camera,
                       const CalibrationCheckOptions& options, CameraCheck& check) {
  const auto& uncertainty = result.uncertainty.cameras[camera];
  if (!uncertainty) return;
  const CameraIntrinsics& lens = result.model.intrinsics[camera];
  const double focal_px = lens.MeanFocal_px();
  if (result.free.intrinsics && uncertainty->sigma.focal_px &&
      *uncertainty->sigma.focal_px > options.max_focal_sigma * focal_px) {
    check.advice.push_back("its focal length is uncertain by " +
                           Number(100 * *uncertainty->sigma.focal_px / focal_px, "%.2f %%") +
                           ": show it two faces at a time, or the target at other distances");
  }
  if (uncertainty->projection_max_px <= options.max_projection_px) return;
  const bool fewer = result.free.intrinsics && lens.model == CameraModel::kFullOpencv;
  check.advice.push_back("a point may appear " + Number(uncertainty->projection_max_px, "%.2f px") +
                         " off somewhere in its picture: take more shots with corners there" +
                         (fewer ? ", or find fewer lens parameters (--model opencv)" : ""));
}

/// Sums over the kept corners into the cameras' checks: how many, by cell too, their residuals by
/// cell, and in `rms_px` the squares. Returns the root mean square of all.
double SumKept(const BoardShape& shape, const RigCalibration& result,
               const CalibrationCheckOptions& options, std::vector<CameraCheck>& checks) {
  std::vector<std::set<size_t>> shots(checks.size());
  double squares = 0;
  for (const FaceView& view : result.kept) {
    CameraCheck& check = checks[view.camera];
    const auto residuals = Residuals_px(result.model, shape, view);
    for (size_t i = 0; i < residuals.size(); ++i) {
      const size_t cell =
          CellOf(view.corners[i].pixel, result.model.intrinsics[view.camera], options);
      ++check.cells[cell];
      check.mean_px[cell] += residuals[i];
      check.rms_px += residuals[i].squaredNorm();
      squares += residuals[i].squaredNorm();
    }
    check.kept += view.corners.size();
    shots[view.camera].insert(view.shot);
  }
  for (size_t c = 0; c < checks.size(); ++c) checks[c].pictures = shots[c].size();
  return std::sqrt(squares / static_cast<double>(CornerCount(result.kept)));
}

}  // namespace

double CameraCheck::LostShare() const {
  return 1 - static_cast<double>(kept) / static_cast<double>(fitting);
}

std::vector<CameraCheck> CheckCameras(const Board& board, const BoardSightings& sightings,
                                      const RigCalibration& result,
                                      const CalibrationCheckOptions& options) {
  const auto cells = static_cast<size_t>(options.cells_across * options.cells_down);
  CameraCheck unseen;
  unseen.cells.assign(cells, 0);
  unseen.mean_px.assign(cells, Eigen::Vector2d::Zero());
  std::vector<CameraCheck> checks(sightings.cameras.size(), unseen);
  for (const FaceView& view : result.found) {
    checks[view.camera].found += view.corners.size();
    if (!IsLeftOut(result.dropped, view)) checks[view.camera].fitting += view.corners.size();
  }
  const double rms_px = SumKept(ShapeOf(board), result, options, checks);
  for (size_t c = 0; c < checks.size(); ++c) {
    CameraCheck& check = checks[c];
    check.camera = sightings.cameras[c].camera;
    if (check.kept == 0) continue;
    check.rms_px = std::sqrt(check.rms_px / static_cast<double>(check.kept));
    for (size_t i = 0; i < cells; ++i) {
      check.mean_px[i] /= static_cast<double>(std::max<size_t>(1, check.cells[i]));
      check.covered += check.cells[i] > 0 ? 1.0 / static_cast<double>(cells) : 0.0;
    }
    if (result.free.intrinsics) AdviseCoverage(*result.model.cam_from_rig[c], options, check);
    AdviseUncertainty(result, c, options, check);
    if (check.rms_px > options.max_rms_ratio * rms_px) {
      check.advice.push_back("its corners fit " + Number(check.rms_px / rms_px, "%.1f") +
                             " times worse than the rig's: check its focus, and that it is fixed");
    }
    if (check.LostShare() > options.max_lost_of_camera) {
      check.advice.push_back(
          "more than " + Number(100 * options.max_lost_of_camera, "%.0f %%") +
          " of its corners do not fit and were thrown away: look at its pictures "
          "for what hides or mirrors the target, and check its focus");
    }
  }
  return checks;
}

}  // namespace rotunda::rig
