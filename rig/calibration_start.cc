#include "rig/calibration_start.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "rig/lens_start.h"
#include "rig/pose_groups.h"
#include "sfm/core/statistics.h"

namespace rotunda::rig {
namespace {

/// What every stage of a start looks at.
struct StartTask {
  const RigProblem& problem;
  const StartInput& input;
  const CalibrationStartOptions& options;
};

/// Bodies, and what each camera saw of them: a picture for each shot and body.
struct SeenBodies {
  std::vector<Body> bodies;
  std::vector<std::vector<BodyViews>> by_camera;
};

BodySearch SearchOf(const StartTask& task, const SeenBodies& seen) {
  return {task.problem, seen.bodies, task.options.min_corners};
}

/// By camera; nullopt: it saw too little.
using Lenses = std::vector<std::optional<CameraIntrinsics>>;

/// What a camera saw of a body in a shot, and from where it may have seen it.
struct Sighting {
  size_t camera = 0, shot = 0, body = 0;
  std::vector<PoseHypothesis> poses;
  double weight = 0;
};

bool DrawingIsAStart(const RigProblem& problem, const CalibrationStartOptions& options) {
  if (problem.board.faces.size() == 1) return true;
  for (size_t f = 0; f < problem.priors.size(); ++f) {
    const BoardFace& face = problem.board.faces[f];
    const double side_m = std::min(face.Width_m(), face.Height_m());
    const FacePrior& prior = problem.priors[f];
    if (!(prior.position_sigma_m <= options.max_face_position_sigma * side_m) ||
        !(prior.rotation_sigma_rad <= options.max_face_rotation_sigma_rad)) {
      return false;
    }
  }
  return true;
}

std::vector<Body> MakeBodies(const RigProblem& problem, bool together) {
  std::vector<Body> bodies;
  for (size_t f = 0; f < problem.priors.size(); ++f) {
    if (bodies.empty() || !together) bodies.emplace_back();
    bodies.back().faces.push_back(f);
    bodies.back().body_from_face.push_back(together ? problem.priors[f].face.board_from_face
                                                    : Rigid3{});
  }
  return bodies;
}

/// A camera's views, one list for each shot and body.
std::vector<std::vector<BodyViews>> GroupViews(const std::vector<FaceView>& views,
                                               const std::vector<Body>& bodies, size_t cameras) {
  std::vector<std::vector<BodyViews>> seen(cameras);
  std::map<std::pair<size_t, std::pair<size_t, size_t>>, size_t> places;
  for (const FaceView& view : views) {
    const auto body = static_cast<size_t>(
        std::find_if(bodies.begin(), bodies.end(),
                     [&](const Body& b) {
                       return std::count(b.faces.begin(), b.faces.end(), view.face) > 0;
                     }) -
        bodies.begin());
    auto& pictures = seen[view.camera];
    const auto [place, is_new] =
        places.emplace(std::pair{view.camera, std::pair{view.shot, body}}, pictures.size());
    if (is_new) pictures.push_back({body, {}});
    pictures[place->second].views.push_back(&view);
  }
  return seen;
}

/// Corners times the share of the picture that they span.
double WeightOf(const std::vector<const FaceView*>& views, const CameraIntrinsics& intrinsics) {
  Eigen::AlignedBox2d box;
  double corners = 0;
  for (const FaceView* view : views) {
    for (const SeenCorner& seen : view->corners) box.extend(seen.pixel);
    corners += static_cast<double>(view->corners.size());
  }
  return corners * box.volume() / (1.0 * intrinsics.width_px * intrinsics.height_px);
}

/// A camera with one or two pictures of planes cannot tell its focal length from its distance: it
/// starts from the median of the others with pictures of its size.
void BorrowFocals(const std::vector<std::vector<BodyViews>>& seen, Lenses& lenses) {
  constexpr size_t kFewPictures = 2;
  constexpr double kFarFromMedian = 1.15;
  for (size_t c = 0; c < lenses.size(); ++c) {
    if (!lenses[c] || seen[c].size() > kFewPictures) continue;
    std::vector<double> focals_px;
    for (const auto& other : lenses) {
      if (other && other->width_px == lenses[c]->width_px &&
          other->height_px == lenses[c]->height_px) {
        focals_px.push_back(other->MeanFocal_px());
      }
    }
    std::sort(focals_px.begin(), focals_px.end());
    const double median_px = focals_px[focals_px.size() / 2];
    const double ratio = lenses[c]->MeanFocal_px() / median_px;
    if (ratio > kFarFromMedian || ratio < 1 / kFarFromMedian) {
      lenses[c]->params = {
          median_px, median_px, 0.5 * lenses[c]->width_px, 0.5 * lenses[c]->height_px, 0, 0, 0, 0};
    }
  }
}

/// The lenses that are known, and starts of the others.
Lenses FindLenses(const StartTask& task, const SeenBodies& seen, RunContext& context) {
  const StartInput& input = task.input;
  const BodySearch search = SearchOf(task, seen);
  Lenses lenses = input.known_intrinsics;
  context.threads.ParallelFor(lenses.size(), [&](size_t c) {
    if (lenses[c] || seen.by_camera[c].empty()) return;
    lenses[c] = StartLens(search, seen.by_camera[c], input.cameras[c]);
  });
  const bool some_known = std::any_of(input.known_intrinsics.begin(), input.known_intrinsics.end(),
                                      [](const auto& known) { return known.has_value(); });
  if (!some_known) BorrowFocals(seen.by_camera, lenses);
  return lenses;
}

std::vector<Sighting> MakeSightings(const StartTask& task, const SeenBodies& seen,
                                    const Lenses& lenses, RunContext& context) {
  const BodySearch search = SearchOf(task, seen);
  std::vector<std::vector<Sighting>> by_camera(lenses.size());
  context.threads.ParallelFor(lenses.size(), [&](size_t c) {
    if (!lenses[c]) return;
    for (const BodyViews& picture : seen.by_camera[c]) {
      Sighting sighting{c, picture.views[0]->shot, picture.body, {}, 0};
      sighting.poses = PoseHypotheses(search, picture, *lenses[c]);
      // An error of nothing would make the other poses' weight nothing.
      for (PoseHypothesis& pose : sighting.poses) pose.error_px = std::max(pose.error_px, 1e-3);
      sighting.weight = WeightOf(picture.views, *lenses[c]);
      if (!sighting.poses.empty()) by_camera[c].push_back(std::move(sighting));
    }
  });
  std::vector<Sighting> sightings;
  for (const auto& some : by_camera) sightings.insert(sightings.end(), some.begin(), some.end());
  return sightings;
}

/// Cameras and bodies, each kind in groups whose members' relative poses are known.
struct TiedGroups {
  PoseGroups cameras;
  PoseGroups bodies;
  PoseAgreement agreement;
};

/// Sightings as ties between groups of one kind (cameras, or else bodies): two that share a shot
/// and a group of the other kind say how their groups lie to each other.
class Ties {
 public:
  Ties(const TiedGroups& groups, bool of_cameras) : groups_(groups), of_cameras_(of_cameras) {}

