#include "tests/support/reconstruction_near.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdio>

namespace rotunda::test {
namespace {

Sim3 FitCenters(const std::vector<Eigen::Vector3d>& source,
                const std::vector<Eigen::Vector3d>& target) {
  Eigen::Matrix3Xd a(3, source.size()), b(3, source.size());
  for (size_t i = 0; i < source.size(); ++i) {
    a.col(i) = source[i];
    b.col(i) = target[i];
  }
  const Eigen::Matrix4d m = Eigen::umeyama(a, b, true);
  Sim3 fit;
  fit.scale = m.topLeftCorner<3, 3>().col(0).norm();
  fit.rotation = Eigen::Quaterniond(Eigen::Matrix3d(m.topLeftCorner<3, 3>() / fit.scale));
  fit.translation = m.topRightCorner<3, 1>();
  return fit;
}

}  // namespace

PoseErrors ErrorsOf(const sfm::Reconstruction& reconstruction,
                    const std::vector<Rigid3>& cam_from_truth) {
  PoseErrors errors;
  std::vector<Eigen::Vector3d> source, target;
  for (size_t i = 0; i < cam_from_truth.size(); ++i) {
    if (!reconstruction.Registered(ImageId(i))) continue;
    errors.images.push_back(ImageId(i));
    source.push_back(reconstruction.cam_from_model[i]->OriginInSource());
    target.push_back(cam_from_truth[i].OriginInSource());
  }
  errors.truth_from_model = FitCenters(source, target);
  for (size_t k = 0; k < errors.images.size(); ++k) {
    const size_t i = errors.images[k].index();
    const Rigid3 aligned =
        TransformPose(errors.truth_from_model, *reconstruction.cam_from_model[i]);
    errors.rotation_rad.push_back(RotationAngle_rad(aligned.rotation, cam_from_truth[i].rotation));
    errors.position.push_back((aligned.OriginInSource() - target[k]).norm());
    errors.max_rotation_rad = std::max(errors.max_rotation_rad, errors.rotation_rad.back());
    errors.max_position = std::max(errors.max_position, errors.position.back());
  }
  return errors;
}

std::string NotNear(const sfm::Reconstruction& reconstruction,
                    const std::vector<Rigid3>& cam_from_truth, double max_rotation_rad,
                    double max_position) {
  const PoseErrors errors = ErrorsOf(reconstruction, cam_from_truth);
  if (errors.images.size() != cam_from_truth.size()) {
    return std::to_string(errors.images.size()) + " of " + std::to_string(cam_from_truth.size()) +
           " cameras are registered";
  }
  if (errors.max_rotation_rad <= max_rotation_rad && errors.max_position <= max_position) return "";
  char text[200];
  std::snprintf(text, sizeof text, "largest errors %.3g rad and %.3g, allowed %.3g and %.3g",
                errors.max_rotation_rad, errors.max_position, max_rotation_rad, max_position);
  return text;
}

std::string Difference(const sfm::Reconstruction& a, const sfm::Reconstruction& b) {
  if (a.cam_from_model.size() != b.cam_from_model.size()) return "number of images";
  for (size_t i = 0; i < a.cam_from_model.size(); ++i) {
    const auto &pose_a = a.cam_from_model[i], &pose_b = b.cam_from_model[i];
    const bool same = pose_a && pose_b ? pose_a->Matrix() == pose_b->Matrix()
                                       : pose_a.has_value() == pose_b.has_value();
    if (!same) return "pose of image " + std::to_string(i);
  }
  for (size_t l = 0; l < a.intrinsics.lenses.size(); ++l) {
    if (a.intrinsics.lenses[l].params != b.intrinsics.lenses[l].params) {
      return "lens " + std::to_string(l);
    }
  }
  if (a.points.size() != b.points.size()) return "number of points";
  for (size_t p = 0; p < a.points.size(); ++p) {
    if (a.points[p].position != b.points[p].position ||
        a.points[p].observations != b.points[p].observations) {
      return "point " + std::to_string(p);
    }
  }
  return "";
}

std::string Difference(const std::vector<sfm::Reconstruction>& a,
                       const std::vector<sfm::Reconstruction>& b) {
  if (a.size() != b.size()) return "number of models";
  for (size_t m = 0; m < a.size(); ++m) {
    const std::string difference = Difference(a[m], b[m]);
    if (!difference.empty()) return "model " + std::to_string(m) + ": " + difference;
  }
  return "";
}

}  // namespace rotunda::test
