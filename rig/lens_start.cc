#include "rig/lens_start.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

#include "rig/calibration_start.h"

namespace rotunda::rig {
namespace {

/// Corners of a body in one picture, as rays.
struct BodyPoints {
  std::vector<Eigen::Vector3d> in_body;
  std::vector<Eigen::Vector2d> normalized;
  double focal_px = 1;
};

constexpr size_t kMostSearchCorners = 48;  // of a face, while the focal length is searched
constexpr size_t kMostSearchPictures = 8;
constexpr double kCapShare = 0.02;  // largest error that counts, as a share of the larger side
/// Hypotheses whose error is below this times the best's are kept.
constexpr double kNearlyAsGood = 3.0;
constexpr double kErrorFloor_px = 0.5;  // below this, errors are noise and differences mean nothing

/// Where points come from: the board, a lens, and how many corners of a face are looked at.
struct PointSource {
  const RigProblem& problem;
  const CameraIntrinsics& intrinsics;
  size_t most_corners = SIZE_MAX;
};

void AppendPoints(const PointSource& source, const FaceView& view, const Rigid3& body_from_face,
                  BodyPoints& points) {
  const std::vector<CornerShape>& face = source.problem.shape[view.face];
  const size_t step = std::max<size_t>(1, view.corners.size() / source.most_corners);
  for (size_t i = 0; i < view.corners.size(); i += step) {
    const SeenCorner& seen = view.corners[i];
    const auto ray = source.intrinsics.NormalizedFromPixel(seen.pixel);
    if (!ray) continue;
    points.in_body.push_back(body_from_face * face[static_cast<size_t>(seen.corner)].in_face);
    points.normalized.push_back(*ray);
  }
}

/// Both poses of a plane (Collins and Bartoli 2014, IPPE): cam_from_face.
std::vector<Rigid3> PlanarPoses(const BodyPoints& points) {
  std::vector<cv::Point3d> object;
  std::vector<cv::Point2d> image;
  for (size_t i = 0; i < points.in_body.size(); ++i) {
    object.emplace_back(points.in_body[i].x(), points.in_body[i].y(), 0);
    image.emplace_back(points.normalized[i].x(), points.normalized[i].y());
  }
  std::vector<cv::Mat> turns, shifts;
  try {
    cv::solvePnPGeneric(object, image, cv::Mat::eye(3, 3, CV_64F), cv::noArray(), turns, shifts,
                        false, cv::SOLVEPNP_IPPE);
  } catch (const cv::Exception&) {
    return {};  // points on one line
  }
  std::vector<Rigid3> poses;
  for (size_t i = 0; i < turns.size(); ++i) {
    const Eigen::Vector3d turn(turns[i].at<double>(0), turns[i].at<double>(1),
                               turns[i].at<double>(2));
    const Eigen::Vector3d shift(shifts[i].at<double>(0), shifts[i].at<double>(1),
                                shifts[i].at<double>(2));
    if (turn.allFinite() && shift.allFinite() && shift.z() > 0) {
      poses.push_back({RotationOf(turn), shift});
    }
  }
  return poses;
}

double CappedError_px(const BodyPoints& points, const Rigid3& cam_from_body, double cap_px) {
  double sum = 0;
  for (size_t i = 0; i < points.in_body.size(); ++i) {
    const Eigen::Vector3d x = cam_from_body * points.in_body[i];
    const double error =
        x.z() > 0 ? points.focal_px * (x.hnormalized() - points.normalized[i]).norm() : cap_px;
    sum += std::min(error * error, cap_px * cap_px);
  }
  return std::sqrt(sum / static_cast<double>(std::max<size_t>(1, points.in_body.size())));
}

/// Gauss-Newton on the reprojection errors with Cauchy weights of scale `scale_px`.
Rigid3 RefinedPose(const BodyPoints& points, Rigid3 pose, double scale_px) {
  constexpr int kIterations = 8;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    Eigen::Matrix<double, 6, 6> matrix = Eigen::Matrix<double, 6, 6>::Zero();
    Eigen::Matrix<double, 6, 1> gradient = Eigen::Matrix<double, 6, 1>::Zero();
    for (size_t i = 0; i < points.in_body.size(); ++i) {
      const Eigen::Vector3d x = pose * points.in_body[i];
      if (x.z() <= 0) continue;
      const Eigen::Vector2d error = points.focal_px * (x.hnormalized() - points.normalized[i]);
      const double weight = 1.0 / (1.0 + error.squaredNorm() / (scale_px * scale_px));
      Eigen::Matrix<double, 2, 3> by_point;
      by_point << 1, 0, -x.x() / x.z(), 0, 1, -x.y() / x.z();
      by_point *= points.focal_px / x.z();
      Eigen::Matrix<double, 2, 6> row;
      row << -by_point * CrossMatrix(x), by_point;
      matrix += weight * row.transpose() * row;
      gradient += weight * row.transpose() * error;
    }
    const Eigen::Matrix<double, 6, 1> step = -matrix.ldlt().solve(gradient);
    if (!step.allFinite()) return pose;
    const Eigen::Quaterniond turn = RotationOf(step.head<3>());
    pose = {(turn * pose.rotation).normalized(), turn * pose.translation + step.tail<3>()};
  }
  return pose;
}

const Rigid3& BodyFromFace(const Body& body, size_t face) {
  const auto place = std::find(body.faces.begin(), body.faces.end(), face) - body.faces.begin();
  return body.body_from_face[static_cast<size_t>(place)];
}

BodyPoints PointsOf(const PointSource& source, const Body& body,
                    const std::vector<const FaceView*>& views) {
  BodyPoints points;
  points.focal_px = source.intrinsics.MeanFocal_px();
  for (const FaceView* view : views) {
    AppendPoints(source, *view, BodyFromFace(body, view->face), points);
  }
  return points;
}

double Cap_px(const CameraIntrinsics& intrinsics) {
  return kCapShare * std::max(intrinsics.width_px, intrinsics.height_px);
}

/// Hypotheses of the single faces, judged by all corners of the body; best first. Of each face so
/// many corners are looked at.
std::vector<PoseHypothesis> FaceHypotheses(const BodySearch& search, const BodyViews& picture,
                                           const CameraIntrinsics& intrinsics,
                                           size_t most_corners) {
  const PointSource source = {search.problem, intrinsics, most_corners};
  const Body& body = search.bodies[picture.body];
  const BodyPoints all = PointsOf(source, body, picture.views);
  std::vector<PoseHypothesis> hypotheses;
  for (const FaceView* view : picture.views) {
    if (view->corners.size() < static_cast<size_t>(search.min_corners)) continue;
    BodyPoints plane;
    AppendPoints(source, *view, Rigid3{}, plane);
    if (plane.in_body.size() < 4) continue;
    const Rigid3 face_from_body = BodyFromFace(body, view->face).Inverse();
    for (const Rigid3& cam_from_face : PlanarPoses(plane)) {
      const Rigid3 cam_from_body = cam_from_face * face_from_body;
      hypotheses.push_back({cam_from_body, CappedError_px(all, cam_from_body, Cap_px(intrinsics))});
    }
  }
  std::stable_sort(hypotheses.begin(), hypotheses.end(),
                   [](const auto& a, const auto& b) { return a.error_px < b.error_px; });
  return hypotheses;
}

bool SamePose(const Rigid3& a, const Rigid3& b) {
  constexpr double kSameRotation_rad = 0.01;
  constexpr double kSamePosition = 0.01;  // share of the distance
  return RotationAngle_rad(a.rotation, b.rotation) < kSameRotation_rad &&
         (a.translation - b.translation).norm() < kSamePosition * a.translation.norm();
}

CameraIntrinsics LensOf(double focal_px, const SightedCamera& camera) {
  return {CameraModel::kOpencv,
          camera.width_px,
          camera.height_px,
          {focal_px, focal_px, 0.5 * camera.width_px, 0.5 * camera.height_px, 0, 0, 0, 0}};
}

/// The focal length, of a geometric series, with which the pictures' poses leave the least error.
double SearchFocal_px(const BodySearch& search, const std::vector<BodyViews>& seen,
                      const SightedCamera& camera) {
  constexpr double kShortest = 0.45, kLongest = 6.0, kRatio = 1.12;  // of the larger side
  const double side = std::max(camera.width_px, camera.height_px);
  double best_px = side, least = std::numeric_limits<double>::infinity();
  for (double share = kShortest; share < kLongest; share *= kRatio) {
    const CameraIntrinsics lens = LensOf(share * side, camera);
    double sum = 0;
    for (size_t i = 0; i < std::min(seen.size(), kMostSearchPictures); ++i) {
      const auto hypotheses = FaceHypotheses(search, seen[i], lens, kMostSearchCorners);
      sum += hypotheses.empty() ? 0 : std::pow(hypotheses.front().error_px, 2);
    }
    if (sum < least) {
      least = sum;
      best_px = share * side;
    }
  }
  return best_px;
}

/// One camera and its pictures as a problem of their own: the camera is the rig, each picture of a
/// body a shot.
struct LensProblem {
  std::vector<FaceView> views;
  RigModel model;
};

LensProblem MakeLensProblem(const BodySearch& search, const std::vector<BodyViews>& seen,
                            const CameraIntrinsics& lens) {
  LensProblem one;
  one.model.intrinsics = {lens};
  one.model.cam_from_rig = {Rigid3{}};
  one.model.faces = DrawnFaces(search.problem.board);
  for (const Body& body : search.bodies) {
    for (size_t i = 0; i < body.faces.size(); ++i) {
      one.model.faces[body.faces[i]].board_from_face = body.body_from_face[i];
    }
  }
  for (const BodyViews& picture : seen) {
    const auto poses = PoseHypotheses(search, picture, lens);
    if (poses.empty()) continue;
    for (const FaceView* view : picture.views) {
      one.views.push_back(*view);
      one.views.back().camera = 0;
      one.views.back().shot = one.model.rig_from_board.size();
    }
    one.model.rig_from_board.push_back(poses.front().cam_from_body);
  }
  return one;
}

/// The pictures with the most corners first.
std::vector<BodyViews> LargestFirst(const std::vector<BodyViews>& seen) {
  std::vector<BodyViews> ordered = seen;
  const auto corners = [](const BodyViews& picture) {
    size_t count = 0;
    for (const FaceView* view : picture.views) count += view->corners.size();
    return count;
  };
  std::stable_sort(ordered.begin(), ordered.end(),
                   [&](const BodyViews& a, const BodyViews& b) { return corners(a) > corners(b); });
  return ordered;
}

}  // namespace

