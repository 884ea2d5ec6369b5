#include "rig/calibration_doubts.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "rig/short_number.h"
#include "sfm/core/statistics.h"

namespace rotunda::rig {
namespace {

/// How far the faces stand from the drawing, over what the board file says of that.
struct OffDrawing {
  double sigmas = 0;  // root mean square over faces and axes
  double most_mm = 0;
  std::string face;  // which is off by that
};

OffDrawing FacesOffDrawing(const Board& board, const RigCalibration& result) {
  OffDrawing off;
  double squares = 0;
  size_t faces = 0;
  for (size_t f = 0; f < board.faces.size(); ++f) {
    if (!result.uncertainty.faces[f]) continue;
    const Eigen::Vector3d middle = FaceMiddle(board.faces[f]);
    const double shift_m =
        (result.model.faces[f].board_from_face * middle - board.faces[f].board_from_face * middle)
            .norm();
    squares += shift_m * shift_m;
    ++faces;
    if (1e3 * shift_m <= off.most_mm) continue;
    off.most_mm = 1e3 * shift_m;
    off.face = board.faces[f].name;
  }
  constexpr double kAxes = 3;
  if (faces > 1 && board.face_position_sigma_m > 0) {
    off.sigmas =
        std::sqrt(squares / (kAxes * static_cast<double>(faces))) / board.face_position_sigma_m;
  }
  return off;
}

/// Cameras that read markers, and those of them in whose pictures markers are misplaced.
struct MisplacedMarkers {
  size_t cameras = 0, of = 0;
};

MisplacedMarkers CountMisplaced(const BoardSightings& sightings,
                                const CalibrationDoubtOptions& options) {
  MisplacedMarkers count;
  for (size_t c = 0; c < sightings.cameras.size(); ++c) {
    size_t pictures = 0, misplaced = 0;
    for (const auto& shot : sightings.sightings) {
      const auto& detection = shot[c].detection;
      if (!detection || (detection->markers_found == 0 && detection->rejected.empty())) continue;
      ++pictures;
      misplaced += std::any_of(
          detection->rejected.begin(), detection->rejected.end(),
          [](const RejectedMarker& marker) { return marker.kind == Rejection::kMisplaced; });
    }
    if (pictures == 0) continue;
    ++count.of;
    count.cameras += static_cast<double>(misplaced) >=
                     options.misplaced_pictures * static_cast<double>(pictures);
  }
  return count;
}

/// "scatter 9.6 times ...": against what the same cameras had.
std::string GrowthText(double noise, double earlier, bool lenses_kept) {
  return "the corners scatter " + Number(noise, "%.2f") +
         " times the detector's sigma, in the earlier calibration " + Number(earlier, "%.2f") +
         " times: " +
         (lenses_kept
              ? "its lenses are not those of these pictures (focused anew, exchanged, another "
                "rig), or the target has changed; calibrate from several shots, without the lenses "
                "kept, before looking at single cameras"
              : "something moved while the shots were taken, a lens is loose or out of focus, or "
                "the target is no longer flat and firm; look at the residuals on the page "
                "(--report)");
}

/// Names with what share of their corners they lost, those with most first.
std::string MostLost(const std::vector<CameraCheck>& checks) {
  std::vector<std::pair<double, std::string>> lost;
  for (const CameraCheck& check : checks) {
    if (check.kept > 0) lost.emplace_back(-check.LostShare(), check.camera);
  }
  std::sort(lost.begin(), lost.end());
  constexpr size_t kMostNamed = 5;
  std::string text;
  for (size_t i = 0; i < std::min(kMostNamed, lost.size()); ++i) {
    text += (i == 0 ? "" : ", ") + lost[i].second + " " + Number(-100 * lost[i].first, "%.0f %%");
  }
  return text;
}

/// The greatest difference of halves, over what their sigmas promise, that is no cause for doubt.
double HalfSplitLimit(size_t cameras, const CalibrationDoubtOptions& options) {
  constexpr size_t kMostFreedom = 50;  // beyond, chance has no say in it
  const auto freedom = static_cast<int>(std::clamp<size_t>(cameras, 1, kMostFreedom));
  return std::max(options.max_half_split,
                  std::sqrt(ChiSquareLimit(freedom, options.half_split_chance) / freedom));
}

/// Several shots that do not fit together put the faces anywhere: that is not the drawing's fault.
bool ShotsDisagree(const Board& board, const RigCalibration& result,
                   const CalibrationDoubtOptions& options) {
  const auto& shots = result.model.rig_from_board;
  return std::count_if(shots.begin(), shots.end(), [](const auto& s) { return s.has_value(); }) >
             1 &&
         !result.drawing_refused && ResidualRms_px(ShapeOf(board), result) > options.max_rms_px;
}

}  // namespace

std::string DoubtOnBoard(const Board& board, const BoardSightings& sightings,
                         const RigCalibration* result, const CalibrationDoubtOptions& options) {
  std::string why;
  if (result != nullptr && !ShotsDisagree(board, *result, options)) {
    const OffDrawing off = FacesOffDrawing(board, *result);
    if (result->drawing_refused || off.sigmas > options.max_off_drawing) {
      why = "its faces do not stand as it draws them (face '" + off.face + "' is " +
            Number(off.most_mm, "%.1f mm") + " off, its face_position_sigma_mm is " +
            Number(1e3 * board.face_position_sigma_m, "%g") + ")";
    }
  }
  const MisplacedMarkers markers = CountMisplaced(sightings, options);
  if (markers.cameras >= options.least_misplaced_cameras &&
      static_cast<double>(markers.cameras) >
          options.misplaced_cameras * static_cast<double>(markers.of)) {
    why += (why.empty() ? "" : ", and ") + std::string("in pictures of ") +
           std::to_string(markers.cameras) + " of " + std::to_string(markers.of) +
           " cameras markers are not where it puts them";
  }
  if (why.empty()) return why;
  return "is probably not this target's: " + why +
         "; compare columns, rows, square_mm, first_id and places of the faces with the print "
         "before anything else";
}

std::vector<std::string> DoubtsOnFit(const Calibration& calibration,
                                     const std::vector<CameraCheck>& checks,
                                     const Calibration* earlier,
                                     const CalibrationDoubtOptions& options) {
  const CalibrationResiduals& residuals = *calibration.residuals;
  std::vector<std::string> doubts;
  if (earlier != nullptr && earlier->residuals &&
      residuals.noise > options.max_noise_growth * earlier->residuals->noise) {
    const CalibratedCamera& camera = calibration.cameras[0];
    const CalibratedCamera* then = earlier->Find(camera.camera);
    const bool kept = then != nullptr && then->intrinsics.params == camera.intrinsics.params;
    doubts.push_back(GrowthText(residuals.noise, earlier->residuals->noise, kept));
  }
  if (residuals.rms_px > options.max_rms_px) {
    doubts.push_back(
        "the corners fit no better than " + Number(residuals.rms_px, "%.2f px") +
        ", expected at most " + Number(options.max_rms_px, "%.0f px") +
        ": is the target firm and flat, did it and the cameras stand still, and are all "
        "shots of one rig and one target?");
  }
  const double halves = std::max(residuals.half_split_rotation_ratio.value_or(0),
                                 residuals.half_split_position_ratio.value_or(0));
  if (halves > HalfSplitLimit(calibration.cameras.size(), options)) {
    doubts.push_back("calibrations from either half of the corners differ by " +
                     Number(halves, "%.1f") +
                     " times what the uncertainties say, which are too small by as much: something "
                     "is not as described (lenses, target) or moved between the shots");
  }
  size_t fitting = 0, kept = 0;
  for (const CameraCheck& check : checks) {
    fitting += check.kept > 0 ? check.fitting : 0;
    kept += check.kept;
  }
  const double lost = 1 - static_cast<double>(kept) / static_cast<double>(fitting);
  if (lost > options.max_lost) {
    doubts.push_back(Number(100 * lost, "%.0f %%") +
                     " of the corners do not fit and were thrown away (most: " + MostLost(checks) +
                     "): what is left may fit by chance; look at the pictures of these cameras");
  }
  return doubts;
}

}  // namespace rotunda::rig
