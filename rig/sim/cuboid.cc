#include "rig/sim/cuboid.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <opencv2/aruco.hpp>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <string>

#include "rig/sim/noise.h"

namespace rotunda::sim {
namespace {

constexpr int kTagCells = 8;        // 6 bits and the border on both sides
constexpr int kTexelsPerCell = 12;  // of a tag
constexpr int kMostTags = 587;      // in AprilTag 36h11
constexpr int kFacePatches = 12;    // along each edge of a face, so that light can vary over it

class CuboidPaint : public Paint {
 public:
  explicit CuboidPaint(const CuboidOptions& options) {
    for (int face = 0; face < kCuboidFaces; ++face) {
      Picture picture = DrawFace(options, static_cast<CuboidFace>(face));
      const CuboidFaceFrame frame = FaceOf(options, static_cast<CuboidFace>(face));
      texels_per_m_.push_back(static_cast<float>(picture.width / frame.width_m));
      faces_.emplace_back(std::move(picture));
    }
  }
  Eigen::Vector3f Albedo(const SurfacePoint& point) const override {
    if (point.material >= faces_.size()) return Eigen::Vector3f::Constant(0.3f);
    const float scale = texels_per_m_[point.material];
    return 0.85f * faces_[point.material].Sample(point.uv.x() * scale, point.uv.y() * scale,
                                                 point.footprint_m * scale);
  }

 private:
  std::vector<Texture> faces_;
  std::vector<float> texels_per_m_;
};

void AppendFace(const CuboidFaceFrame& frame, const Rigid3& rig_from_cuboid, uint8_t material,
                Mesh* mesh) {
  const uint32_t first = static_cast<uint32_t>(mesh->vertices.size());
  const Eigen::Vector3d normal = rig_from_cuboid.rotation * frame.down.cross(frame.right);
  for (int row = 0; row <= kFacePatches; ++row) {
    for (int column = 0; column <= kFacePatches; ++column) {
      const double x_m = frame.width_m * column / kFacePatches;
      const double y_m = frame.height_m * row / kFacePatches;
      mesh->vertices.push_back((rig_from_cuboid * frame.At(x_m, y_m)).cast<float>());
      mesh->normals.push_back(normal.cast<float>());
      mesh->uvs.emplace_back(static_cast<float>(x_m), static_cast<float>(y_m));
    }
  }
  for (int row = 0; row < kFacePatches; ++row) {
    for (int column = 0; column < kFacePatches; ++column) {
      const uint32_t a = first + static_cast<uint32_t>(row * (kFacePatches + 1) + column);
      const uint32_t below = a + kFacePatches + 1;
      mesh->triangles.push_back({a, below, below + 1});
      mesh->triangles.push_back({a, below + 1, a + 1});
      mesh->materials.insert(mesh->materials.end(), 2, material);
    }
  }
}

}  // namespace

Status CuboidOptions::Validate() const {
  const auto refused = [](const char* field, double value, const std::string& allowed) {
    std::ostringstream text;
    text << "is " << value << ", allowed is " << allowed;
    return Error{ErrorCode::kInvalidArgument, text.str(), field};
  };
  const std::string odd = "an odd number from 3 to 99";
  const auto is_odd = [](int count) { return count >= 3 && count <= 99 && count % 2 == 1; };
  if (!is_odd(columns)) return refused("cuboid.columns", columns, odd);
  if (!is_odd(rows)) return refused("cuboid.rows", rows, odd);
  if (!(square_mm >= 5 && square_mm <= 500)) {
    return refused("cuboid.square_mm", square_mm, "5 to 500");
  }
  if (!(marker_mm >= 0.3 * square_mm && marker_mm <= 0.9 * square_mm)) {
    return refused("cuboid.marker_mm", marker_mm, "0.3 to 0.9 of square_mm");
  }
  if (!(margin_mm >= 0 && margin_mm <= 500)) {
    return refused("cuboid.margin_mm", margin_mm, "0 to 500");
  }
  const int tags = 4 * MarkersOnSide() + MarkersOnTop();
  if (tags > kMostTags) {
    return refused("cuboid.rows", rows,
                   "what needs at most " + std::to_string(kMostTags) +
                       " tags of 36h11 on all faces; this needs " + std::to_string(tags));
  }
  return {};
}

CuboidFaceFrame FaceOf(const CuboidOptions& options, CuboidFace face) {
  CuboidFaceFrame frame;
  const bool top = face == CuboidFace::kTop;
  frame.columns = options.columns;
  frame.rows = top ? options.columns : options.rows;
  const auto length_m = [&](int squares) {
    return 1e-3 * (squares * options.square_mm + 2 * options.margin_mm);
  };
  frame.width_m = length_m(frame.columns);
  frame.height_m = length_m(frame.rows);
  frame.first_id = static_cast<int>(face) * options.MarkersOnSide();
  const double half = 0.5 * frame.width_m, tall = length_m(options.rows);
  if (top) {
    // Seen from above with the front face at the picture's bottom.
    frame.right = Eigen::Vector3d::UnitY();
    frame.down = Eigen::Vector3d::UnitX();
    frame.origin = Eigen::Vector3d(-half, -half, tall);
    return frame;
  }
  const Eigen::Quaterniond turn(
      Eigen::AngleAxisd(0.5 * kPi * static_cast<int>(face), Eigen::Vector3d::UnitZ()));
  frame.right = turn * Eigen::Vector3d::UnitY();
  frame.down = -Eigen::Vector3d::UnitZ();
  frame.origin = turn * Eigen::Vector3d(half, -half, tall);
  return frame;
}

Picture DrawFace(const CuboidOptions& options, CuboidFace face) {
  const CuboidFaceFrame frame = FaceOf(options, face);
  const double texels_per_mm = kTagCells * kTexelsPerCell / options.marker_mm;
  const auto texel = [&](double mm) { return static_cast<int>(std::lround(mm * texels_per_mm)); };
  cv::Mat board(texel(1e3 * frame.height_m), texel(1e3 * frame.width_m), CV_8UC1, cv::Scalar(235));
  const cv::Ptr<cv::aruco::Dictionary> dictionary =
      cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11);
  int id = frame.first_id;
  for (int row = 0; row < frame.rows; ++row) {
    for (int column = 0; column < frame.columns; ++column) {
      const double left = options.margin_mm + column * options.square_mm;
      const double top = options.margin_mm + row * options.square_mm;
      if ((row + column) % 2 == 0) {
        const cv::Point low(texel(left), texel(top));
        const cv::Point high(texel(left + options.square_mm), texel(top + options.square_mm));
        board(cv::Rect(low, high)).setTo(28);
        continue;
      }
      cv::Mat tag;
      cv::aruco::drawMarker(dictionary, id++, kTagCells * kTexelsPerCell, tag, 1);
      tag.setTo(235, tag > 128);
      tag.setTo(28, tag < 128);
      const double inset = 0.5 * (options.square_mm - options.marker_mm);
      tag.copyTo(board(cv::Rect(texel(left + inset), texel(top + inset), tag.cols, tag.rows)));
    }
  }
  Picture picture(board.cols, board.rows);
  for (int y = 0; y < board.rows; ++y) {
    for (int x = 0; x < board.cols; ++x) {
      std::fill_n(picture.at(x, y), 3, board.at<uint8_t>(y, x));
    }
  }
  return picture;
}

