#include "rig/sim/cuboid.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <opencv2/aruco.hpp>
#include <sstream>
#include <string>

#include "rig/sim/noise.h"

namespace rotunda::sim {
namespace {

constexpr int kTagCells = 8;  // 6 bits and the border on both sides
constexpr int kTexelsPerSquare = 128;
constexpr uint8_t kWhite = 235;  // of the print
constexpr uint8_t kBlack = 28;
constexpr int kMostTags = 587;    // in AprilTag 36h11
constexpr int kFacePatches = 12;  // along each edge of a face, so that light can vary over it

class CuboidPaint : public Paint {
 public:
  explicit CuboidPaint(const CuboidOptions& options) {
    for (int face = 0; face < kCuboidFaces; ++face) {
      FacePrint print = DrawFace(options, static_cast<CuboidFace>(face));
      scale_ = static_cast<float>(print.texels_per_m);
      offset_ = static_cast<float>(print.offset_texels);
      faces_.emplace_back(std::move(print.picture));
    }
  }
  Eigen::Vector3f Albedo(const SurfacePoint& point) const override {
    if (point.material >= faces_.size()) return Eigen::Vector3f::Constant(0.3f);
    return 0.85f * faces_[point.material].Sample(offset_ + point.uv.x() * scale_,
                                                 offset_ + point.uv.y() * scale_,
                                                 point.footprint_m * scale_);
  }

 private:
  std::vector<Texture> faces_;
  float scale_ = 1, offset_ = 0;  // from metres on the face to texels
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

FacePrint DrawFace(const CuboidOptions& options, CuboidFace face) {
  const CuboidFaceFrame frame = FaceOf(options, face);
  FacePrint print;
  print.texels_per_m = 1e3 * kTexelsPerSquare / options.square_mm;
  const double margin_texels = 1e-3 * options.margin_mm * print.texels_per_m;
  const int border = static_cast<int>(std::ceil(margin_texels)) + 1;
  print.offset_texels = border - margin_texels;
  print.picture = Picture(frame.columns * kTexelsPerSquare + 2 * border,
                          frame.rows * kTexelsPerSquare + 2 * border);
  std::fill(print.picture.rgb.begin(), print.picture.rgb.end(), kWhite);
  const auto dictionary = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11);
  const double marker = options.marker_mm / options.square_mm * kTexelsPerSquare;
  int id = frame.first_id;
  for (int square = 0; square < frame.rows * frame.columns; ++square) {
    const int row = square / frame.columns, column = square % frame.columns;
    cv::Mat tag(kTagCells, kTagCells, CV_8UC1, cv::Scalar(0));
    const bool black = (row + column) % 2 == 0;
    if (!black) cv::aruco::drawMarker(dictionary, id++, kTagCells, tag, 1);
    for (int y = 0; y < kTexelsPerSquare; ++y) {
      for (int x = 0; x < kTexelsPerSquare; ++x) {
        const auto cell = [&](int texel) {
          const double from_tag = texel + 0.5 - 0.5 * (kTexelsPerSquare - marker);
          return static_cast<int>(std::floor(from_tag / marker * kTagCells));
        };
        const bool on_tag =
            cell(x) >= 0 && cell(x) < kTagCells && cell(y) >= 0 && cell(y) < kTagCells;
        const bool ink = black || (on_tag && tag.at<uint8_t>(cell(y), cell(x)) < 128);
        uint8_t* texel = print.picture.at(border + column * kTexelsPerSquare + x,
                                          border + row * kTexelsPerSquare + y);
        if (ink) std::fill_n(texel, 3, kBlack);
      }
    }
  }
  return print;
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