std::vector<PoseHypothesis> PoseHypotheses(const BodySearch& search, const BodyViews& picture,
                                           const CameraIntrinsics& intrinsics) {
  const BodyPoints all =
      PointsOf({search.problem, intrinsics}, search.bodies[picture.body], picture.views);
  std::vector<PoseHypothesis> distinct;
  for (PoseHypothesis& raw : FaceHypotheses(search, picture, intrinsics, SIZE_MAX)) {
    raw.cam_from_body = RefinedPose(all, raw.cam_from_body, std::max(raw.error_px, 1.0));
    raw.error_px = CappedError_px(all, raw.cam_from_body, Cap_px(intrinsics));
    const bool known =
        std::any_of(distinct.begin(), distinct.end(), [&](const PoseHypothesis& other) {
          return SamePose(other.cam_from_body, raw.cam_from_body);
        });
    if (!known) distinct.push_back(raw);
  }
  std::stable_sort(distinct.begin(), distinct.end(),
                   [](const auto& a, const auto& b) { return a.error_px < b.error_px; });
  if (distinct.empty()) return distinct;
  const double most = kNearlyAsGood * std::max(distinct.front().error_px, kErrorFloor_px);
  std::erase_if(distinct, [&](const PoseHypothesis& pose) { return pose.error_px > most; });
  return distinct;
}

