#include "sfm/reconstruction.h"

#include <cmath>

namespace rotunda::sfm {

size_t RegisteredCount(const Reconstruction& reconstruction) {
  size_t count = 0;
  for (const auto& pose : reconstruction.cam_from_model) count += pose.has_value();
  return count;
}

std::optional<double> ReprojectionError_px(const Reconstruction& reconstruction,
                                           const Features& features, const Point3& point,
                                           const Observation& observation) {
  const std::optional<Rigid3>& cam_from_model =
      reconstruction.cam_from_model[observation.image.index()];
  if (!cam_from_model) return std::nullopt;
  const std::optional<Eigen::Vector2d> pixel =
      reconstruction.intrinsics.of(observation.image).Project(*cam_from_model * point.position);
  if (!pixel) return std::nullopt;
  const Keypoint& keypoint =
      features.image(observation.image).keypoints[observation.keypoint.index()];
  return std::hypot(pixel->x() - keypoint.x_px, pixel->y() - keypoint.y_px);
}

ReprojectionSummary SummarizeReprojection(const Reconstruction& reconstruction,
                                          const Features& features) {
  ReprojectionSummary summary;
  summary.images.resize(reconstruction.cam_from_model.size());
  std::vector<double> squares(summary.images.size(), 0.0);
  size_t points = 0;
  for (const Point3& point : reconstruction.points) {
    double sum_px = 0;
    size_t count = 0;
    for (const Observation& observation : point.observations) {
      const auto error_px = ReprojectionError_px(reconstruction, features, point, observation);
      if (!error_px) continue;
      sum_px += *error_px;
      ++count;
      squares[observation.image.index()] += *error_px * *error_px;
      ++summary.images[observation.image.index()].observations;
    }
    if (count == 0) continue;
    summary.mean_over_points_px += sum_px / static_cast<double>(count);
    ++points;
  }
  double total = 0;
  for (size_t i = 0; i < squares.size(); ++i) {
    ImageResidual& image = summary.images[i];
    total += squares[i];
    summary.observations += image.observations;
    if (image.observations > 0) image.rms_px = std::sqrt(squares[i] / image.observations);
  }
  if (summary.observations > 0) summary.rms_px = std::sqrt(total / summary.observations);
  if (points > 0) summary.mean_over_points_px /= static_cast<double>(points);
  return summary;
}

Reconstruction Transformed(const Reconstruction& reconstruction, const Sim3& target_from_model) {
  Reconstruction transformed = reconstruction;
  for (auto& pose : transformed.cam_from_model) {
    if (pose) pose = TransformPose(target_from_model, *pose);
  }
  for (Point3& point : transformed.points) point.position = target_from_model * point.position;
  return transformed;
}

Reconstruction WithColors(Reconstruction reconstruction, const Features& features) {
  for (Point3& point : reconstruction.points) {
    std::array<size_t, 3> sum = {0, 0, 0};
    size_t count = 0;
    for (const Observation& observation : point.observations) {
      const auto& colors = features.image(observation.image).colors_rgb;
      if (observation.keypoint.index() >= colors.size()) continue;
      for (size_t c = 0; c < 3; ++c) sum[c] += colors[observation.keypoint.index()][c];
      ++count;
    }
    if (count == 0) continue;
    for (size_t c = 0; c < 3; ++c) {
      point.color_rgb[c] = static_cast<uint8_t>((sum[c] + count / 2) / count);
    }
  }
  return reconstruction;
}

}  // namespace rotunda::sfm