  size_t Group(const Sighting& s) const {
    return of_cameras_ ? groups_.cameras.group(s.camera) : groups_.bodies.group(s.body);
  }
  std::pair<size_t, size_t> Shared(const Sighting& s) const {
    return {s.shot, of_cameras_ ? groups_.bodies.group(s.body) : groups_.cameras.group(s.camera)};
  }

  void AddVotes(const Sighting& a, const Sighting& b, std::vector<PoseVote>& votes) const {
    for (const PoseHypothesis& of_a : a.poses) {
      for (const PoseHypothesis& of_b : b.poses) {
        const double doubt =
            std::pow(a.poses[0].error_px / of_a.error_px * b.poses[0].error_px / of_b.error_px, 2);
        votes.push_back(
            {FromOther(a, of_a) * FromOther(b, of_b).Inverse(),
             doubt * std::min(a.weight, b.weight),
             0.5 * (of_a.cam_from_body.translation.norm() + of_b.cam_from_body.translation.norm()),
             SourceOf(a)});
      }
    }
  }

 private:
  /// Pose of the other kind's group in this kind's.
  Rigid3 FromOther(const Sighting& s, const PoseHypothesis& hypothesis) const {
    const Rigid3 cameras_from_bodies = groups_.cameras.group_from(s.camera) *
                                       hypothesis.cam_from_body *
                                       groups_.bodies.group_from(s.body).Inverse();
    return of_cameras_ ? cameras_from_bodies : cameras_from_bodies.Inverse();
  }
  size_t SourceOf(const Sighting& s) const {
    return of_cameras_ ? s.shot : s.shot * groups_.cameras.size() + s.camera;
  }