std::optional<CameraIntrinsics> StartLens(const BodySearch& search,
                                          const std::vector<BodyViews>& seen,
                                          const SightedCamera& camera) {
  const std::vector<BodyViews> ordered = LargestFirst(seen);  // the search looks at a few
  const double focal_px = SearchFocal_px(search, ordered, camera);
  const CameraIntrinsics searched = LensOf(focal_px, camera);
  LensProblem one = MakeLensProblem(search, ordered, searched);
  if (one.model.rig_from_board.empty()) return std::nullopt;
  ThreadPool alone(1);
  RunContext context{alone};
  RigSolveOptions solve;
  solve.free = {.cameras = false, .intrinsics = true, .focal_only = true, .faces = false};
  solve.function_tolerance = 1e-4;
  solve.max_iterations = 20;
  for (const bool focal_only : {true, false}) {
    solve.free.focal_only = focal_only;
    solve.loss_scale = 3 * NoiseScale(one.model, search.problem.shape, one.views);
    if (!SolveRig(search.problem, one.views, solve, one.model, context)) return searched;
  }
  const double ratio = one.model.intrinsics[0].MeanFocal_px() / focal_px;
  const bool plausible = ratio > 0.5 && ratio < 2.0;
  return plausible ? one.model.intrinsics[0] : searched;
}

}  // namespace rotunda::rig
