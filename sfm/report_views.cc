#include "sfm/report_views.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

#include "sfm/core/html_text.h"

namespace rotunda::sfm::report {
namespace {

constexpr size_t kMaxPoints = 6000;
constexpr double kViewWidth_px = 640;
constexpr double kMapWidth_px = 1280;
/// Points are painted far to near in this many layers; one layer's points of one colour share a
/// path, which keeps the file small.
constexpr int kDepthLayers = 10;
/// Frames of the views: points beyond these percentiles and cameras farther from the median centre
/// than this many median distances do not set the scale.
constexpr double kPointShareCut = 0.02;
constexpr double kStrayCamera = 4.0;
/// Cameras surround the axis when no gap between neighbouring azimuths is wider.
constexpr double kMaxAzimuthGap_deg = 120.0;

/// A camera with a place to be drawn at: its own, or the calibration's when it has none.
struct PlacedCamera {
  size_t camera = 0;
  Rigid3 cam_from_model;
  CameraIntrinsics intrinsics;
  bool registered = false;
};

/// What is in view along one axis of the model, and of the paper.
struct Range {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();
  void Include(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
  double Length() const { return high - low; }
  double Middle() const { return 0.5 * (low + high); }
  bool Contains(double value) const { return value >= low && value <= high; }
};

struct Scene {
  const ReportInput& input;
  const Facts& facts;
  const SceneAxes& axes;
  std::vector<PlacedCamera> cameras = {};
  std::vector<Point3> points = {};  // those drawn
  double ring_radius = 0;           // of the azimuth ring, 0: none
  double frustum_depth = 0;         // model units
  // What each view shows, model units.
  Range top_right = {}, top_up = {}, side_right = {}, side_up = {};
};

/// One view on paper.
struct Canvas {
  ViewAxes axes;
  Range right, up;
  double px_per_unit = 1;
  double width_px = 0, height_px = 0;

