#include "rig/rig_calibration.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "rig/calibration_comparison.h"

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
  if (earlier == nullptr) {
    return refused(
        "is not in the calibration whose intrinsics are to be kept; take one that has it, or "
        "calibrate without");
  }
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
    known[c] = from->Find(sightings.cameras[c].camera)->intrinsics;
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
Status AdjustRobustly(const RigProblem& problem, LensModel lens, RigCalibration& result,
                      RunContext& context) {
  constexpr int kMostRounds = 10;
  constexpr double kSettled = 0.02;  // change of the noise from round to round
  RigSolveOptions options;
  options.function_tolerance = 1e-4;
  options.max_iterations = 15;
  options.free = result.free;
  options.free.intrinsics = options.free.faces = false;
  RigModel& model = result.model;
  double noise = NoiseScale(model, problem.shape, result.found);
  for (int round = 0; round < kMostRounds; ++round) {
    options.loss_scale = kLossSigmas * noise;
    context.Report("adjustment", static_cast<size_t>(round), kMostRounds + 2);
    ROTUNDA_RETURN_IF_ERROR(SolveRig(problem, result.found, options, model, context));
    const double now = NoiseScale(model, problem.shape, result.found);
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

/// A threshold that `lost` of `count` normal deviates in the plane exceed: exp(-t^2 / 2) = share.
double ThresholdSigmas(size_t count, double lost) {
  return std::sqrt(2.0 * std::log(std::max(3.0, static_cast<double>(count) / lost)));
}

/// How many of a view's corners are beyond `limit` sigmas.
size_t WrongCorners(const RigModel& model, const BoardShape& shape, const FaceView& view,
                    double limit) {
  const auto residuals = Residuals_px(model, shape, view);
  size_t wrong = 0;
  for (size_t i = 0; i < residuals.size(); ++i) {
    wrong += residuals[i].norm() > limit * view.corners[i].sigma_px;
  }
  return wrong;
}

/// The pictures of one shot.
struct ShotFit {
  size_t pictures = 0;
  std::vector<size_t> wrong;  // cameras whose picture does not fit
};

/// Judges pictures by how many of their corners are beyond a limit (in sigmas).
class PictureFits {
 public:
  PictureFits(const RigModel& model, const BoardShape& shape, const std::vector<FaceView>& views,
              double limit)
      : model_(model), shape_(shape), views_(views), limit_(limit) {}

  /// By shot; a picture is wrong with more than `max_wrong` of its corners beyond the limit.
  std::map<size_t, ShotFit> ByShot(double max_wrong) const {
    std::map<std::pair<size_t, size_t>, Corners> pictures;  // by shot and camera
    for (const FaceView& view : views_) {
      if (model_.Has(view)) Add(model_, view, pictures[{view.shot, view.camera}]);
    }
    std::map<size_t, ShotFit> shots;
    for (const auto& [place, corners] : pictures) {
      ShotFit& shot = shots[place.first];
      ++shot.pictures;
      if (corners.Share() > max_wrong) shot.wrong.push_back(place.second);
    }
    return shots;
  }

  /// Whether camera `a`'s picture of the shot would fit as one of camera `b`.
  bool FitsAs(size_t shot, size_t a, size_t b) const {
    RigModel exchanged = model_;
    exchanged.cam_from_rig[a] = model_.cam_from_rig[b];
    exchanged.intrinsics[a] = model_.intrinsics[b];
    Corners corners;
    for (const FaceView& view : views_) {
      if (view.camera == a && view.shot == shot) Add(exchanged, view, corners);
    }
    return 2 * corners.wrong < corners.all;
  }

 private:
  struct Corners {
    size_t all = 0, wrong = 0;
    double Share() const { return static_cast<double>(wrong) / static_cast<double>(all); }
  };
  void Add(const RigModel& model, const FaceView& view, Corners& corners) const {
    corners.all += view.corners.size();
    corners.wrong += WrongCorners(model, shape_, view, limit_);
  }

  const RigModel& model_;
  const BoardShape& shape_;
  const std::vector<FaceView>& views_;
  double limit_;
};

/// Of a picture that does not fit; `wrong`: all cameras whose pictures of the shot do not.
std::string WhyMisfit(const BoardSightings& sightings, const PictureFits& fits,
                      const DroppedPicture& picture, const std::vector<size_t>& wrong) {
  std::string reason =
      "does not fit the other cameras' pictures of this shot: it was taken at another moment, or "
      "is not this camera's";
  for (const size_t other : wrong) {
    if (other != *picture.camera && fits.FitsAs(picture.shot, *picture.camera, other)) {
      reason = "is the picture of " + sightings.cameras[other].camera +
               ": the two cameras are swapped in this shot";
    }
  }
  return reason;
}

/// Pictures and shots most of whose corners do not fit.
std::vector<DroppedPicture> FindMisfits(const BoardSightings& sightings, const BoardShape& shape,
                                        const RigCalibration& result,
                                        const RigCalibrationOptions& options) {
  const double limit = NoiseScale(result.model, shape, result.found) *
                       ThresholdSigmas(CornerCount(result.found), options.lost_corners);
  const PictureFits fits(result.model, shape, result.found, limit);
  std::vector<DroppedPicture> dropped;
  for (const auto& [shot, fit] : fits.ByShot(options.max_wrong_corners)) {
    const auto share = static_cast<double>(fit.wrong.size()) / static_cast<double>(fit.pictures);
    if (fit.wrong.size() >= 2 && share > options.max_wrong_pictures) {
      dropped.push_back({shot, std::nullopt,
                         std::to_string(fit.wrong.size()) + " of " + std::to_string(fit.pictures) +
                             " pictures do not fit together: the board moved while the shot was "
                             "taken, or pictures of different moments are mixed; take it again"});
      continue;
    }
    for (const size_t camera : fit.wrong) {
      DroppedPicture& picture = dropped.emplace_back(DroppedPicture{shot, camera, ""});
      picture.reason = WhyMisfit(sightings, fits, picture, fit.wrong);
    }
  }
  return dropped;
}

std::vector<FaceView> Without(const std::vector<FaceView>& views,
                              const std::vector<DroppedPicture>& dropped) {
  std::vector<FaceView> rest;
  for (const FaceView& view : views) {
    if (!IsLeftOut(dropped, view)) rest.push_back(view);
  }
  return rest;
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

/// Tells of cameras and shots without a pose what was wrong with their pictures.
void ExplainMissing(const BoardSightings& sightings, RigCalibration& result) {
  for (size_t c = 0; c < sightings.cameras.size(); ++c) {
    PictureReasons reasons;
    for (const auto& row : sightings.sightings) reasons.Add(row[c]);
    if (!result.model.cam_from_rig[c]) result.camera_problem[c] += reasons.Text();
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

bool SameCorners(const FaceView& a, const FaceView& b) {
  return std::equal(a.corners.begin(), a.corners.end(), b.corners.begin(), b.corners.end(),
                    [](const SeenCorner& one, const SeenCorner& other) {
                      return one.corner == other.corner && one.pixel == other.pixel;
                    });
}

/// A picture's noise never comes twice: shots with a face in common to the last bit are one shot,
/// which would count as two.
Status CheckShotsDiffer(const BoardSightings& sightings, const std::vector<FaceView>& views) {
  std::map<std::pair<size_t, size_t>, std::vector<const FaceView*>> earlier;
  for (const FaceView& view : views) {
    std::vector<const FaceView*>& others = earlier[{view.camera, view.face}];
    for (const FaceView* other : others) {
      if (!SameCorners(*other, view)) continue;
      const BoardShot &a = sightings.shots[other->shot], &b = sightings.shots[view.shot];
      return Error{ErrorCode::kBadInput,
                   "has the same picture of camera " + sightings.cameras[view.camera].camera +
                       " as shot '" + a.id + "' (" + a.folder.string() +
                       "): give every shot once, it would count as two",
                   "shot '" + b.id + "' (" + b.folder.string() + ")"};
    }
    others.push_back(&view);
  }
  return {};
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

/// With the noise of the kept corners. The error names the cameras that are not determined.
Result<RigUncertainty> UncertaintyOf(const RigProblem& problem, const BoardSightings& sightings,
                                     const RigCalibration& result, RunContext& context) {
  const std::vector<FaceView> views = WithNoise(result.kept, result.noise);
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

}  // namespace

Result<RigModel> Readjust(const RigProblem& problem, const std::vector<FaceView>& views,
                          const FreeUnknowns& free, const RigModel& model, RunContext& context) {
  RigSolveOptions options;
  options.free = free;
  RigModel adjusted = model;
  ROTUNDA_RETURN_IF_ERROR(SolveRig(problem, views, options, adjusted, context));
  return adjusted;
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

bool IsLeftOut(const std::vector<DroppedPicture>& dropped, const FaceView& view) {
  return std::any_of(dropped.begin(), dropped.end(), [&](const DroppedPicture& d) {
    return d.shot == view.shot && (!d.camera || *d.camera == view.camera);
  });
}

Result<RigCalibration> CalibrateRig(const Board& board, const BoardSightings& sightings,
                                    const RigCalibrationOptions& options, RunContext& context) {
  ROTUNDA_RETURN_IF_ERROR(board.Validate());
  RigCalibration result;
  result.found = ViewsOf(sightings);
  ROTUNDA_RETURN_IF_ERROR(CheckSightings(sightings, result.found));
  ROTUNDA_RETURN_IF_ERROR(CheckShotsDiffer(sightings, result.found));
  ROTUNDA_RETURN_IF_ERROR(CheckFrameShot(sightings.shots, board.rig_frame));
  if (options.frame_from != nullptr) {
    ROTUNDA_RETURN_IF_ERROR(CheckShared(sightings.cameras, *options.frame_from, 1));
  }
  ROTUNDA_ASSIGN_OR_RETURN(const auto known, KnownIntrinsics(sightings, options.intrinsics_from));
  result.free.intrinsics = options.intrinsics_from == nullptr;
  result.free.rational = options.model == LensModel::kFullOpencv;
  result.held_intrinsics = HeldIntrinsics(sightings, options.intrinsics_from);
  result.priors = PriorsOf(board, options.intrinsics_from);
  const BoardShape shape = ShapeOf(board);
  const RigProblem problem = {board, shape, result.priors};

  context.Report("start", 0, 1);
  ROTUNDA_ASSIGN_OR_RETURN(
      CalibrationStart start,
      StartCalibration(problem, {result.found, sightings.cameras, known}, options.start, context));
  context.Report("start", 1, 1);
  TakeStart(std::move(start), sightings.shots.size(), result);
  ROTUNDA_RETURN_IF_ERROR(AdjustRobustly(problem, options.model, result, context));
  result.dropped = FindMisfits(sightings, shape, result, options);
  for (const DroppedPicture& dropped : result.dropped) {
    if (!dropped.camera) result.shot_problem[dropped.shot] = dropped.reason;
  }
  const std::vector<FaceView> fitting = Without(result.found, result.dropped);
  ROTUNDA_RETURN_IF_ERROR(AdjustFinally(problem, fitting, options, result, context));
  result.noise = std::sqrt(NoiseVariance(problem, result.kept, result.model, result.free));
  ROTUNDA_ASSIGN_OR_RETURN(result.uncertainty, UncertaintyOf(problem, sightings, result, context));
  ExplainMissing(sightings, result);
  if (options.frame_from == nullptr) {
    HangFrame(sightings, board.rig_frame, result);
  } else {
    ROTUNDA_RETURN_IF_ERROR(AlignFrame(sightings, options, result));
  }
  context.Report("adjustment", 1, 1);
  return result;
}

}  // namespace rotunda::rig
