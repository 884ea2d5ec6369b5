#include "rig/sim/board_object.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "rig/sim/noise.h"
#include "sfm/core/run_context.h"

namespace rotunda::sim {
namespace {

constexpr int kTexelsPerSquare = 128;
constexpr int kMostTexels = 8192;  // along a side of a face's picture
constexpr uint8_t kWhite = 235;    // of the print
constexpr uint8_t kBlack = 28;
constexpr float kBackAlbedo = 0.3f;
constexpr double kThickness_m = 0.003;  // from the print to the back
/// Along each edge of a face, so that light can vary over it and bow has its shape: chords of a bow
/// of 0.5 mm are off by 0.5 mm / 12^2 = 3.5 um.
constexpr int kFacePatches = 12;

class BoardPaint : public Paint {
 public:
  static Result<std::unique_ptr<BoardPaint>> Make(const rig::Board& board) {
    auto paint = std::make_unique<BoardPaint>();
    for (const rig::BoardFace& face : board.faces) {
      ROTUNDA_ASSIGN_OR_RETURN(FacePrint print, DrawFace(face));
      paint->faces_.push_back({Texture(std::move(print.picture)),
                               static_cast<float>(print.texels_per_m),
                               static_cast<float>(print.offset_texels)});
    }
    return paint;
  }
  Eigen::Vector3f Albedo(const SurfacePoint& point) const override {
    if (point.material >= faces_.size()) return Eigen::Vector3f::Constant(kBackAlbedo);
    const Face& face = faces_[point.material];
    return 0.85f * face.print.Sample(face.offset + point.uv.x() * face.scale,
                                     face.offset + point.uv.y() * face.scale,
                                     point.footprint_m * face.scale);
  }

 private:
  struct Face {
    Texture print;
    float scale = 1, offset = 0;  // from metres in the face's frame to texels
  };
  std::vector<Face> faces_;
};

/// A sheet `depth_m` behind the print; its texture coordinates are metres in the face's frame.
struct Sheet {
  const rig::BoardFace& face;
  const CalibratedFace& real;
  double depth_m;
  bool faces_reader;
  uint8_t material;
};

void AppendSheet(const Sheet& sheet, const Rigid3& rig_from_board, Mesh* mesh) {
  const uint32_t first = static_cast<uint32_t>(mesh->vertices.size());
  const rig::BoardFace& face = sheet.face;
  const Eigen::Quaterniond turn = rig_from_board.rotation * sheet.real.board_from_face.rotation;
  const Eigen::Vector3d normal = turn * Eigen::Vector3d(0, 0, sheet.faces_reader ? -1 : 1);
  const auto along = [&](int i, double length_m) {
    return -face.margin_m + (length_m + 2 * face.margin_m) * i / kFacePatches;
  };
  for (int row = 0; row <= kFacePatches; ++row) {
    for (int column = 0; column <= kFacePatches; ++column) {
      const Eigen::Vector3d at(along(column, face.Width_m()), along(row, face.Height_m()),
                               sheet.depth_m);
      const Eigen::Vector3d on_board = rig::PointOnBoard(face, sheet.real, at);
      mesh->vertices.push_back((rig_from_board * on_board).cast<float>());
      mesh->normals.push_back(normal.cast<float>());
      mesh->uvs.push_back(at.head<2>().cast<float>());
    }
  }
  for (int row = 0; row < kFacePatches; ++row) {
    for (int column = 0; column < kFacePatches; ++column) {
      const uint32_t a = first + static_cast<uint32_t>(row * (kFacePatches + 1) + column);
      const uint32_t below = a + kFacePatches + 1;
      if (sheet.faces_reader) {
        mesh->triangles.push_back({a, below, below + 1});
        mesh->triangles.push_back({a, below + 1, a + 1});
      } else {
        mesh->triangles.push_back({a, below + 1, below});
        mesh->triangles.push_back({a, a + 1, below + 1});
      }
      mesh->materials.insert(mesh->materials.end(), 2, sheet.material);
    }
  }
}

Eigen::Vector3d RandomDirection(Random& random) {
  const double x = random.Normal(), y = random.Normal(), z = random.Normal();
  return Eigen::Vector3d(x, y, z).normalized();
}

CalibratedFace DrawRealFace(const rig::BoardFace& face, double scale, Random& random) {
  constexpr BoardErrors kErrors;
  const Eigen::Vector3d shift_m =
      scale * 1e-3 * random.Uniform(0, kErrors.position_mm) * RandomDirection(random);
  const double turn_rad = scale * RadFromDeg(random.Uniform(0, kErrors.rotation_deg));
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(turn_rad, RandomDirection(random)));
  const double bow_m = scale * 1e-3 * (random.Chance(0.5) ? kErrors.bow_mm : -kErrors.bow_mm);
  const double share = random.Uniform();
  const Eigen::Vector3d middle_m(0.5 * face.Width_m(), 0.5 * face.Height_m(), 0);
  const Rigid3 face_from_moved{turn, middle_m + shift_m - turn * middle_m};
  return {face.name, face.board_from_face * face_from_moved,
          Eigen::Vector2d(share * bow_m, (1 - share) * bow_m), {}};
}

}  // namespace

std::vector<CalibratedFace> DrawBoard(const rig::Board& board, double scale, uint64_t seed) {
  if (scale == 0) return rig::DrawnFaces(board);
  std::vector<CalibratedFace> faces;
  for (size_t i = 0; i < board.faces.size(); ++i) {
    Random random(DeriveSeed(seed, i));
    faces.push_back(DrawRealFace(board.faces[i], scale, random));
  }
  return faces;
}

Result<FacePrint> DrawFace(const rig::BoardFace& face) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<rig::InkRectangle> ink, rig::FaceInk(face));
  const int squares = std::max(face.columns, face.rows);
  const int texels_per_square = std::min(kTexelsPerSquare, kMostTexels / squares);
  FacePrint print;
  print.texels_per_m = texels_per_square / face.square_m;
  const int border = static_cast<int>(std::ceil(face.margin_m * print.texels_per_m)) + 1;
  print.offset_texels = border;
  print.picture = Picture(face.columns * texels_per_square + 2 * border,
                          face.rows * texels_per_square + 2 * border);
  std::fill(print.picture.rgb.begin(), print.picture.rgb.end(), kWhite);
  // A texel is black when its middle is.
  const auto first_texel = [&](double metres) {
    return border + static_cast<int>(std::ceil(metres * print.texels_per_m - 0.5));
  };
  for (const rig::InkRectangle& r : ink) {
    const int left = first_texel(r.left_m), right = first_texel(r.right_m);
    for (int y = first_texel(r.top_m); y < first_texel(r.bottom_m); ++y) {
      std::fill(print.picture.at(left, y), print.picture.at(right, y), kBlack);
    }
  }
  return print;
}

Rigid3 BoardPlacement(int placement) {
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

Result<WorldObject> MakeBoardObject(const rig::Board& board,
                                    const std::vector<CalibratedFace>& faces,
                                    const Rigid3& rig_from_board) {
  WorldObject object;
  const uint8_t back = static_cast<uint8_t>(board.faces.size());
  for (uint8_t i = 0; i < back; ++i) {
    AppendSheet({board.faces[i], faces[i], 0, true, i}, rig_from_board, &object.mesh);
    AppendSheet({board.faces[i], faces[i], kThickness_m, false, back}, rig_from_board,
                &object.mesh);
  }
  ROTUNDA_ASSIGN_OR_RETURN(object.paint, BoardPaint::Make(board));
  return object;
}

}  // namespace rotunda::sim