  Eigen::Vector2d Place(const Eigen::Vector3d& x) const {
    return {(axes.right.dot(x) - right.low) * px_per_unit,
            (up.high - axes.up.dot(x)) * px_per_unit};
  }
  bool InView(const Eigen::Vector3d& x) const {
    return right.Contains(axes.right.dot(x)) && up.Contains(axes.up.dot(x));
  }
};

std::string Pair(const Eigen::Vector2d& p) { return Coordinate(p.x()) + " " + Coordinate(p.y()); }

std::string Text(const Eigen::Vector2d& at, const std::string& css, const std::string& text) {
  return "<text class=\"" + css + "\" x=\"" + Coordinate(at.x()) + "\" y=\"" + Coordinate(at.y()) +
         "\">" + Escaped(text) + "</text>";
}

std::string Line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const std::string& css) {
  return "<path class=\"" + css + "\" d=\"M" + Pair(a) + "L" + Pair(b) + "\"/>";
}

std::string OpenSvg(const std::string& css, const std::string& label, double width_px,
                    double height_px) {
  return "<svg class=\"" + css + "\" role=\"img\" aria-label=\"" + Escaped(label) +
         "\" viewBox=\"0 0 " + Coordinate(width_px) + " " + Coordinate(height_px) + "\">\n";
}

double Median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

std::vector<PlacedCamera> PlaceCameras(const ReportInput& input) {
  std::vector<PlacedCamera> placed;
  const bool in_calibration_frame = input.calibration && input.poses.aligned_to;
  for (size_t i = 0; i < input.poses.cameras.size(); ++i) {
    const CameraPose& pose = input.poses.cameras[i];
    if (pose.registered) {
      placed.push_back({i, pose.cam_from_rig, pose.intrinsics, true});
    } else if (in_calibration_frame) {
      const CalibratedCamera* expected = input.calibration->Find(pose.camera);
      if (expected) placed.push_back({i, expected->cam_from_rig, expected->intrinsics, false});
    }
  }
  return placed;
}

/// Cameras whose centre is not far out; a camera gone astray must not shrink the others to a dot.
std::vector<Eigen::Vector3d> CentresWithoutStrays(const std::vector<PlacedCamera>& cameras) {
  Eigen::Vector3d middle;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    for (const auto& c : cameras) values.push_back(c.cam_from_model.OriginInSource()[axis]);
    middle[axis] = Median(std::move(values));
  }
  std::vector<double> distances;
  for (const auto& c : cameras) {
    distances.push_back((c.cam_from_model.OriginInSource() - middle).norm());
  }
  const double limit = kStrayCamera * Median(distances);
  std::vector<Eigen::Vector3d> centres;
  for (size_t i = 0; i < cameras.size(); ++i) {
    if (distances[i] <= limit) centres.push_back(cameras[i].cam_from_model.OriginInSource());
  }
  return centres;
}

Range PointRange(const std::vector<Point3>& points, const Eigen::Vector3d& axis) {
  std::vector<double> values;
  for (const Point3& point : points) values.push_back(axis.dot(point.position));
  Range range;
  if (values.empty()) return range;
  std::sort(values.begin(), values.end());
  const size_t cut = static_cast<size_t>(kPointShareCut * static_cast<double>(values.size()));
  range.Include(values[cut]);
  range.Include(values[values.size() - 1 - cut]);
  return range;
}

/// Radius of the ring around cameras that encircle the rig's axis.
double RingRadius(const std::vector<Eigen::Vector3d>& centres) {
  constexpr double kRoomForFrusta = 1.12;
  std::vector<double> radii;
  for (const auto& c : centres) radii.push_back(c.head<2>().norm());
  return kRoomForFrusta * Median(std::move(radii));
}

void FrameScene(Scene& scene) {
  constexpr double kFrustumShare = 0.05;  // of the scene's extent
  constexpr double kMarginShare = 0.075;
  const auto centres = CentresWithoutStrays(scene.cameras);
  const auto range = [&](const Eigen::Vector3d& axis) {
    Range result = PointRange(scene.input.reconstruction.points, axis);
    for (const auto& centre : centres) result.Include(axis.dot(centre));
    return result;
  };
  scene.top_right = range(scene.axes.top.right);
  scene.top_up = range(scene.axes.top.up);
  scene.side_right = range(scene.axes.side.right);
  scene.side_up = range(scene.axes.side.up);
  if (scene.axes.encircling) {
    scene.ring_radius = RingRadius(centres);
    for (const double end : {-scene.ring_radius, scene.ring_radius}) {
      scene.top_right.Include(end);
      scene.top_up.Include(end);
    }
  }
  if (scene.axes.rig_frame) scene.side_up.Include(0.0);
  const double extent =
      std::max({scene.side_right.Length(), scene.side_up.Length(), scene.top_up.Length()});
  const double margin = kMarginShare * (std::isfinite(extent) && extent > 0 ? extent : 1.0);
  scene.frustum_depth = kFrustumShare / kMarginShare * margin;
  for (Range* r : {&scene.top_right, &scene.top_up, &scene.side_right, &scene.side_up}) {
    if (r->Length() < 0) r->Include(0.0);
    r->low -= margin;
    r->high += margin;
  }
}

/// Every n-th point, so that at most kMaxPoints are drawn.
std::vector<Point3> ChoosePoints(const std::vector<Point3>& points) {
  const size_t count = std::min(points.size(), kMaxPoints);
  std::vector<Point3> chosen;
  chosen.reserve(count);
  for (size_t i = 0; i < count; ++i) {
    const Point3& point = points[i * points.size() / count];
    if (point.position.allFinite()) chosen.push_back({point.position, {}, point.color_rgb});
  }
  return chosen;
}

Canvas MakeCanvas(const ViewAxes& axes, const Range& right, const Range& up) {
  constexpr double kTallest = 1.25;  // height over width
  constexpr double kFooter_px = 34;  // room for the scale bar
  Canvas canvas{axes, right, up, 1, kViewWidth_px, 0};
  canvas.px_per_unit =
      std::min(kViewWidth_px / right.Length(), kTallest * kViewWidth_px / up.Length());
  const double half_width = 0.5 * kViewWidth_px / canvas.px_per_unit;
  canvas.right = {right.Middle() - half_width, right.Middle() + half_width};
  canvas.height_px = up.Length() * canvas.px_per_unit + kFooter_px;
  canvas.up.low -= kFooter_px / canvas.px_per_unit;
  return canvas;
}

/// "#rgb" of a colour drawn towards the middle, to be seen on white paper and on a dark screen.
std::string PaperColour(const std::array<uint8_t, 3>& rgb) {
  constexpr std::string_view kHex = "0123456789abcdef";
  std::string text = "#";
  for (const uint8_t channel : rgb) {
    const double muted = 34.0 + channel * (214.0 - 34.0) / 255.0;
    text += kHex[static_cast<size_t>(std::lround(muted / 17.0))];
  }
  return text;
}

std::string DrawPoints(const Scene& scene, const Canvas& canvas) {
  const Eigen::Vector3d toward = canvas.axes.Toward();
  Range depth = PointRange(scene.points, toward);
  std::map<std::pair<int, std::string>, std::string> paths;  // by layer and colour
  for (const Point3& point : scene.points) {
    if (!canvas.InView(point.position)) continue;
    const double share = (toward.dot(point.position) - depth.low) / std::max(depth.Length(), 1e-12);
    const int layer = std::clamp(static_cast<int>(share * kDepthLayers), 0, kDepthLayers - 1);
    paths[{layer, PaperColour(point.color_rgb)}] += "M" + Pair(canvas.Place(point.position)) + "h0";
  }
  std::string out = "<g class=\"points\">";
  for (const auto& [key, path] : paths) {
    out += "<path stroke=\"" + key.second + "\" d=\"" + path + "\"/>";
  }
  return out + "</g>\n";
}

/// Pyramid from the centre to the picture's four corners, lens distortion left out.
std::string FrustumPath(const PlacedCamera& camera, double depth, const Canvas& canvas) {
  const CameraIntrinsics& k = camera.intrinsics;
  const Rigid3 model_from_cam = camera.cam_from_model.Inverse();
  const auto corner = [&](double x_px, double y_px) {
    const Eigen::Vector3d ray((x_px - k.cx_px()) / k.fx_px(), (y_px - k.cy_px()) / k.fy_px(), 1.0);
    return Pair(canvas.Place(model_from_cam * (depth * ray)));
  };
  const std::string apex = Pair(canvas.Place(model_from_cam.translation));
  const std::string a = corner(0, 0), b = corner(k.width_px, 0);
  const std::string c = corner(k.width_px, k.height_px), d = corner(0, k.height_px);
  return "<path d=\"M" + apex + "L" + a + "L" + b + "ZM" + apex + "L" + c + "L" + d + "ZM" + a +
         "L" + b + "L" + c + "L" + d + "Z\"/>";
}

/// Dashed pyramid where the calibration has a moved camera, tied to where it is now.
std::string DrawDisplacement(const Scene& scene, const PlacedCamera& camera, const Canvas& canvas) {
  if (!scene.facts.cameras[camera.camera].moved || !scene.input.calibration) return {};
  const CalibratedCamera* expected =
      scene.input.calibration->Find(scene.input.poses.cameras[camera.camera].camera);
  if (!expected) return {};
  const PlacedCamera before{camera.camera, expected->cam_from_rig, expected->intrinsics, false};
  return "<g class=\"before\">" + FrustumPath(before, scene.frustum_depth, canvas) +
         Line(canvas.Place(expected->cam_from_rig.OriginInSource()),
              canvas.Place(camera.cam_from_model.OriginInSource()), "tie") +
         "</g>";
}

/// Far to near, those that ask for attention last.
std::vector<const PlacedCamera*> PaintingOrder(const Scene& scene, const Eigen::Vector3d& toward) {
  std::vector<const PlacedCamera*> order;
  for (const PlacedCamera& camera : scene.cameras) order.push_back(&camera);
  std::stable_sort(order.begin(), order.end(), [&](const auto* a, const auto* b) {
    const Level level_a = scene.facts.cameras[a->camera].level;
    const Level level_b = scene.facts.cameras[b->camera].level;
    if (level_a != level_b) return level_a < level_b;
    return toward.dot(a->cam_from_model.OriginInSource()) <
           toward.dot(b->cam_from_model.OriginInSource());
  });
  return order;
}

std::string DrawCameras(const Scene& scene, const Canvas& canvas) {
  std::string out;
  for (const PlacedCamera* camera : PaintingOrder(scene, canvas.axes.Toward())) {
    const Eigen::Vector3d centre = camera->cam_from_model.OriginInSource();
    out += DrawDisplacement(scene, *camera, canvas);
    out += CameraLink(scene.input, scene.facts, camera->camera);
    if (canvas.InView(centre)) {
      out += FrustumPath(*camera, scene.frustum_depth, canvas);
    } else {
      // Out of the picture: a mark on its edge, in the right direction.
      const Eigen::Vector2d at = canvas.Place(centre);
      out += "<circle class=\"astray\" r=\"6\" cx=\"" +
             Coordinate(std::clamp(at.x(), 8.0, canvas.width_px - 8)) + "\" cy=\"" +
             Coordinate(std::clamp(at.y(), 8.0, canvas.height_px - 8)) + "\"/>";
    }
    out += "</a>\n";
  }
  return out;
}

/// The largest of 1, 2, 5 x 10^n that is at most `length`.
double NiceLength(double length) {
  const double power = std::pow(10.0, std::floor(std::log10(length)));
  const double lead = length / power;
  return power * (lead >= 5 ? 5 : lead >= 2 ? 2 : 1);
}

std::string DrawScaleBar(const Scene& scene, const Canvas& canvas) {
  constexpr double kShareOfWidth = 0.22;
  const double length = NiceLength(kShareOfWidth * canvas.width_px / canvas.px_per_unit);
  const double left = 16, y = canvas.height_px - 14, right = left + length * canvas.px_per_unit;
  const int decimals = std::max(0, -static_cast<int>(std::floor(std::log10(length) + 1e-9)));
  return Line({left, y}, {right, y}, "scale") + Line({left, y - 4}, {left, y + 4}, "scale") +
         Line({right, y - 4}, {right, y + 4}, "scale") +
         Text({right + 8, y + 4}, "label",
              Fixed(length, decimals) + (scene.input.poses.metric ? " m" : " model units"));
}

std::string DrawAzimuthRing(const Scene& scene, const Canvas& canvas) {
  constexpr const char* kNames[] = {"front", "left", "back", "right"};
  constexpr int kTicks = 24;
  const auto at = [&](double azimuth_rad, double radius) {
    return canvas.Place({radius * std::cos(azimuth_rad), radius * std::sin(azimuth_rad), 0.0});
  };
  const double r = scene.ring_radius;
  const Eigen::Vector2d middle = at(0, 0);
  std::string out = "<circle class=\"ring\" cx=\"" + Coordinate(middle.x()) + "\" cy=\"" +
                    Coordinate(middle.y()) + "\" r=\"" + Coordinate(r * canvas.px_per_unit) +
                    "\"/>";
  for (int i = 0; i < kTicks; ++i) {
    const double azimuth = i * 2 * kPi / kTicks;
    out += Line(at(azimuth, r * (i % 6 == 0 ? 0.97 : 0.985)), at(azimuth, r), "tick");
    if (i % 6 != 0) continue;
    const std::string name = kNames[i / 6];
    // Names to the right and left of the ring stand on end, to need no more room than the others.
    const Eigen::Vector2d place = at(azimuth, r * 1.05);
    const int turn_deg = i % 12 != 0 ? 0 : i == 0 ? 90 : -90;
    out += "<text class=\"label mid\" dy=\"4\" transform=\"translate(" + Pair(place) + ") rotate(" +
           std::to_string(turn_deg) + ")\">" + kNames[i / 6] + " " +
           std::to_string(i * 360 / kTicks) + "°</text>";
  }
  // The way a subject faces.
  const Eigen::Vector2d tip = at(0, r * 0.3), tail = at(0, r * 0.2);
  return out + Line(tail, tip, "arrow") + Line(tip, tip + Eigen::Vector2d(-6, -4), "arrow") +
         Line(tip, tip + Eigen::Vector2d(-6, 4), "arrow") + "\n";
}

std::string DrawFloor(const Canvas& canvas) {
  const double y = canvas.Place(Eigen::Vector3d::Zero()).y();
  const Eigen::Vector2d tip(canvas.width_px - 16, canvas.height_px - 14);
  return Line({0, y}, {canvas.width_px, y}, "ring") + Text({8, y - 6}, "label", "floor") +
         Line(tip + Eigen::Vector2d(-26, 0), tip, "arrow") +
         Line(tip, tip + Eigen::Vector2d(-6, -4), "arrow") +
         Line(tip, tip + Eigen::Vector2d(-6, 4), "arrow") +
         Text(tip + Eigen::Vector2d(-34, 4), "label end", "front");
}

std::string DrawTop(const Scene& scene) {
  const Canvas canvas = MakeCanvas(scene.axes.top, scene.top_right, scene.top_up);
  std::string out =
      OpenSvg("view", "Cameras and points from above", canvas.width_px, canvas.height_px);
  if (scene.axes.encircling) out += DrawAzimuthRing(scene, canvas);
  return out + DrawPoints(scene, canvas) + DrawCameras(scene, canvas) +
         DrawScaleBar(scene, canvas) + "</svg>";
}

std::string DrawSide(const Scene& scene) {
  const Canvas canvas = MakeCanvas(scene.axes.side, scene.side_right, scene.side_up);
  std::string out =
      OpenSvg("view", "Cameras and points from the side", canvas.width_px, canvas.height_px);
  if (scene.axes.rig_frame) out += DrawFloor(canvas);
  return out + DrawPoints(scene, canvas) + DrawCameras(scene, canvas) +
         DrawScaleBar(scene, canvas) + "</svg>";
}

double Azimuth_deg(const Eigen::Vector3d& x) { return DegFromRad(std::atan2(x.y(), x.x())); }

bool Encircle(const std::vector<PlacedCamera>& cameras) {
  std::vector<double> azimuths;
  for (const auto& c : cameras) azimuths.push_back(Azimuth_deg(c.cam_from_model.OriginInSource()));
  if (azimuths.empty()) return false;
  std::sort(azimuths.begin(), azimuths.end());
  double gap = azimuths.front() + 360.0 - azimuths.back();
  for (size_t i = 1; i < azimuths.size(); ++i) gap = std::max(gap, azimuths[i] - azimuths[i - 1]);
  return gap <= kMaxAzimuthGap_deg;
}

/// Distance to the nearest other place, of the closest tenth of the places.
double CloseSpacing(const std::vector<Eigen::Vector2d>& places) {
  std::vector<double> nearest;
  for (size_t i = 0; i < places.size(); ++i) {
    double best = std::numeric_limits<double>::infinity();
    for (size_t j = 0; j < places.size(); ++j) {
      if (i != j) best = std::min(best, (places[i] - places[j]).norm());
    }
    nearest.push_back(best);
  }
  std::sort(nearest.begin(), nearest.end());
  return nearest[nearest.size() / 10];
}

/// Cameras as cells by azimuth and height, seen from the middle of the rig: front in the middle,
/// the subject's left to the left.
std::string DrawMap(const Scene& scene) {
  constexpr double kTop_px = 26, kBottom_px = 26, kBody_px = 260, kCellAspect = 1.9;
  const double width = kMapWidth_px, height = kTop_px + kBody_px + kBottom_px;
  const auto column = [&](double azimuth_deg) { return width * (0.5 - azimuth_deg / 360.0); };
  Range heights;
  for (const auto& centre : CentresWithoutStrays(scene.cameras)) heights.Include(centre.z());
  std::vector<Eigen::Vector2d> places, stretched;
  for (const auto& c : scene.cameras) {
    const Eigen::Vector3d x = c.cam_from_model.OriginInSource();
    const double share =
        std::clamp((heights.high - x.z()) / std::max(heights.Length(), 1e-9), 0.0, 1.0);
    places.emplace_back(column(Azimuth_deg(x)), kTop_px + 20 + (kBody_px - 40) * share);
    stretched.emplace_back(places.back().x(), places.back().y() * kCellAspect);
  }
  const double cell = std::clamp(0.9 * CloseSpacing(stretched), 8.0, 62.0);
  std::string out = OpenSvg("map", "Cameras by azimuth and height", width, height);
  for (const auto& [azimuth, name] :
       {std::pair{90.0, "left 90°"}, {0.0, "front 0°"}, {-90.0, "right 270°"}}) {
    out += Line({column(azimuth), kTop_px}, {column(azimuth), height - kBottom_px}, "ring") +
           Text({column(azimuth), height - 8}, "label mid", name);
  }
  out += Text({6, height - 8}, "label", "back 180°") +
         Text({width - 6, height - 8}, "label end", "back 180°") +
         Text({6, 14}, "label",
              Fixed(heights.high, 2) + " m high at the top, " + Fixed(heights.low, 2) +
                  " m at the bottom");
  for (size_t i = 0; i < places.size(); ++i) {
    const size_t camera = scene.cameras[i].camera;
    const std::string& name = scene.input.poses.cameras[camera].camera;
    constexpr double kLetter_px = 7.0;
    out += CameraLink(scene.input, scene.facts, camera) + "<rect x=\"" +
           Coordinate(places[i].x() - cell / 2) + "\" y=\"" +
           Coordinate(places[i].y() - cell / 2 / kCellAspect) + "\" width=\"" + Coordinate(cell) +
           "\" height=\"" + Coordinate(cell / kCellAspect) + "\" rx=\"4\"/>";
    if (static_cast<double>(name.size()) * kLetter_px <= cell) {
      out += Text(places[i] + Eigen::Vector2d(0, 4), "cell mid", name);
    }
    out += "</a>\n";
  }
  return out + "</svg>";
}

SceneAxes PrincipalAxes(const std::vector<PlacedCamera>& cameras) {
  constexpr double kAgreement = 0.5;  // length of the mean of unit vectors
  Eigen::Vector3d mean = Eigen::Vector3d::Zero(), picture_up = Eigen::Vector3d::Zero();
  const double count = std::max<double>(1.0, static_cast<double>(cameras.size()));
  for (const auto& c : cameras) {
    mean += c.cam_from_model.OriginInSource() / count;
    picture_up -= c.cam_from_model.rotation.conjugate() * Eigen::Vector3d::UnitY() / count;
  }
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (const auto& c : cameras) {
    const Eigen::Vector3d d = c.cam_from_model.OriginInSource() - mean;
    covariance += d * d.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);  // ascending
  const Eigen::Matrix3d axes = solver.eigenvectors();
  int up_axis = 0;
  if (picture_up.norm() > kAgreement) (axes.transpose() * picture_up).cwiseAbs().maxCoeff(&up_axis);
  Eigen::Vector3d up = axes.col(up_axis);
  if (up.dot(picture_up) < 0) up = -up;
  Eigen::Vector3d right = axes.col(up_axis == 2 ? 1 : 2);
  // An eigenvector's sign is the solver's whim; take the one that follows the cameras' order.
  if (!cameras.empty() && right.dot(cameras.back().cam_from_model.OriginInSource() - mean) < 0) {
    right = -right;
  }
  return {{right, up.cross(right)}, {right, up}, false, false};
}

std::string StateText(const CameraFacts& camera) {
  std::string text;
  for (const std::string& note : camera.notes) text += (text.empty() ? "" : "; ") + note;
  return text.empty() ? "good" : text;
}

}  // namespace

