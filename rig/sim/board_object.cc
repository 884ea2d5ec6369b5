#include "rig/sim/board_object.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "rig/sim/noise.h"
#include "sfm/core/run_context.h"

namespace rotunda::sim {
namespace {

constexpr float kWhiteAlbedo = 0.72f;  // of the print
constexpr float kBlackAlbedo = 0.01f;
constexpr float kBackAlbedo = 0.3f;
constexpr double kThickness_m = 0.003;  // from the print to the back
/// Along each edge of a face, so that light can vary over it and bow has its shape: chords of a bow
/// of 0.5 mm are off by 0.5 mm / 24^2 = 0.9 um (12 of them moved corners by 0.003 px).
constexpr int kFacePatches = 24;

/// Edges along one axis, and where a place lies between them.
class EdgeAxis {
 public:
  struct Place {
    size_t before;  // edge
    double share;   // of the way to the next
  };

  explicit EdgeAxis(std::vector<double> edges) : edges_(std::move(edges)) {
    std::sort(edges_.begin(), edges_.end());
    edges_.erase(std::unique(edges_.begin(), edges_.end()), edges_.end());
    bins_per_m_ = kBins / (edges_.back() - edges_.front());
    for (size_t bin = 0, edge = 0; bin <= kBins; ++bin) {
      while (edge + 2 < size() && bins_per_m_ * (edges_[edge + 1] - edges_[0]) <= 1.0 * bin) ++edge;
      first_.push_back(edge);
    }
  }
  size_t size() const { return edges_.size(); }
  double operator[](size_t i) const { return edges_[i]; }

  /// Beyond the first or last edge: at it.
  Place Find(double at) const {
    at = std::clamp(at, edges_.front(), edges_.back());
    size_t i = first_[static_cast<size_t>(bins_per_m_ * (at - edges_.front()))];
    while (i + 2 < size() && edges_[i + 1] <= at) ++i;
    return {i, (at - edges_[i]) / (edges_[i + 1] - edges_[i])};
  }

 private:
  static constexpr size_t kBins = 1024;
  std::vector<double> edges_;
  double bins_per_m_;
  std::vector<size_t> first_;  // edge to search from, by bin
};

std::vector<double> EdgesOf(const std::vector<rig::InkRectangle>& ink, bool across) {
  std::vector<double> edges;
  for (const rig::InkRectangle& r : ink) {
    edges.push_back(across ? r.left_m : r.top_m);
    edges.push_back(across ? r.right_m : r.bottom_m);
  }
  return edges;
}

/// Ink of a face as areas: how much of it lies left of and above a point. Edges of a printed board
/// are exact in it at any scale, where texels would draw them to their own grid.
class InkArea {
 public:
  explicit InkArea(const std::vector<rig::InkRectangle>& ink)
      : x_(EdgesOf(ink, true)), y_(EdgesOf(ink, false)), area_m2_(x_.size() * y_.size(), 0.0) {
    for (const rig::InkRectangle& r : ink) {
      for (size_t i = y_.Find(r.top_m).before; i + 1 < y_.size() && y_[i] < r.bottom_m; ++i) {
        for (size_t j = x_.Find(r.left_m).before; j + 1 < x_.size() && x_[j] < r.right_m; ++j) {
          area_m2_[(i + 1) * x_.size() + j + 1] = (x_[j + 1] - x_[j]) * (y_[i + 1] - y_[i]);
        }
      }
    }
    for (size_t i = 1; i < y_.size(); ++i) {
      for (size_t j = 1; j < x_.size(); ++j) {
        area_m2_[i * x_.size() + j] += At(j - 1, i) + At(j, i - 1) - At(j - 1, i - 1);
      }
    }
  }

  /// Share of ink about a place: in a rectangle of this size, averaged over four places a quarter
  /// of it off along both axes. Samples a rectangle's size apart then give no frequency near their
  /// own as a false slow one: |sinc(f) cos(pi f / 2)| < 0.045 for f = 0.85 to 1.15, where the
  /// rectangle alone leaves 0.17, and moves edges by 0.01 px.
  double Share(const Eigen::Vector2d& middle, const Eigen::Vector2d& size) const {
    constexpr std::array<double, 4> kEnds = {-0.75, -0.25, 0.25, 0.75};
    constexpr std::array<double, 4> kSigns = {-1, -1, 1, 1};
    std::array<EdgeAxis::Place, 4> columns, rows;
    for (size_t i = 0; i < kEnds.size(); ++i) {
      columns[i] = x_.Find(middle.x() + kEnds[i] * size.x());
      rows[i] = y_.Find(middle.y() + kEnds[i] * size.y());
    }
    double ink_m2 = 0;
    for (size_t i = 0; i < kEnds.size(); ++i) {
      for (size_t j = 0; j < kEnds.size(); ++j) {
        ink_m2 += kSigns[i] * kSigns[j] * Before(columns[j], rows[i]);
      }
    }
    return std::clamp(ink_m2 / (4 * size.prod()), 0.0, 1.0);
  }

 private:
  double At(size_t column, size_t row) const { return area_m2_[row * x_.size() + column]; }

  /// Area of the ink left of and above a place: between edges it grows evenly.
  double Before(const EdgeAxis::Place& x, const EdgeAxis::Place& y) const {
    const double* above = &area_m2_[y.before * x_.size() + x.before];
    const double* below = above + x_.size();
    const double top = above[0] + x.share * (above[1] - above[0]);
    const double bottom = below[0] + x.share * (below[1] - below[0]);
    return top + y.share * (bottom - top);
  }

  EdgeAxis x_, y_;
  std::vector<double> area_m2_;  // before each crossing of edges, row by row
};

class BoardPaint : public Paint {
 public:
  static Result<std::unique_ptr<BoardPaint>> Make(const rig::Board& board) {
    auto paint = std::make_unique<BoardPaint>();
    for (const rig::BoardFace& face : board.faces) {
      ROTUNDA_ASSIGN_OR_RETURN(const std::vector<rig::InkRectangle> ink, rig::FaceInk(face));
      paint->faces_.emplace_back(ink);
    }
    return paint;
  }
  Eigen::Vector3f Albedo(const SurfacePoint& point) const override {
    if (point.material >= faces_.size()) return Eigen::Vector3f::Constant(kBackAlbedo);
    const Eigen::Vector2f size = point.uv_footprint.minCoeff() > 0
                                     ? point.uv_footprint
                                     : Eigen::Vector2f::Constant(point.footprint_m);
    const double ink = faces_[point.material].Share(point.uv.cast<double>(), size.cast<double>());
    return Eigen::Vector3f::Constant(kWhiteAlbedo +
                                     static_cast<float>(ink) * (kBlackAlbedo - kWhiteAlbedo));
  }

 private:
  std::vector<InkArea> faces_;  // texture coordinates are metres in the face's frame
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
  return {face.name,
          face.board_from_face * face_from_moved,
          Eigen::Vector2d(share * bow_m, (1 - share) * bow_m),
          {}};
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
