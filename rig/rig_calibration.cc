#include "rig/rig_calibration.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <utility>

#include "rig/calibration_comparison.h"
#include "rig/picture_misfits.h"
#include "rig/short_number.h"

namespace rotunda::rig {
namespace {

/// Loss scale over the noise: errors up to about this many sigmas pull with nearly full weight.
constexpr double kLossSigmas = 3.0;

/// The drawing, or what the earlier calibration found where it knows the face.
std::vector<FacePrior> PriorsOf(const Board& board, const Calibration* earlier) {
  std::vector<FacePrior> priors = DrawnPriors(board);
  if (earlier == nullptr) return priors;
  for (FacePrior& prior : priors) {
    for (const CalibratedFace& face : earlier->board) {
      if (face.face != prior.face.face || !face.sigma) continue;
      constexpr double kPerAxis = 0.57735;  // one of three axes, of the root of the trace
      prior.face = face;
      prior.position_sigma_m =
          std::min(prior.position_sigma_m, kPerAxis * 1e-3 * face.sigma->position_mm);
      prior.rotation_sigma_rad =
          std::min(prior.rotation_sigma_rad, kPerAxis * RadFromDeg(face.sigma->rotation_deg));
      prior.bow_sigma_m = std::min(prior.bow_sigma_m, kPerAxis * 1e-3 * face.sigma->bow_mm);
    }
  }
  return priors;
}

std::string SizeText(int width_px, int height_px) {
  return std::to_string(width_px) + "x" + std::to_string(height_px);
}

Status CheckKeptLens(const SightedCamera& camera, const Calibration& from) {
  const CalibratedCamera* earlier = from.Find(camera.camera);
  const auto refused = [&](const std::string& why) {
    return Error{ErrorCode::kBadInput, why, camera.camera};
  };
  if (earlier == nullptr) return {};  // it is left out
  if (!camera.serial.empty() && !earlier->serial.empty() && camera.serial != earlier->serial) {
    return refused("has serial " + camera.serial + ", in the earlier calibration " +
                   earlier->serial +
                   ": cameras were exchanged or swapped, so their intrinsics cannot be kept");
  }
  const CameraIntrinsics& lens = earlier->intrinsics;
  if (camera.width_px > 0 &&
      (camera.width_px != lens.width_px || camera.height_px != lens.height_px)) {
    return refused("has pictures of " + SizeText(camera.width_px, camera.height_px) +
                   " pixels, expected " + SizeText(lens.width_px, lens.height_px) +
                   " as in the earlier calibration: set width_px and height_px as they were then, "
                   "or calibrate without keeping intrinsics");
  }
  return {};
}

Result<std::vector<std::optional<CameraIntrinsics>>> KnownIntrinsics(
    const BoardSightings& sightings, const Calibration* from) {
  std::vector<std::optional<CameraIntrinsics>> known(sightings.cameras.size());
  if (from == nullptr) return known;
  ROTUNDA_RETURN_IF_ERROR(CheckKeptLenses(sightings.cameras, *from));
  for (size_t c = 0; c < known.size(); ++c) {
    const CalibratedCamera* earlier = from->Find(sightings.cameras[c].camera);
    if (earlier != nullptr) known[c] = earlier->intrinsics;
  }
  return known;
}

/// Covariances of the intrinsics that are kept, by camera; empty where the calibration has none.
std::vector<Eigen::MatrixXd> HeldIntrinsics(const BoardSightings& sightings,
                                            const Calibration* from) {
  std::vector<Eigen::MatrixXd> held;
  if (from == nullptr) return held;
  for (const SightedCamera& camera : sightings.cameras) {
    const CalibratedCamera* earlier = from->Find(camera.camera);
    held.emplace_back();
    if (earlier == nullptr || !earlier->covariance) continue;
    const Eigen::Index params = earlier->covariance->rows() - kPoseSize;
    held.back() = earlier->covariance->bottomRightCorner(params, params);
  }
  return held;
}

/// Cameras of which the calibration that lenses are kept from knows none: their views are taken
/// out, since a shot or two do not give a lens.
std::vector<size_t> TakeUnknown(const BoardSightings& sightings, const Calibration* from,
                                std::vector<FaceView>& views) {
  std::vector<size_t> unknown;
  if (from == nullptr) return unknown;
  for (size_t c = 0; c < sightings.cameras.size(); ++c) {
    if (from->Find(sightings.cameras[c].camera) == nullptr) unknown.push_back(c);
  }
  std::erase_if(views, [&](const FaceView& view) {
    return std::binary_search(unknown.begin(), unknown.end(), view.camera);
  });
  return unknown;
}

/// What the start found; faces that do not stand as drawn are no longer held to the drawing.
void TakeStart(CalibrationStart start, size_t shots, RigCalibration& result) {
  result.model = std::move(start.model);
  result.model.rig_from_board.resize(shots);
  result.camera_problem = std::move(start.camera_problem);
  result.shot_problem = std::move(start.shot_problem);
  result.shot_problem.resize(shots, "no camera saw the board");
  result.drawing_refused = start.drawing_refused;
  if (!start.drawing_refused) return;
  for (FacePrior& prior : result.priors) {
    prior.position_sigma_m = prior.rotation_sigma_rad = std::numeric_limits<double>::infinity();
  }
}

/// Parameters of the larger model, those it adds being 0.
void ExtendModel(LensModel model, RigModel& rig) {
  if (model == LensModel::kOpencv) return;
  for (CameraIntrinsics& intrinsics : rig.intrinsics) {
    if (intrinsics.model != CameraModel::kOpencv) continue;
    intrinsics.model = CameraModel::kFullOpencv;
    intrinsics.params.resize(CameraParamCount(intrinsics.model), 0.0);
  }
}

/// Robust rounds from the start: poses first, then everything, the loss following the noise down.
Status AdjustRobustly(const RigProblem& problem, const std::vector<FaceView>& views, LensModel lens,
                      RigCalibration& result, RunContext& context) {
  constexpr int kMostRounds = 10;
  constexpr double kSettled = 0.02;  // change of the noise from round to round
  RigSolveOptions options;
  options.function_tolerance = 1e-4;
  options.max_iterations = 15;
  options.free = result.free;
  options.free.intrinsics = options.free.faces = false;
  RigModel& model = result.model;
  double noise = NoiseScale(model, problem.shape, views);
  for (int round = 0; round < kMostRounds; ++round) {
    options.loss_scale = kLossSigmas * noise;
    context.Report("adjustment", static_cast<size_t>(round), kMostRounds + 2);
    ROTUNDA_RETURN_IF_ERROR(SolveRig(problem, views, options, model, context));
    const double now = NoiseScale(model, problem.shape, views);
    const bool settled = std::abs(now - noise) < kSettled * noise;
    noise = now;
    if (round == 0) {
      if (result.free.intrinsics) ExtendModel(lens, model);
      options.free = result.free;
      options.function_tolerance = 1e-5;
    } else if (settled) {
      break;
    }
  }
  return {};
}

/// Views of posed cameras and shots, with the corners within `limit` sigmas.
std::vector<FaceView> Within(const RigModel& model, const BoardShape& shape,
                             const std::vector<FaceView>& views, double limit) {
  std::vector<FaceView> kept;
  for (const FaceView& view : views) {
    if (!model.Has(view)) continue;
    const auto residuals = Residuals_px(model, shape, view);
    FaceView some = view;
    some.corners.clear();
    for (size_t i = 0; i < residuals.size(); ++i) {
      if (residuals[i].norm() <= limit * view.corners[i].sigma_px) {
        some.corners.push_back(view.corners[i]);
      }
    }
    if (!some.corners.empty()) kept.push_back(std::move(some));
  }
  return kept;
}

/// Takes the poses of cameras with too few corners and of shots with none.
void DropUnseen(const std::vector<FaceView>& kept, size_t min_corners, RigCalibration& result) {
  std::vector<size_t> by_camera(result.model.cam_from_rig.size(), 0);
  std::vector<size_t> by_shot(result.model.rig_from_board.size(), 0);
  for (const FaceView& view : kept) by_camera[view.camera] += view.corners.size();
  for (size_t c = 0; c < by_camera.size(); ++c) {
    if (!result.model.cam_from_rig[c] || by_camera[c] >= min_corners) continue;
    result.model.cam_from_rig[c].reset();
    result.camera_problem[c] = "only " + std::to_string(by_camera[c]) +
                               " corners that fit, expected at least " +
                               std::to_string(min_corners) + ": show this camera more of the board";
  }
  for (const FaceView& view : kept) {
    if (result.model.cam_from_rig[view.camera]) by_shot[view.shot] += view.corners.size();
  }
  for (size_t s = 0; s < by_shot.size(); ++s) {
    if (!result.model.rig_from_board[s] || by_shot[s] > 0) continue;
    result.model.rig_from_board[s].reset();
    if (result.shot_problem[s].empty()) result.shot_problem[s] = "no picture of it fits";
  }
}

/// What was left out and why, each reason once.
std::string Reasons(const RigCalibration& result) {
  std::map<std::string, size_t> counts;
  for (const DroppedPicture& dropped : result.dropped) {
    ++counts[(dropped.camera ? "a picture " : "a shot: ") + dropped.reason];
  }
  for (const std::string& problem : result.camera_problem) {
    if (!problem.empty()) ++counts["a camera: " + problem];
  }
  std::string text;
  for (const auto& [reason, count] : counts) {
    text += "; " + std::to_string(count) + " x " + reason;
  }
  return text;
}

/// Least squares over the corners within the threshold, until the set stays the same.
Status AdjustFinally(const RigProblem& problem, const std::vector<FaceView>& views,
                     const RigCalibrationOptions& options, RigCalibration& result,
                     RunContext& context) {
  constexpr int kMostRounds = 6;
  const double sigmas = ThresholdSigmas(CornerCount(views), options.lost_corners);
  size_t before = SIZE_MAX;
  for (int round = 0; round < kMostRounds; ++round) {
    const double noise = NoiseScale(result.model, problem.shape, views);
    result.kept = Within(result.model, problem.shape, views, sigmas * noise);
    DropUnseen(result.kept, options.min_camera_corners, result);
    std::erase_if(result.kept, [&](const FaceView& view) { return !result.model.Has(view); });
    if (result.kept.empty()) {
      return Error{ErrorCode::kFailed,
                   "no camera sees enough corners that fit together" + Reasons(result), ""};
    }
    if (CornerCount(result.kept) == before) break;
    before = CornerCount(result.kept);
    ROTUNDA_ASSIGN_OR_RETURN(result.model,
                             Readjust(problem, result.kept, result.free, result.model, context));
  }
  return {};
}

/// Why pictures could not be used: how many of each kind ("blurred: ..."), and the first one's
/// words.
class PictureReasons {
 public:
  void Add(const BoardSighting& sighting) {
    const std::string& reason = !sighting.detection ? sighting.missing
                                : sighting.detection->unusable.empty()
                                    ? sighting.detection->few_markers
                                    : sighting.detection->unusable;
    if (reason.empty()) return;
    auto& [count, first] = kinds_[reason.substr(0, reason.find(':'))];
    if (count++ == 0) first = reason;
  }
  std::string Text() const {
    std::string text;
    for (const auto& [kind, reasons] : kinds_) {
      text += "; " + std::to_string(reasons.first) + " x " + reasons.second;
    }
    return text;
  }

