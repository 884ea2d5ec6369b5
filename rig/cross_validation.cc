#include "rig/cross_validation.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <set>

#include "rig/calibration_comparison.h"

namespace rotunda::rig {
namespace {

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
  ROTUNDA_ASSIGN_OR_RETURN(
      half.uncertainty, BuildUncertainty(problem, WithNoise(views, result.camera_noise), half.model,
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

}  // namespace

Result<CrossValidation> CrossValidate(const Board& board, const RigCalibration& result,
                                      const CrossValidationOptions& options, RunContext& context) {
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

}  // namespace rotunda::rig