int ColourStep(const Quantity& quantity, double value) {
  const double range = quantity.high - quantity.low;
  if (!(range > 0)) return 0;
  const double share = (value - quantity.low) / range;
  return std::clamp(static_cast<int>(share * kColourSteps), 0, kColourSteps - 1);
}

std::string CameraLink(const ReportInput& input, const Facts& facts, size_t camera) {
  const CameraPose& pose = input.poses.cameras[camera];
  std::string style,
      title = Escaped(pose.camera) + " – " + Escaped(StateText(facts.cameras[camera]));
  for (const Quantity& quantity : facts.quantities) {
    const auto& value = quantity.values[camera];
    if (!quantity.graded || !value) continue;
    style += "--" + quantity.key + ":var(--q" + std::to_string(ColourStep(quantity, *value)) + ");";
    title += "\n" + quantity.label + ": " + Fixed(*value, quantity.decimals) + " " + quantity.unit;
  }
  return "<a class=\"cam " + std::string(LevelName(facts.cameras[camera].level)) +
         (pose.registered ? "" : " missing") + "\" href=\"#cam-" + std::to_string(camera) +
         "\" data-cam=\"" + std::to_string(camera) + "\" style=\"" + style + "\"><title>" + title +
         "</title>";
}

SceneAxes ChooseAxes(const ReportInput& input) {
  const std::vector<PlacedCamera> cameras = PlaceCameras(input);
  if (!input.poses.aligned_to || !input.poses.metric) return PrincipalAxes(cameras);
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), y = Eigen::Vector3d::UnitY(),
                        z = Eigen::Vector3d::UnitZ();
  return {{x, y}, {x, z}, true, Encircle(cameras)};
}

SceneDrawings DrawScene(const ReportInput& input, const Facts& facts, const SceneAxes& axes) {
  Scene scene{.input = input,
              .facts = facts,
              .axes = axes,
              .cameras = PlaceCameras(input),
              .points = ChoosePoints(input.reconstruction.points)};
  FrameScene(scene);
  SceneDrawings drawings{DrawTop(scene), DrawSide(scene), {}};
  if (axes.encircling) drawings.map = DrawMap(scene);
  return drawings;
}

}  // namespace rotunda::sfm::report