 private:
  std::map<std::string, std::pair<size_t, std::string>> kinds_;
};

size_t MostCornersOfAFace(const BoardDetection& detection) {
  std::map<int, size_t> by_face;
  size_t most = 0;
  for (const BoardCorner& corner : detection.corners) {
    most = std::max(most, ++by_face[corner.face]);
  }
  return most;
}

/// How much was read of the board in a camera's best picture; empty when that is enough, or when
/// there are no pictures.
std::string TooFewRead(const BoardSightings& sightings, size_t camera, size_t min_corners) {
  const BoardDetection* best = nullptr;
  size_t shot = 0;
  for (size_t s = 0; s < sightings.shots.size(); ++s) {
    const auto& detection = sightings.sightings[s][camera].detection;
    if (!detection) continue;
    const auto worth = [](const BoardDetection& d) {
      return std::pair(MostCornersOfAFace(d), d.markers_found);
    };
    if (best != nullptr && worth(*detection) <= worth(*best)) continue;
    best = &*detection;
    shot = s;
  }
  if (best == nullptr || MostCornersOfAFace(*best) >= min_corners) return "";
  return "; at best, in " + sightings.shots[shot].id + ", " + std::to_string(best->markers_found) +
         " of the board's markers were read and " + std::to_string(MostCornersOfAFace(*best)) +
         " corners of a face found, expected at least " + std::to_string(min_corners) +
         " corners: is the target in its view, near, evenly lit and in focus?";
}

/// Tells of cameras and shots without a pose what was wrong with their pictures.
void ExplainMissing(const BoardSightings& sightings, size_t min_corners, RigCalibration& result) {
  for (size_t c = 0; c < sightings.cameras.size(); ++c) {
    PictureReasons reasons;
    for (const auto& row : sightings.sightings) reasons.Add(row[c]);
    if (result.model.cam_from_rig[c]) continue;
    result.camera_problem[c] += TooFewRead(sightings, c, min_corners) + reasons.Text();
  }
  for (size_t s = 0; s < sightings.shots.size(); ++s) {
    PictureReasons reasons;
    for (const BoardSighting& sighting : sightings.sightings[s]) reasons.Add(sighting);
    if (!result.model.rig_from_board[s]) result.shot_problem[s] += reasons.Text();
  }
}

Status CheckSightings(const BoardSightings& sightings, const std::vector<FaceView>& views) {
  if (!views.empty()) return {};
  size_t pictures = 0;
  PictureReasons reasons;
  for (const auto& shot : sightings.sightings) {
    for (const BoardSighting& sighting : shot) {
      ++pictures;
      reasons.Add(sighting);
    }
  }
  return Error{ErrorCode::kBadInput,
               "no picture of " + std::to_string(pictures) + " shows the board" +
                   (reasons.Text().empty() ? ": is it the one of the board file, is it large "
                                             "enough in them, and are they not mirrored?"
                                           : reasons.Text()),
               ""};
}

Calibration AsCalibration(const RigCalibration& result, const BoardSightings& sightings) {
  Calibration calibration;
  for (size_t c = 0; c < sightings.cameras.size(); ++c) {
    if (!result.model.cam_from_rig[c]) continue;
    CalibratedCamera camera;
    camera.camera = sightings.cameras[c].camera;
    camera.serial = sightings.cameras[c].serial;
    camera.intrinsics = result.model.intrinsics[c];
    camera.cam_from_rig = *result.model.cam_from_rig[c];
    calibration.cameras.push_back(std::move(camera));
  }
  return calibration;
}

/// The rig's noise, or a camera's own where its corners scatter much more: a lens out of focus.
std::vector<double> CameraNoise(const BoardShape& shape, const RigCalibration& result) {
  constexpr double kOwn = 1.5;  // times the rig's; chance makes 1.3 of 24 corners
  const size_t cameras = result.model.cam_from_rig.size();
  std::vector<double> squares(cameras, 0), count(cameras, 0);
  for (const FaceView& view : result.kept) {
    const auto residuals = Residuals_px(result.model, shape, view);
    for (size_t i = 0; i < residuals.size(); ++i) {
      squares[view.camera] += residuals[i].squaredNorm() / std::pow(view.corners[i].sigma_px, 2);
      count[view.camera] += 2;
    }
  }
  std::vector<double> noise(cameras, result.noise);
  for (size_t c = 0; c < cameras; ++c) {
    if (count[c] == 0) continue;
    const double own = std::sqrt(squares[c] / count[c]);
    if (own > kOwn * result.noise) noise[c] = own;
  }
  return noise;
}

/// With the noise of the kept corners. The error names the cameras that are not determined.
Result<RigUncertainty> UncertaintyOf(const RigProblem& problem, const BoardSightings& sightings,
                                     const RigCalibration& result, RunContext& context) {
  const std::vector<FaceView> views = WithNoise(result.kept, result.camera_noise);
  Result<RigUncertainty> uncertainty = BuildUncertainty(
      problem, views, result.model, {result.free, result.held_intrinsics}, context);
  if (uncertainty || uncertainty.error().code != ErrorCode::kFailed) return uncertainty;
  std::string names;
  for (const size_t c : UndeterminedCameras(problem, views, result.model, result.free, context)) {
    names += (names.empty() ? "" : ", ") + sightings.cameras[c].camera;
  }
  if (names.empty()) return uncertainty;
  return Error{ErrorCode::kFailed,
               "the corners seen do not determine all lens parameters: show the target up to the "
               "edges of these pictures and at other angles, or find fewer parameters (--model "
               "opencv)",
               names};
}

/// The result in another frame.
void ChangeFrame(const Rigid3& new_from_rig, RigCalibration& calibration) {
  const Rigid3 rig_from_new = new_from_rig.Inverse();
  for (auto& pose : calibration.model.cam_from_rig) {
    if (pose) pose = *pose * rig_from_new;
  }
  for (auto& pose : calibration.model.rig_from_board) {
    if (pose) pose = new_from_rig * *pose;
  }
  const Eigen::Matrix3d turn = new_from_rig.RotationMatrix();
  for (auto& camera : calibration.uncertainty.cameras) {
    if (!camera) continue;
    Eigen::MatrixXd& covariance = camera->covariance;
    covariance.middleRows<3>(3) = (turn * covariance.middleRows<3>(3)).eval();
    covariance.middleCols<3>(3) = (covariance.middleCols<3>(3) * turn.transpose()).eval();
  }
}

/// The shot that the rig frame is to hang on; shots.size() when it is not there.
size_t FrameShot(const std::vector<BoardShot>& shots, const RigFrameSetting& setting) {
  if (setting.shot.empty()) return 0;
  return static_cast<size_t>(
      std::find_if(shots.begin(), shots.end(),
                   [&](const BoardShot& shot) { return shot.id == setting.shot; }) -
      shots.begin());
}

/// The rig frame from the target's pose in the shot that is set, or, with a word of it, in the
/// first one that was used.
void HangFrame(const BoardSightings& sightings, const RigFrameSetting& setting,
               RigCalibration& result) {
  const auto& poses = result.model.rig_from_board;
  const size_t shot = FrameShot(sightings.shots, setting);
  size_t used = shot;
  if (!poses[shot]) {
    used = static_cast<size_t>(std::find_if(poses.begin(), poses.end(),
                                            [](const auto& pose) { return pose.has_value(); }) -
                               poses.begin());
    if (used == poses.size()) return;
    result.frame_problem = "the rig frame was to hang on the target in " +
                           sightings.shots[shot].id + ", which was left out, and now hangs on " +
                           sightings.shots[used].id +
                           ": take that shot again, or keep the frame of an earlier calibration "
                           "(--frame-from)";
  }
  result.frame = "the target in " + sightings.shots[used].id;
  const Rigid3 rig_from_board = {
      Eigen::Quaterniond(Eigen::AngleAxisd(setting.front_rad, Eigen::Vector3d::UnitZ())),
      setting.board_origin_m};
  ChangeFrame(rig_from_board * poses[used]->Inverse(), result);
}

Status AlignFrame(const BoardSightings& sightings, const RigCalibrationOptions& options,
                  RigCalibration& result) {
  const Result<Rigid3> alignment =
      AlignRigs(*options.frame_from, AsCalibration(result, sightings), {});
  if (!alignment) return alignment.error().In("rig frame of the earlier calibration");
  ChangeFrame(*alignment, result);
  result.frame = "the earlier calibration's";
  return {};
}

/// What every solution of one calibration starts from.
struct SolveTask {
  const Board& board;
  BoardShape shape;
  const BoardSightings& sightings;
  const std::vector<std::optional<CameraIntrinsics>>& known;
  const RigCalibrationOptions& options;
};

/// Start, robust rounds, misfits taken out, final rounds; without what `result` has dropped.
Status SolveFrom(const SolveTask& task, RigCalibration& result, RunContext& context) {
  const RigProblem problem = {task.board, task.shape, result.priors};
  const std::vector<FaceView> views = Without(result.found, result.dropped);
  context.Report("start", 0, 1);
  ROTUNDA_ASSIGN_OR_RETURN(CalibrationStart start,
                           StartCalibration(problem, {views, task.sightings.cameras, task.known},
                                            task.options.start, context));
  context.Report("start", 1, 1);
  TakeStart(std::move(start), task.sightings.shots.size(), result);
  ROTUNDA_RETURN_IF_ERROR(AdjustRobustly(problem, views, task.options.model, result, context));
  for (DroppedPicture& misfit :
       FindMisfits(task.sightings, views, task.shape, result, task.options)) {
    result.dropped.push_back(std::move(misfit));
  }
  for (const DroppedPicture& dropped : result.dropped) {
    if (!dropped.camera) result.shot_problem[dropped.shot] = dropped.reason;
  }
  return AdjustFinally(problem, Without(views, result.dropped), task.options, result, context);
}

std::string OddShotText(double with_px, double without_px) {
  return "it does not agree with the other shots: corners fit to " + Number(with_px, "%.3f px") +
         " with it and to " + Number(without_px, "%.3f px") +
         " without; is it of another rig or another target, or were cameras moved or exchanged "
         "between the shots?";
}

/// Of corners that fit badly, a single shot may be the reason: the one without which the others fit
/// much better. `untouched`: the calibration before anything was solved.
Status LeaveOutOddShot(const SolveTask& task, const RigCalibration& untouched,
                       RigCalibration& result, RunContext& context) {
  constexpr double kMuchBetter = 0.2;
  constexpr std::ptrdiff_t kLeastShots = 3;  // of two, neither can be told to be the odd one
  const auto& poses = result.model.rig_from_board;
  if (std::count_if(poses.begin(), poses.end(), [](const auto& pose) { return pose.has_value(); }) <
      kLeastShots) {
    return {};
  }
  const double with_px = ResidualRms_px(task.shape, result);
  double least_px = kMuchBetter * with_px;
  std::optional<RigCalibration> best;
  for (size_t s = 0; s < poses.size(); ++s) {
    if (!poses[s]) continue;
    RigCalibration without = untouched;
    without.dropped.push_back({s, std::nullopt, ""});
    const Status solved = SolveFrom(task, without, context);
    if (context.Stopped()) return Error{ErrorCode::kCancelled, "stopped", "calibration"};
    if (!solved.ok()) continue;
    const double rms_px = ResidualRms_px(task.shape, without);
    if (rms_px >= least_px) continue;
    least_px = rms_px;
    DroppedPicture& odd = without.dropped[untouched.dropped.size()];
    odd.reason = without.shot_problem[s] = OddShotText(with_px, rms_px);
    best = std::move(without);
  }
  if (best) result = *std::move(best);
  return {};
}

}  // namespace

Result<RigModel> Readjust(const RigProblem& problem, const std::vector<FaceView>& views,
                          const FreeUnknowns& free, const RigModel& model, RunContext& context) {
  RigSolveOptions options;
  options.free = free;
  RigModel adjusted = model;
  ROTUNDA_RETURN_IF_ERROR(SolveRig(problem, views, options, adjusted, context));
  return adjusted;
}

double ResidualRms_px(const BoardShape& shape, const RigCalibration& result) {
  double squares = 0;
  for (const FaceView& view : result.kept) {
    for (const Eigen::Vector2d& residual : Residuals_px(result.model, shape, view)) {
      squares += residual.squaredNorm();
    }
  }
  return std::sqrt(squares / static_cast<double>(CornerCount(result.kept)));
}

Status CheckShared(const std::vector<SightedCamera>& cameras, const Calibration& other,
                   size_t least) {
  const auto shared = static_cast<size_t>(std::count_if(
      cameras.begin(), cameras.end(),
      [&](const SightedCamera& camera) { return other.Find(camera.camera) != nullptr; }));
  if (shared >= least) return {};
  return Error{
      ErrorCode::kBadInput,
      "has " + std::to_string(shared) + " of the shots' " + std::to_string(cameras.size()) +
          " cameras (the first: " + (cameras.empty() ? "none" : cameras[0].camera) +
          ", there: " + (other.cameras.empty() ? "none" : other.cameras[0].camera) +
          "), at least " + std::to_string(least) + " are needed: is it another rig's calibration?",
      "earlier calibration"};
}

Status CheckKeptLenses(const std::vector<SightedCamera>& cameras, const Calibration& from) {
  ROTUNDA_RETURN_IF_ERROR(CheckShared(cameras, from, 1));
  for (const SightedCamera& camera : cameras) ROTUNDA_RETURN_IF_ERROR(CheckKeptLens(camera, from));
  return {};
}

Status CheckFrameShot(const std::vector<BoardShot>& shots, const RigFrameSetting& setting) {
  if (shots.empty() || FrameShot(shots, setting) < shots.size()) return {};
  return Error{ErrorCode::kBadInput,
               "is \"" + setting.shot + "\", which is none of the shots given (the first is \"" +
                   shots[0].id + "\"); give that shot too, or name another one",
               "rig_frame.shot"};
}

Result<RigCalibration> CalibrateRig(const Board& board, const BoardSightings& sightings,
                                    const RigCalibrationOptions& options, RunContext& context) {
  ROTUNDA_RETURN_IF_ERROR(board.Validate());
  RigCalibration result;
  result.found = ViewsOf(sightings);
  ROTUNDA_RETURN_IF_ERROR(CheckSightings(sightings, result.found));
  ROTUNDA_ASSIGN_OR_RETURN(result.dropped, FindRepeats(sightings, result.found));
  result.found = Without(result.found, result.dropped);
  if (options.frame_from == nullptr) {
    ROTUNDA_RETURN_IF_ERROR(CheckFrameShot(sightings.shots, board.rig_frame));
  } else {
    ROTUNDA_RETURN_IF_ERROR(CheckShared(sightings.cameras, *options.frame_from, 1));
  }
  ROTUNDA_ASSIGN_OR_RETURN(const auto known, KnownIntrinsics(sightings, options.intrinsics_from));
  const std::vector<size_t> unknown = TakeUnknown(sightings, options.intrinsics_from, result.found);
  result.free.intrinsics = options.intrinsics_from == nullptr;
  result.free.rational = options.model == LensModel::kFullOpencv;
  result.held_intrinsics = HeldIntrinsics(sightings, options.intrinsics_from);
  result.priors = PriorsOf(board, options.intrinsics_from);
  const SolveTask task = {board, ShapeOf(board), sightings, known, options};
  const RigCalibration untouched = result;
  ROTUNDA_RETURN_IF_ERROR(SolveFrom(task, result, context));
  if (ResidualRms_px(task.shape, result) > options.max_rms_px) {
    ROTUNDA_RETURN_IF_ERROR(LeaveOutOddShot(task, untouched, result, context));
  }
  const RigProblem problem = {board, task.shape, result.priors};
  result.noise = std::sqrt(NoiseVariance(problem, result.kept, result.model, result.free));
  result.camera_noise = CameraNoise(task.shape, result);
  ROTUNDA_ASSIGN_OR_RETURN(result.uncertainty, UncertaintyOf(problem, sightings, result, context));
  ExplainMissing(sightings, static_cast<size_t>(options.start.min_corners), result);
  for (const size_t camera : unknown) {
    result.camera_problem[camera] =
        "it is not in the calibration that lenses are kept from: calibrate it from several shots, "
        "without keeping lenses";
  }
  if (options.frame_from == nullptr) {
    HangFrame(sightings, board.rig_frame, result);
  } else {
    ROTUNDA_RETURN_IF_ERROR(AlignFrame(sightings, options, result));
  }
  context.Report("adjustment", 1, 1);
  return result;
}

}  // namespace rotunda::rig
