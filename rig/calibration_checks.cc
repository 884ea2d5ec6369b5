#include "rig/calibration_checks.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <set>

#include "rig/calibration_comparison.h"
#include "rig/calibration_result.h"

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

std::string Number(double value, const char* format) {
  char text[32];
  std::snprintf(text, sizeof(text), format, value);
  return text;
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

/// Of a calibrated camera, in its pictures that were used.
double LostShare(const CameraCheck& check) {
  return 1 - static_cast<double>(check.kept) / static_cast<double>(check.fitting);
}

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
                                const CalibrationCheckOptions& options) {
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
std::string MostLost(const Calibration& calibration, const std::vector<CameraCheck>& checks) {
  std::vector<std::pair<double, std::string>> lost;
  for (const CameraCheck& check : checks) {
    if (check.kept == 0) continue;
    lost.emplace_back(-LostShare(check), calibration.cameras[lost.size()].camera);
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
double HalfSplitLimit(size_t cameras, const CalibrationCheckOptions& options) {
  constexpr size_t kMostFreedom = 50;  // beyond, chance has no say in it
  const auto freedom = static_cast<int>(std::clamp<size_t>(cameras, 1, kMostFreedom));
  return std::max(options.max_half_split,
                  std::sqrt(ChiSquareLimit(freedom, options.half_split_chance) / freedom));
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

using Chooser = std::function<bool(const FaceView&, const SeenCorner&)>;

std::vector<FaceView> Chosen(const std::vector<FaceView>& views, const Chooser& choose) {
  std::vector<FaceView> chosen;
  for (const FaceView& view : views) {
    FaceView some = view;
    std::erase_if(some.corners, [&](const SeenCorner& corner) { return !choose(view, corner); });
    if (!some.corners.empty()) chosen.push_back(std::move(some));
  }
  return chosen;
}

/// The model without what the views do not show.
RigModel SeenIn(const std::vector<FaceView>& views, const RigModel& model, size_t min_corners) {
  std::vector<size_t> cameras(model.cam_from_rig.size(), 0);
  std::set<size_t> shots;
  for (const FaceView& view : views) {
    cameras[view.camera] += view.corners.size();
    shots.insert(view.shot);
  }
  RigModel seen = model;
  for (size_t c = 0; c < cameras.size(); ++c) {
    if (cameras[c] < min_corners) seen.cam_from_rig[c].reset();
  }
  for (size_t s = 0; s < seen.rig_from_board.size(); ++s) {
    if (shots.count(s) == 0) seen.rig_from_board[s].reset();
  }
  return seen;
}

/// A calibration that is divided into parts, and how: by shots, else by corners.
struct Division {
  const RigProblem& problem;
  const RigCalibration& result;
  bool by_shots = false;
  size_t shots_used = 0;
  std::vector<size_t> order = {};  // of a used shot among the used ones

  /// Part `which` of `parts`.
  Chooser Part(size_t which, size_t parts) const {
    return [this, which, parts](const FaceView& view, const SeenCorner& corner) {
      const size_t place = by_shots ? order[view.shot] : static_cast<size_t>(corner.corner);
      return place % parts == which;
    };
  }
};

Division Divide(const RigProblem& problem, const RigCalibration& result) {
  constexpr size_t kMinShots = 4;
  Division division = {problem, result};
  for (const auto& shot : result.model.rig_from_board) {
    division.order.push_back(division.shots_used);
    division.shots_used += shot.has_value();
  }
  division.by_shots = division.shots_used >= kMinShots;
  return division;
}

/// Squared errors of what `held` chooses under a calibration from the rest, in pixels.
Result<std::vector<double>> HeldOutErrors(const Division& division, const Chooser& held,
                                          RunContext& context) {
  const RigProblem& problem = division.problem;
  const RigCalibration& result = division.result;
  const auto rest =
      Chosen(result.kept, [&](const FaceView& v, const SeenCorner& c) { return !held(v, c); });
  const RigModel start = SeenIn(rest, result.model, RigCalibrationOptions().min_camera_corners);
  ROTUNDA_ASSIGN_OR_RETURN(RigModel model, Readjust(problem, rest, result.free, start, context));
  const auto test = Chosen(result.kept, held);
  if (division.by_shots) {
    for (size_t s = 0; s < model.rig_from_board.size(); ++s) {
      if (!model.rig_from_board[s]) model.rig_from_board[s] = result.model.rig_from_board[s];
    }
    const FreeUnknowns shots_alone = {
        .cameras = false, .intrinsics = false, .shots = true, .faces = false};
    ROTUNDA_ASSIGN_OR_RETURN(model, Readjust(problem, test, shots_alone, model, context));
  }
  std::vector<double> squared_px;
  for (const FaceView& view : test) {
    if (!model.Has(view)) continue;
    for (const Eigen::Vector2d& residual : Residuals_px(model, problem.shape, view)) {
      squared_px.push_back(residual.squaredNorm());
    }
  }
  return squared_px;
}

/// `squared_px` is not empty.
void SummarizeHeldOut(std::vector<double> squared_px, CrossValidation& validation) {
  validation.held_out_corners = squared_px.size();
  double sum = 0;
  for (const double squared : squared_px) sum += squared;
  validation.held_out_rms_px = std::sqrt(sum / static_cast<double>(squared_px.size()));
  const auto p95 =
      squared_px.begin() + static_cast<std::ptrdiff_t>(95 * (squared_px.size() - 1) / 100);
  std::nth_element(squared_px.begin(), p95, squared_px.end());
  validation.held_out_p95_px = std::sqrt(*p95);
}

/// A half's cameras with their covariances, as a calibration to compare.
Result<Calibration> CalibrateHalf(const Division& division, size_t which, RunContext& context) {
  const RigProblem& problem = division.problem;
  const RigCalibration& result = division.result;
  const auto views = Chosen(result.kept, division.Part(which, 2));
  RigCalibration half;
  half.model = SeenIn(views, result.model, RigCalibrationOptions().min_camera_corners);
  ROTUNDA_ASSIGN_OR_RETURN(half.model, Readjust(problem, views, result.free, half.model, context));
  ROTUNDA_ASSIGN_OR_RETURN(half.uncertainty,
                           BuildUncertainty(problem, WithNoise(views, result.noise), half.model,
                                            {result.free, result.held_intrinsics}, context));
  Calibration calibration;
  for (size_t c = 0; c < half.model.cam_from_rig.size(); ++c) {
    if (!half.model.cam_from_rig[c] || !half.uncertainty.cameras[c]) continue;
    CalibratedCamera camera;
    char name[24];
    std::snprintf(name, sizeof(name), "%08zu", c);  // any names in order
    camera.camera = name;
    camera.intrinsics = half.model.intrinsics[c];
    camera.cam_from_rig = *half.model.cam_from_rig[c];
    camera.sigma = half.uncertainty.cameras[c]->sigma;
    camera.covariance = half.uncertainty.cameras[c]->covariance;
    calibration.cameras.push_back(std::move(camera));
  }
  return calibration;
}

void CompareHalves(const Calibration& first, const Calibration& second,
                   CrossValidation& validation) {
  const Result<CalibrationComparison> comparison = CompareCalibrations(first, second, {});
  if (!comparison) return;
  double rotation = 0, position = 0;
  for (const CameraChange& change : comparison->cameras) {
    const PoseSigma& a = *first.Find(change.camera)->sigma;
    const PoseSigma& b = *second.Find(change.camera)->sigma;
    rotation += std::pow(change.rotation_deg, 2) /
                (std::pow(a.rotation_deg, 2) + std::pow(b.rotation_deg, 2));
    position +=
        std::pow(change.position_mm, 2) / (std::pow(a.position_mm, 2) + std::pow(b.position_mm, 2));
    validation.half_rotation_deg += change.rotation_deg;
    validation.half_position_mm += change.position_mm;
  }
  const auto count = static_cast<double>(comparison->cameras.size());
  validation.rotation_ratio = std::sqrt(rotation / count);
  validation.position_ratio = std::sqrt(position / count);
  validation.half_rotation_deg /= count;
  validation.half_position_mm /= count;
}

/// A camera with a pose, as the file has it; `c` is its place.
CalibratedCamera CameraOf(const SightedCamera& sighted, size_t c, const CameraCheck& check,
                          const RigCalibration& result) {
  const CameraUncertainty& uncertainty = *result.uncertainty.cameras[c];
  CalibratedCamera camera;
  camera.camera = sighted.camera;
  camera.serial = sighted.serial;
  camera.intrinsics = result.model.intrinsics[c];
  camera.cam_from_rig = *result.model.cam_from_rig[c];
  camera.sigma = uncertainty.sigma;
  camera.covariance = uncertainty.covariance;
  camera.fit = CameraFit{check.found, check.kept, check.rms_px, uncertainty.projection_mean_px,
                         uncertainty.projection_max_px};
  return camera;
}

}  // namespace

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
    if (LostShare(check) > options.max_lost_of_camera) {
      check.advice.push_back(
          "more than " + Number(100 * options.max_lost_of_camera, "%.0f %%") +
          " of its corners do not fit and were thrown away: look at its pictures "
          "for what hides or mirrors the target, and check its focus");
    }
  }
  return checks;
}

std::string DoubtOnBoard(const Board& board, const BoardSightings& sightings,
                         const RigCalibration* result, const CalibrationCheckOptions& options) {
  std::string why;
  if (result != nullptr) {
    const OffDrawing off = FacesOffDrawing(board, *result);
    if (result->drawing_refused || off.sigmas > options.max_off_drawing) {
      why = "its faces do not stand as it draws them (face '" + off.face + "' is " +
            Number(off.most_mm, "%.1f mm") + " off, its face_position_sigma_mm is " +
            Number(1e3 * board.face_position_sigma_m, "%g") + ")";
    }
  }
  const MisplacedMarkers markers = CountMisplaced(sightings, options);
  if (static_cast<double>(markers.cameras) >
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
                                     const CalibrationCheckOptions& options) {
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
    doubts.push_back("the corners fit no better than " + Number(residuals.rms_px, "%.2f px") +
                     ", expected at most " + Number(options.max_rms_px, "%.0f px") +
                     ": is the target firm and flat, and did it and the cameras stand still?");
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
    doubts.push_back(
        Number(100 * lost, "%.0f %%") +
        " of the corners do not fit and were thrown away (most: " + MostLost(calibration, checks) +
        "): what is left may fit by chance; look at the pictures of these cameras");
  }
  return doubts;
}

Result<CrossValidation> CrossValidate(const Board& board, const RigCalibration& result,
                                      const CalibrationCheckOptions& options, RunContext& context) {
  const BoardShape shape = ShapeOf(board);
  const RigProblem problem = {board, shape, result.priors};
  const Division division = Divide(problem, result);
  CrossValidation validation;
  validation.by_shots = division.by_shots;
  const size_t folds =
      division.by_shots ? std::min(static_cast<size_t>(options.folds), division.shots_used) : 2;
  std::vector<double> squared_px;
  for (size_t fold = 0; fold < folds; ++fold) {
    context.Report("cross-validation", fold, folds + 2);
    ROTUNDA_ASSIGN_OR_RETURN(const std::vector<double> some,
                             HeldOutErrors(division, division.Part(fold, folds), context));
    squared_px.insert(squared_px.end(), some.begin(), some.end());
  }
  std::vector<Calibration> halves;
  for (size_t half = 0; half < 2; ++half) {
    context.Report("cross-validation", folds + half, folds + 2);
    auto calibration = CalibrateHalf(division, half, context);
    if (!calibration && calibration.error().code == ErrorCode::kCancelled) {
      return calibration.error();
    }
    if (calibration) halves.push_back(std::move(*calibration));
  }
  if (halves.size() == 2) CompareHalves(halves[0], halves[1], validation);
  context.Report("cross-validation", folds + 2, folds + 2);
  if (!squared_px.empty()) SummarizeHeldOut(std::move(squared_px), validation);
  return validation;
}

Calibration ToCalibration(const Board& board, const BoardSightings& sightings,
                          const RigCalibration& result, const CrossValidation* validation) {
  Calibration calibration;
  calibration.source = CalibrationSource::kCharuco;
  const auto checks = CheckCameras(board, sightings, result, {});
  double squares = 0;
  for (size_t c = 0; c < sightings.cameras.size(); ++c) {
    if (!result.model.cam_from_rig[c]) continue;
    calibration.cameras.push_back(CameraOf(sightings.cameras[c], c, checks[c], result));
    squares += std::pow(checks[c].rms_px, 2) * static_cast<double>(checks[c].kept);
  }
  for (size_t f = 0; f < board.faces.size(); ++f) {
    if (!result.uncertainty.faces[f]) continue;
    CalibratedFace face = result.model.faces[f];
    face.print = PrintOf(board.faces[f]);
    const FaceUncertainty& sigma = *result.uncertainty.faces[f];
    face.sigma = FaceSigma{sigma.rotation_deg, sigma.position_mm, sigma.bow_mm};
    calibration.board.push_back(std::move(face));
  }
  CalibrationResiduals residuals;
  residuals.corners = CornerCount(result.found);
  residuals.kept = CornerCount(result.kept);
  residuals.rms_px = std::sqrt(squares / static_cast<double>(residuals.kept));
  residuals.noise = result.noise;
  if (validation != nullptr) {
    residuals.held_out_rms_px = validation->held_out_rms_px;
    residuals.held_out_p95_px = validation->held_out_p95_px;
    residuals.half_split_rotation_ratio = validation->rotation_ratio;
    residuals.half_split_position_ratio = validation->position_ratio;
  }
  calibration.residuals = residuals;
  return calibration;
}

}  // namespace rotunda::rig