  const TiedGroups& groups_;
  bool of_cameras_;
};

/// Links between groups of cameras (`of_cameras`) or of bodies.
std::vector<GroupLink> FindLinks(const std::vector<Sighting>& sightings, const TiedGroups& groups,
                                 bool of_cameras) {
  const Ties ties(groups, of_cameras);
  std::map<std::pair<size_t, size_t>, std::vector<const Sighting*>> shared;
  for (const Sighting& s : sightings) shared[ties.Shared(s)].push_back(&s);
  std::map<std::pair<size_t, size_t>, std::vector<PoseVote>> votes;
  for (const auto& [key, together] : shared) {
    for (const Sighting* a : together) {
      for (const Sighting* b : together) {
        if (ties.Group(*a) >= ties.Group(*b)) continue;
        ties.AddVotes(*a, *b, votes[{ties.Group(*a), ties.Group(*b)}]);
      }
    }
  }
  std::vector<GroupLink> links;
  for (const auto& [ends, of_ends] : votes) {
    links.push_back({ends.first, ends.second, FindConsensus(of_ends, groups.agreement)});
  }
  return links;
}

/// Joins cameras and bodies in turn until nothing is left to be joined.
TiedGroups TieTogether(const StartTask& task, const SeenBodies& seen,
                       const std::vector<Sighting>& sightings) {
  TiedGroups groups = {PoseGroups(seen.by_camera.size()),
                       PoseGroups(seen.bodies.size()),
                       {task.options.agree_rad, task.options.agree_share}};
  bool joined = true;
  while (joined) {
    joined = JoinGroups(FindLinks(sightings, groups, true), groups.cameras);
    joined = JoinGroups(FindLinks(sightings, groups, false), groups.bodies) || joined;
  }
  return groups;
}

/// The groups that a start consists of; the cameras' is the rig.
struct MainGroups {
  size_t cameras = 0, bodies = 0;
  Rigid3 board_from_bodies;

  bool Has(const TiedGroups& groups, const Sighting& s) const {
    return groups.cameras.group(s.camera) == cameras && groups.bodies.group(s.body) == bodies;
  }
};

/// The cameras with the most sightings by weight, and the bodies that the first of them saw. The
/// board's frame is where the drawing puts the first face of the first of those bodies.
MainGroups ChooseMain(const RigProblem& problem, const std::vector<Body>& bodies,
                      const std::vector<Sighting>& sightings, const TiedGroups& groups) {
  std::map<size_t, double> weights;
  for (const Sighting& s : sightings) weights[groups.cameras.group(s.camera)] += s.weight;
  MainGroups main;
  main.cameras = std::max_element(weights.begin(), weights.end(), [](const auto& a, const auto& b) {
                   return a.second < b.second;
                 })->first;
  size_t anchor = std::find_if(sightings.begin(), sightings.end(), [&](const Sighting& s) {
                    return groups.cameras.group(s.camera) == main.cameras;
                  })->body;
  main.bodies = groups.bodies.group(anchor);
  for (const Sighting& s : sightings) {
    if (groups.bodies.group(s.body) == main.bodies) anchor = std::min(anchor, s.body);
  }
  const Body& first = bodies[anchor];
  main.board_from_bodies = problem.priors[first.faces[0]].face.board_from_face *
                           first.body_from_face[0].Inverse() *
                           groups.bodies.group_from(anchor).Inverse();
  return main;
}

std::string TooFewCorners(int min_corners) {
  return "no picture shows " + std::to_string(min_corners) + " corners of one face of the board";
}

void PoseCameras(const std::vector<Sighting>& sightings, const PoseGroups& cameras, size_t main,
                 int min_corners, CalibrationStart& start) {
  std::vector<bool> seen(cameras.size(), false);
  for (const Sighting& s : sightings) seen[s.camera] = true;
  for (size_t c = 0; c < cameras.size(); ++c) {
    if (cameras.group(c) == main && seen[c]) {
      start.model.cam_from_rig[c] = cameras.group_from(c).Inverse();
    } else if (start.camera_problem[c].empty()) {
      start.camera_problem[c] =
          seen[c]
              ? "no shot shows the board to this camera and to another one that is tied to the rest"
              : TooFewCorners(min_corners);
    }
  }
}

void PoseFaces(const std::vector<Body>& bodies, const PoseGroups& groups, const MainGroups& main,
               std::vector<CalibratedFace>& faces) {
  for (size_t b = 0; b < bodies.size(); ++b) {
    if (groups.group(b) != main.bodies) continue;
    for (size_t i = 0; i < bodies[b].faces.size(); ++i) {
      faces[bodies[b].faces[i]].board_from_face =
          main.board_from_bodies * groups.group_from(b) * bodies[b].body_from_face[i];
    }
  }
}

void PoseShots(const std::vector<Sighting>& sightings, const TiedGroups& groups,
               const MainGroups& main, CalibrationStart& start) {
  std::vector<std::vector<PoseVote>> votes(start.model.rig_from_board.size());
  for (const Sighting& s : sightings) {
    if (!main.Has(groups, s)) continue;
    for (const PoseHypothesis& pose : s.poses) {
      votes[s.shot].push_back(
          {groups.cameras.group_from(s.camera) * pose.cam_from_body *
               (main.board_from_bodies * groups.bodies.group_from(s.body)).Inverse(),
           s.weight * std::pow(s.poses[0].error_px / pose.error_px, 2),
           pose.cam_from_body.translation.norm(), s.camera});
    }
  }
  for (size_t s = 0; s < votes.size(); ++s) {
    if (votes[s].empty()) {
      start.shot_problem[s] = "no camera that is tied to the rest saw enough of the board";
    } else {
      start.model.rig_from_board[s] = FindConsensus(votes[s], groups.agreement).a_from_b;
    }
  }
}

/// Median reprojection error of all corners that have a pose, in pixels.
double MedianError_px(const RigModel& model, const BoardShape& shape,
                      const std::vector<FaceView>& views) {
  std::vector<FaceView> plain = views;
  for (FaceView& view : plain) {
    for (SeenCorner& corner : view.corners) corner.sigma_px = 1;
  }
  return NoiseScale(model, shape, plain);
}

/// A start that has lenses and the drawing's faces, and no poses yet.
CalibrationStart UnposedStart(const StartTask& task, const Lenses& lenses) {
  size_t shots = 0;
  for (const FaceView& view : task.input.views) shots = std::max(shots, view.shot + 1);
  CalibrationStart start;
  start.camera_problem.resize(lenses.size());
  start.shot_problem.resize(shots);
  start.model.cam_from_rig.resize(lenses.size());
  start.model.rig_from_board.resize(shots);
  for (const FacePrior& prior : task.problem.priors) start.model.faces.push_back(prior.face);
  for (size_t c = 0; c < lenses.size(); ++c) {
    if (!lenses[c]) {
      start.camera_problem[c] = TooFewCorners(task.options.min_corners);
    }
    const SightedCamera& camera = task.input.cameras[c];
    start.model.intrinsics.push_back(lenses[c].value_or(
        DefaultIntrinsics(std::max(1, camera.width_px), std::max(1, camera.height_px), 1)));
  }
  return start;
}

/// StartCalibration with the faces as drawn (`together`), or each on its own.
Result<CalibrationStart> StartWith(const StartTask& task, bool together, RunContext& context) {
  SeenBodies seen;
  seen.bodies = MakeBodies(task.problem, together);
  seen.by_camera = GroupViews(task.input.views, seen.bodies, task.input.cameras.size());
  const Lenses lenses = FindLenses(task, seen, context);
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "stopped", "calibration"};
  CalibrationStart start = UnposedStart(task, lenses);
  const std::vector<Sighting> sightings = MakeSightings(task, seen, lenses, context);
  if (sightings.empty()) {
    return Error{ErrorCode::kFailed,
                 "no camera saw enough of the board in any shot: expected at least " +
                     std::to_string(task.options.min_corners) + " corners of one face",
                 ""};
  }
  const TiedGroups groups = TieTogether(task, seen, sightings);
  const MainGroups main = ChooseMain(task.problem, seen.bodies, sightings, groups);
  PoseCameras(sightings, groups.cameras, main.cameras, task.options.min_corners, start);
  PoseFaces(seen.bodies, groups.bodies, main, start.model.faces);
  PoseShots(sightings, groups, main, start);
  return start;
}

}  // namespace

