#include "sfm/bundle_adjustment.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <string>

#include "sfm/bundle_ceres.h"
#include "sfm/bundle_schur.h"

namespace rotunda::sfm {
namespace {

/// Stiffness of the scale gauge; at the minimum its residual is zero, whatever it is.
constexpr double kGaugeWeight = 1e4;

/// One bundle adjustment: which points it is about, what is held, and the way back.
class Adjustment {
 public:
  Adjustment(Reconstruction& reconstruction, const Features& features,
             const std::vector<ImageId>& free_images)
      : reconstruction_(reconstruction), features_(features) {
    problem_.lenses = reconstruction.intrinsics.lenses;
    problem_.poses.resize(reconstruction.cam_from_model.size());
    for (size_t i = 0; i < problem_.poses.size(); ++i) LoadPose(i);
    for (const ImageId image : free_images) problem_.poses[image.index()].free = true;
    problem_.first_observation.push_back(0);
    for (size_t p = 0; p < reconstruction.points.size(); ++p) AddPoint(p);
    if (!points_.empty()) HoldGauge();
  }

  /// No free image sees a point of two images.
  bool empty() const { return points_.empty(); }

  Result<BundleAdjustmentReport> Solve(const BundleAdjustmentOptions& options,
                                       RunContext& context) {
    if (options.refine_intrinsics || FreeImages(problem_) > kMaxDenseImages) {
      return SolveWithCeres(problem_, options, context.stop);
    }
    return SolveByPointElimination(problem_, options, context);
  }

  void Store() {
    for (size_t i = 0; i < problem_.poses.size(); ++i) {
      const BundlePose& pose = problem_.poses[i];
      if (!pose.used || !pose.free) continue;
      reconstruction_.cam_from_model[i] = Rigid3{pose.rotation, -(pose.rotation * pose.center)};
    }
    for (size_t p = 0; p < points_.size(); ++p) {
      reconstruction_.points[points_[p]].position = problem_.points[p];
    }
    for (size_t l = 0; l < problem_.lenses.size(); ++l) {
      reconstruction_.intrinsics.lenses[l].params = problem_.lenses[l].params;
    }
  }

 private:
  void LoadPose(size_t image) {
    const std::optional<Rigid3>& cam_from_model = reconstruction_.cam_from_model[image];
    BundlePose& pose = problem_.poses[image];
    pose.lens = reconstruction_.intrinsics.lens_of_image[image];
    if (!cam_from_model) return;
    pose.rotation = cam_from_model->rotation;
    pose.center = cam_from_model->OriginInSource();
  }

  void AddPoint(size_t p) {
    const Point3& point = reconstruction_.points[p];
    size_t registered = 0;
    bool seen_by_free = false;
    for (const Observation& observation : point.observations) {
      registered += reconstruction_.Registered(observation.image);
      seen_by_free = seen_by_free || problem_.poses[observation.image.index()].free;
    }
    if (registered < 2 || !seen_by_free) return;
    points_.push_back(p);
    problem_.points.push_back(point.position);
    for (const Observation& observation : point.observations) {
      if (reconstruction_.Registered(observation.image)) AddObservation(observation);
    }
    problem_.first_observation.push_back(problem_.observations.size());
  }

  void AddObservation(const Observation& observation) {
    const Keypoint& keypoint =
        features_.image(observation.image).keypoints[observation.keypoint.index()];
    problem_.observations.push_back({{keypoint.x_px, keypoint.y_px},
                                     1.0 / KeypointSigma_px(keypoint),
                                     static_cast<uint32_t>(observation.image.index())});
    problem_.poses[observation.image.index()].used = true;
  }

  void HoldGauge() {
    std::vector<size_t> held;
    for (size_t i = 0; i < problem_.poses.size(); ++i) {
      if (problem_.poses[i].used && !problem_.poses[i].free) held.push_back(i);
    }
    if (held.empty()) {
      const auto first = std::find_if(problem_.poses.begin(), problem_.poses.end(),
                                      [](const BundlePose& pose) { return pose.used; });
      first->free = false;
      held.push_back(static_cast<size_t>(first - problem_.poses.begin()));
    }
    if (held.size() == 1) HoldScale(problem_.poses[held.front()].center);
  }

  void HoldScale(const Eigen::Vector3d& from) {
    double distance = 0;
    for (size_t i = 0; i < problem_.poses.size(); ++i) {
      const BundlePose& pose = problem_.poses[i];
      const Eigen::Vector3d arm = pose.center - from;
      if (!pose.used || arm.norm() <= distance) continue;
      distance = arm.norm();
      problem_.scale_gauge = {i, from, arm / arm.squaredNorm(), kGaugeWeight};
    }
  }

  Reconstruction& reconstruction_;
  const Features& features_;
  BundleProblem problem_;
  std::vector<size_t> points_;  // places in the reconstruction
};

}  // namespace

size_t FreeImages(const BundleProblem& problem) {
  return static_cast<size_t>(
      std::count_if(problem.poses.begin(), problem.poses.end(),
                    [](const BundlePose& pose) { return pose.used && pose.free; }));
}

Status BundleAdjustmentOptions::Validate() const {
  const auto bad = [](const char* field, double value, const char* expected) {
    return Error{ErrorCode::kInvalidArgument,
                 std::to_string(value) + " is out of range, expected " + expected, field};
  };
  if (!(loss_scale > 0)) return bad("loss_scale", loss_scale, "> 0");
  if (max_iterations < 1) return bad("max_iterations", max_iterations, ">= 1");
  if (!(function_tolerance >= 0)) return bad("function_tolerance", function_tolerance, ">= 0");
  return {};
}

Result<BundleAdjustmentReport> AdjustBundle(Reconstruction& reconstruction,
                                            const Features& features,
                                            const std::vector<ImageId>& free_images,
                                            const BundleAdjustmentOptions& options,
                                            RunContext& context) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "cancelled", "bundle adjustment"};
  Adjustment adjustment(reconstruction, features, free_images);
  if (adjustment.empty()) {
    return Error{ErrorCode::kInvalidArgument, "no free image sees a point of two images",
                 "bundle adjustment"};
  }
  ROTUNDA_ASSIGN_OR_RETURN(const BundleAdjustmentReport report, adjustment.Solve(options, context));
  adjustment.Store();
  return report;
}

double KeypointSigma_px(const Keypoint& keypoint) {
  // The first two were fitted to the residuals of adjusted photographs and renderings over the
  // scale. The third is not noise: the middle of a blob on a curved surface goes by as it is seen
  // from elsewhere (its square over the radius of curvature), the same way for all of a surface, so
  // that many do not make it less. On rendered bodies keypoints below 1 px turned all cameras by
  // 0.001 deg together, those of 2.5 px by 0.04, above 7 px by 0.19; more than this weight changed
  // little.
  constexpr double kFloor_px = 0.13;
  constexpr double kSlope = 0.052;
  constexpr double kCurved_per_px = 0.1;
  const double scale = keypoint.scale_px;
  return std::hypot(kFloor_px, kSlope * scale, kCurved_per_px * scale * scale);
}

}  // namespace rotunda::sfm