Rigid3 CuboidPlacement(int placement) {
  if (placement == 0) return {};
  Random random(static_cast<uint64_t>(placement));
  const double turn_rad = random.Uniform(-kPi, kPi);
  const double lean_towards_rad = random.Uniform(-kPi, kPi);
  const double lean_rad = RadFromDeg(random.Uniform(1.0, 7.0));
  const double x_m = random.Uniform(-0.15, 0.15), y_m = random.Uniform(-0.15, 0.15);
  const double z_m = random.Uniform(0.03, 0.12);
  const Eigen::Vector3d axis(std::cos(lean_towards_rad), std::sin(lean_towards_rad), 0);
  const Eigen::Quaterniond rotation =
      Eigen::Quaterniond(Eigen::AngleAxisd(lean_rad, axis)) *
      Eigen::Quaterniond(Eigen::AngleAxisd(turn_rad, Eigen::Vector3d::UnitZ()));
  return {rotation.normalized(), Eigen::Vector3d(x_m, y_m, z_m)};
}

WorldObject MakeCuboid(const CuboidOptions& options, const Rigid3& rig_from_cuboid) {
  WorldObject object;
  for (int face = 0; face < kCuboidFaces; ++face) {
    AppendFace(FaceOf(options, static_cast<CuboidFace>(face)), rig_from_cuboid,
               static_cast<uint8_t>(face), &object.mesh);
  }
  CuboidFaceFrame bottom = FaceOf(options, CuboidFace::kTop);
  bottom.origin = Eigen::Vector3d(-bottom.origin.x(), bottom.origin.y(), 0);
  bottom.down = -bottom.down;
  AppendFace(bottom, rig_from_cuboid, kCuboidFaces, &object.mesh);
  object.paint = std::make_unique<CuboidPaint>(options);
  return object;
}

}  // namespace rotunda::sim