double NoiseScale(const RigModel& model, const BoardShape& shape,
                  const std::vector<FaceView>& views) {
  constexpr double kRayleighMedian = 1.17741;  // of the norm of two unit normal deviates
  std::vector<double> errors;
  for (const FaceView& view : views) {
    if (!model.Has(view)) continue;
    const auto residuals = Residuals_px(model, shape, view);
    for (size_t i = 0; i < residuals.size(); ++i) {
      errors.push_back(residuals[i].norm() / view.corners[i].sigma_px);
    }
  }
  return Median(std::move(errors)) / kRayleighMedian;
}

Result<CalibrationStart> StartCalibration(const RigProblem& problem, const StartInput& input,
                                          const CalibrationStartOptions& options,
                                          RunContext& context) {
  const StartTask task = {problem, input, options};
  const bool as_drawn = DrawingIsAStart(problem, options);
  ROTUNDA_ASSIGN_OR_RETURN(CalibrationStart start, StartWith(task, as_drawn, context));
  if (!as_drawn || problem.board.faces.size() == 1) return start;
  const double as_drawn_px = MedianError_px(start.model, problem.shape, input.views);
  const int side_px =
      std::max_element(input.cameras.begin(), input.cameras.end(), [](auto& a, auto& b) {
        return a.width_px + a.height_px < b.width_px + b.height_px;
      })->width_px;
  if (as_drawn_px < options.max_start_error * side_px) return start;
  Result<CalibrationStart> apart = StartWith(task, false, context);
  constexpr double kMuchBetter = 0.3;
  if (!apart ||
      MedianError_px(apart->model, problem.shape, input.views) > kMuchBetter * as_drawn_px) {
    return start;
  }
  apart->drawing_refused = true;
  return apart;
}

}  // namespace rotunda::rig
