#include "rig/calibration_start.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "rig/lens_start.h"
#include "rig/pose_groups.h"

namespace rotunda::rig {
namespace {

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
void BorrowFocals(const std::vector<std::vector<BodyViews>>& seen,
                  std::vector<std::optional<CameraIntrinsics>>& lenses) {
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

/// Sightings grouped by what they share, as lists of places in `sightings`.
using Shared = std::map<std::pair<size_t, size_t>, std::vector<size_t>>;

/// Links between groups of cameras (`of_cameras`) or of bodies, from the sightings of one shot that
/// share a group of the other kind.
std::vector<GroupLink> FindLinks(const std::vector<Sighting>& sightings, const PoseGroups& cameras,
                                 const PoseGroups& bodies, bool of_cameras,
                                 const PoseAgreement& agreement) {
  Shared shared;
  for (size_t i = 0; i < sightings.size(); ++i) {
    const Sighting& s = sightings[i];
    const size_t other = of_cameras ? bodies.group(s.body) : cameras.group(s.camera);
    shared[{s.shot, other}].push_back(i);
  }
  const auto group = [&](const Sighting& s) {
    return of_cameras ? cameras.group(s.camera) : bodies.group(s.body);
  };
  // Pose of the other kind's group in this kind's.
  const auto pose = [&](const Sighting& s, const PoseHypothesis& hypothesis) {
    const Rigid3 cameras_from_bodies = cameras.group_from(s.camera) * hypothesis.cam_from_body *
                                       bodies.group_from(s.body).Inverse();
    return of_cameras ? cameras_from_bodies : cameras_from_bodies.Inverse();
  };
  std::map<std::pair<size_t, size_t>, std::vector<PoseVote>> votes;
  for (const auto& [key, places] : shared) {
    for (const size_t i : places) {
      for (const size_t j : places) {
        const Sighting& a = sightings[i];
        const Sighting& b = sightings[j];
        if (group(a) >= group(b)) continue;
        for (const PoseHypothesis& of_a : a.poses) {
          for (const PoseHypothesis& of_b : b.poses) {
            const double doubt = std::pow(
                a.poses[0].error_px / of_a.error_px * b.poses[0].error_px / of_b.error_px, 2);
            votes[{group(a), group(b)}].push_back(
                {pose(a, of_a) * pose(b, of_b).Inverse(), doubt * std::min(a.weight, b.weight),
                 0.5 * (of_a.cam_from_body.translation.norm() +
                        of_b.cam_from_body.translation.norm()),
                 of_cameras ? a.shot : a.shot * cameras.size() + a.camera});
          }
        }
      }
    }
  }
  std::vector<GroupLink> links;
  for (const auto& [groups, of_groups] : votes) {
    links.push_back({groups.first, groups.second, FindConsensus(of_groups, agreement)});
  }
  return links;
}

std::vector<Sighting> MakeSightings(const RigProblem& problem, const std::vector<Body>& bodies,
                                    const std::vector<std::vector<BodyViews>>& seen,
                                    const std::vector<std::optional<CameraIntrinsics>>& lenses,
                                    const CalibrationStartOptions& options, RunContext& context) {
  std::vector<std::vector<Sighting>> by_camera(seen.size());
  context.threads.ParallelFor(seen.size(), [&](size_t c) {
    if (!lenses[c]) return;
    for (const BodyViews& picture : seen[c]) {
      Sighting sighting{c, picture.views[0]->shot, picture.body, {}, 0};
      sighting.poses = PoseHypotheses(problem, bodies[picture.body], picture.views, *lenses[c],
                                      options.min_corners);
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

/// The group with the most sightings by weight.
size_t MainGroup(const std::vector<Sighting>& sightings, const PoseGroups& cameras) {
  std::map<size_t, double> weights;
  for (const Sighting& s : sightings) weights[cameras.group(s.camera)] += s.weight;
  return std::max_element(weights.begin(), weights.end(),
                          [](const auto& a, const auto& b) { return a.second < b.second; })
      ->first;
}

/// Poses of cameras, faces and shots in the frame of the main group of cameras.
void PoseAll(const RigProblem& problem, const std::vector<Body>& bodies,
             const std::vector<Sighting>& sightings, const PoseGroups& cameras,
             const PoseGroups& body_groups, const PoseAgreement& agreement,
             CalibrationStart& start) {
  const size_t main = MainGroup(sightings, cameras);
  std::vector<bool> seen(cameras.size(), false);
  for (const Sighting& s : sightings) seen[s.camera] = true;
  for (size_t c = 0; c < cameras.size(); ++c) {
    if (cameras.group(c) == main && seen[c]) {
      start.model.cam_from_rig[c] = cameras.group_from(c).Inverse();
    } else if (start.camera_problem[c].empty()) {
      start.camera_problem[c] =
          "no shot shows the board to this camera and to another one that is tied to the rest";
    }
  }
  size_t anchor = 0;  // body whose first face is where the drawing puts it
  for (const Sighting& s : sightings) {
    if (cameras.group(s.camera) == main) {
      anchor = s.body;
      break;
    }
  }
  for (const Sighting& s : sightings) {
    if (body_groups.group(s.body) == body_groups.group(anchor)) anchor = std::min(anchor, s.body);
  }
  const Rigid3 board_from_group = problem.priors[bodies[anchor].faces[0]].face.board_from_face *
                                  bodies[anchor].body_from_face[0].Inverse() *
                                  body_groups.group_from(anchor).Inverse();
  for (size_t b = 0; b < bodies.size(); ++b) {
    if (body_groups.group(b) != body_groups.group(anchor)) continue;
    for (size_t i = 0; i < bodies[b].faces.size(); ++i) {
      start.model.faces[bodies[b].faces[i]].board_from_face =
          board_from_group * body_groups.group_from(b) * bodies[b].body_from_face[i];
    }
  }
  std::vector<std::vector<PoseVote>> votes(start.model.rig_from_board.size());
  for (const Sighting& s : sightings) {
    if (cameras.group(s.camera) != main || body_groups.group(s.body) != body_groups.group(anchor)) {
      continue;
    }
    for (const PoseHypothesis& pose : s.poses) {
      votes[s.shot].push_back({cameras.group_from(s.camera) * pose.cam_from_body *
                                   (board_from_group * body_groups.group_from(s.body)).Inverse(),
                               s.weight * std::pow(s.poses[0].error_px / pose.error_px, 2),
                               pose.cam_from_body.translation.norm(), s.camera});
    }
  }
  for (size_t s = 0; s < votes.size(); ++s) {
    if (votes[s].empty()) {
      start.shot_problem[s] = "no camera that is tied to the rest saw enough of the board";
    } else {
      start.model.rig_from_board[s] = FindConsensus(votes[s], agreement).a_from_b;
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

/// StartCalibration with the faces as drawn (`together`), or each on its own.
Result<CalibrationStart> StartWith(
    const RigProblem& problem, const std::vector<FaceView>& views,
    const std::vector<SightedCamera>& cameras,
    const std::vector<std::optional<CameraIntrinsics>>& known_intrinsics,
    const CalibrationStartOptions& options, bool together, RunContext& context) {
  const std::vector<Body> bodies = MakeBodies(problem, together);
  const auto seen = GroupViews(views, bodies, cameras.size());
  size_t shots = 0;
  for (const FaceView& view : views) shots = std::max(shots, view.shot + 1);

  std::vector<std::optional<CameraIntrinsics>> lenses = known_intrinsics;
  context.threads.ParallelFor(cameras.size(), [&](size_t c) {
    if (lenses[c] || seen[c].empty()) return;
    lenses[c] =
        StartLens(problem, bodies, seen[c], cameras[c].width_px, cameras[c].height_px, options);
  });
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "stopped", "calibration"};
  if (std::none_of(known_intrinsics.begin(), known_intrinsics.end(),
                   [](const auto& known) { return known.has_value(); })) {
    BorrowFocals(seen, lenses);
  }

  CalibrationStart start;
  start.camera_problem.resize(cameras.size());
  start.shot_problem.resize(shots);
  start.model.cam_from_rig.resize(cameras.size());
  start.model.rig_from_board.resize(shots);
  for (const FacePrior& prior : problem.priors) start.model.faces.push_back(prior.face);
  for (size_t c = 0; c < cameras.size(); ++c) {
    if (!lenses[c]) {
      start.camera_problem[c] = "no picture shows " + std::to_string(options.min_corners) +
                                " corners of one face of the board";
    }
    start.model.intrinsics.push_back(lenses[c].value_or(
        DefaultIntrinsics(std::max(1, cameras[c].width_px), std::max(1, cameras[c].height_px), 1)));
  }
  const std::vector<Sighting> sightings =
      MakeSightings(problem, bodies, seen, lenses, options, context);
  if (sightings.empty()) {
    return Error{ErrorCode::kFailed,
                 "no camera saw enough of the board in any shot: expected at least " +
                     std::to_string(options.min_corners) + " corners of one face",
                 ""};
  }
  const PoseAgreement agreement = {options.agree_rad, options.agree_share};
  PoseGroups camera_groups(cameras.size()), body_groups(bodies.size());
  bool joined = true;
  while (joined) {
    joined = JoinGroups(FindLinks(sightings, camera_groups, body_groups, true, agreement),
                        camera_groups);
    joined = JoinGroups(FindLinks(sightings, camera_groups, body_groups, false, agreement),
                        body_groups) ||
             joined;
  }
  PoseAll(problem, bodies, sightings, camera_groups, body_groups, agreement, start);
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
  if (errors.empty()) return 0;
  const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
  std::nth_element(errors.begin(), middle, errors.end());
  return *middle / kRayleighMedian;
}

Result<CalibrationStart> StartCalibration(
    const RigProblem& problem, const std::vector<FaceView>& views,
    const std::vector<SightedCamera>& cameras,
    const std::vector<std::optional<CameraIntrinsics>>& known_intrinsics,
    const CalibrationStartOptions& options, RunContext& context) {
  const bool as_drawn = DrawingIsAStart(problem, options);
  ROTUNDA_ASSIGN_OR_RETURN(
      CalibrationStart start,
      StartWith(problem, views, cameras, known_intrinsics, options, as_drawn, context));
  if (!as_drawn || problem.board.faces.size() == 1) return start;
  const double as_drawn_px = MedianError_px(start.model, problem.shape, views);
  const int side_px = std::max_element(cameras.begin(), cameras.end(), [](auto& a, auto& b) {
                        return a.width_px + a.height_px < b.width_px + b.height_px;
                      })->width_px;
  if (as_drawn_px < options.max_start_error * side_px) return start;
  Result<CalibrationStart> apart =
      StartWith(problem, views, cameras, known_intrinsics, options, false, context);
  constexpr double kMuchBetter = 0.3;
  if (!apart || MedianError_px(apart->model, problem.shape, views) > kMuchBetter * as_drawn_px) {
    return start;
  }
  apart->drawing_refused = true;
  return apart;
}

}  // namespace rotunda::rig
