#include "tests/bench/disambiguation_layout.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <vector>

#include "tests/bench/bench_process.h"

namespace rotunda::bench {
namespace {

constexpr int kSide_px = 1000;
constexpr int kMargin_px = 40;
constexpr int kWedge_px = 26;            // length of a camera's axis in the drawing
constexpr double kWedgeHalfWidth = 0.5;  // of its length
/// Points beyond these shares of either coordinate are strays: they do not set the drawing's scale.
constexpr double kStrayShare = 0.1;

struct WorldView {
  Eigen::Matrix<double, 2, 3> plan_from_model;  // right and down in the drawing
  std::vector<Eigen::Vector2d> points;
  std::vector<cv::Scalar> colors_bgr;
  std::vector<Eigen::Vector2d> centers;   // of the registered cameras
  std::vector<Eigen::Vector2d> forwards;  // their optical axes, not normalised
  std::vector<size_t> numbers;            // in the order of the names
};

/// The floor plan: x along the first camera's right, so that the first camera looks up the page.
Eigen::Matrix<double, 2, 3> PlanFromModel(const sfm::Reconstruction& model) {
  Eigen::Vector3d down = Eigen::Vector3d::Zero();
  std::optional<Eigen::Vector3d> right;
  for (const auto& pose : model.cam_from_model) {
    if (!pose) continue;
    const Eigen::Quaterniond model_from_cam = pose->rotation.conjugate();
    down += model_from_cam * Eigen::Vector3d::UnitY();
    if (!right) right = model_from_cam * Eigen::Vector3d::UnitX();
  }
  if (!right) Die("a model without a camera cannot be drawn");
  down.normalize();
  const Eigen::Vector3d x = (*right - right->dot(down) * down).normalized();
  Eigen::Matrix<double, 2, 3> plan;
  plan << x.transpose(), down.cross(x).transpose();
  return plan;
}

WorldView ViewFromAbove(const sfm::ColmapModel& model) {
  const sfm::Reconstruction& reconstruction = model.reconstruction;
  WorldView view;
  view.plan_from_model = PlanFromModel(reconstruction);
  for (const sfm::Point3& point : reconstruction.points) {
    view.points.push_back(view.plan_from_model * point.position);
    view.colors_bgr.emplace_back(point.color_rgb[2], point.color_rgb[1], point.color_rgb[0]);
  }
  std::vector<std::string> names = model.image_names;
  std::sort(names.begin(), names.end());
  for (size_t i = 0; i < model.image_names.size(); ++i) {
    const auto& pose = reconstruction.cam_from_model[i];
    if (!pose) continue;
    view.centers.push_back(view.plan_from_model * pose->OriginInSource());
    view.forwards.push_back(view.plan_from_model *
                            (pose->rotation.conjugate() * Eigen::Vector3d::UnitZ()));
    const auto place = std::find(names.begin(), names.end(), model.image_names[i]);
    view.numbers.push_back(static_cast<size_t>(place - names.begin()));
  }
  return view;
}

/// All cameras and all points but the strays.
Eigen::AlignedBox2d Extent(const WorldView& view) {
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector2d& center : view.centers) box.extend(center);
  if (view.points.empty()) return box;
  Eigen::Vector2d least, most;
  for (int axis = 0; axis < 2; ++axis) {
    std::vector<double> values;
    for (const Eigen::Vector2d& point : view.points) values.push_back(point[axis]);
    std::sort(values.begin(), values.end());
    const auto strays = static_cast<size_t>(kStrayShare * static_cast<double>(values.size()));
    least[axis] = values[strays];
    most[axis] = values[values.size() - 1 - strays];
  }
  return box.extend(least).extend(most);
}

void DrawCamera(const cv::Point2d& center, const Eigen::Vector2d& forward, size_t number,
                cv::Mat& drawing) {
  const Eigen::Vector2d axis = forward.normalized() * kWedge_px;
  const Eigen::Vector2d side = kWedgeHalfWidth * Eigen::Vector2d(-axis.y(), axis.x());
  const auto corner = [&](const Eigen::Vector2d& offset) {
    return cv::Point(cvRound(center.x + offset.x()), cvRound(center.y + offset.y()));
  };
  const cv::Scalar color(200, 60, 0);
  const std::vector<cv::Point> wedge = {corner({0, 0}), corner(axis + side), corner(axis - side)};
  cv::polylines(drawing, wedge, true, color, 1, cv::LINE_AA);
  cv::putText(drawing, std::to_string(number), corner(-0.5 * axis), cv::FONT_HERSHEY_SIMPLEX, 0.4,
              color, 1, cv::LINE_AA);
}

cv::Mat Draw(const WorldView& view) {
  const Eigen::AlignedBox2d box = Extent(view);
  const double scale = (kSide_px - 2 * kMargin_px) / std::max(box.sizes().maxCoeff(), 1e-9);
  const auto place = [&](const Eigen::Vector2d& p) {
    const Eigen::Vector2d at = scale * (p - box.center());
    return cv::Point2d(0.5 * kSide_px + at.x(), 0.5 * kSide_px + at.y());
  };
  cv::Mat drawing(kSide_px, kSide_px, CV_8UC3, cv::Scalar(255, 255, 255));
  const cv::Rect2d page(0, 0, kSide_px, kSide_px);
  for (size_t i = 0; i < view.points.size(); ++i) {
    const cv::Point2d at = place(view.points[i]);
    if (page.contains(at)) cv::circle(drawing, at, 1, view.colors_bgr[i], cv::FILLED);
  }
  for (size_t i = 0; i < view.centers.size(); ++i) {
    DrawCamera(place(view.centers[i]), view.forwards[i], view.numbers[i], drawing);
  }
  return drawing;
}

}  // namespace

cv::Mat LayoutDrawing(const sfm::ColmapModel& model) { return Draw(ViewFromAbove(model)); }

}  // namespace rotunda::bench
