#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_map>

#include "rig/sim/mesh.h"

namespace rotunda::sim {
namespace {

// A block is kBlock^3 cells; its samples are (kBlock + 1)^3, shared with its neighbours' rims.
constexpr int kBlock = 8;
constexpr int kSamples = kBlock + 1;
constexpr float kLargestGradient = 2.5f;

using Cell = Eigen::Vector3i;

uint64_t KeyOf(const Cell& cell) {
  return static_cast<uint64_t>(cell.x()) << 42 | static_cast<uint64_t>(cell.y()) << 21 |
         static_cast<uint64_t>(cell.z());
}

/// An edge of a cell: 4 * axis + offset along the next axis + 2 * offset along the one after.
constexpr int kCellEdges = 12;
int CellEdge(int axis, const Cell& from) {
  return 4 * axis + from[(axis + 1) % 3] + 2 * from[(axis + 2) % 3];
}

/// For each crossed edge of a cell the lowest edge of the sheet it belongs to; -1 where not
/// crossed.
using CellSheets = std::array<int8_t, kCellEdges>;

class SheetFinder {
 public:
  /// `inside(corner)` tells the sign at a corner of the unit cube. Where a face has four crossings
  /// its two inside corners are kept apart; both cells at the face do that alike, so that sheets
  /// meet and the mesh closes.
  template <typename Inside>
  explicit SheetFinder(const Inside& inside) {
    sheets_.fill(-1);
    for (int axis = 0; axis < 3; ++axis) {
      for (int corner = 0; corner < 4; ++corner) {
        Cell from = Cell::Zero();
        from[(axis + 1) % 3] = corner & 1;
        from[(axis + 2) % 3] = corner >> 1;
        const int edge = 4 * axis + corner;
        if (inside(from) != inside(from + Cell::Unit(axis)))
          sheets_[edge] = static_cast<int8_t>(edge);
      }
    }
    for (int face = 0; face < 6; ++face) JoinFace(face, inside);
  }
  const CellSheets& sheets() const { return sheets_; }

 private:
  template <typename Inside>
  void JoinFace(int face, const Inside& inside) {
    const int b = (face / 2 + 1) % 3, c = (face / 2 + 2) % 3;
    const Cell low = (face % 2) * Cell::Unit(face / 2);
    // The face's edges: two along b, two along c.
    const std::array<int, 4> edges = {CellEdge(b, low), CellEdge(b, low + Cell::Unit(c)),
                                      CellEdge(c, low), CellEdge(c, low + Cell::Unit(b))};
    std::vector<int> crossed;
    for (int edge : edges) {
      if (sheets_[edge] >= 0) crossed.push_back(edge);
    }
    if (crossed.size() == 2) Join(crossed[0], crossed[1]);
    if (crossed.size() != 4) return;
    const bool low_inside = inside(low);
    Join(edges[0], edges[low_inside ? 2 : 3]);
    Join(edges[1], edges[low_inside ? 3 : 2]);
  }
  void Join(int a, int b) {
    const int8_t to = std::min(sheets_[a], sheets_[b]), from = std::max(sheets_[a], sheets_[b]);
    std::replace(sheets_.begin(), sheets_.end(), from, to);
  }

  CellSheets sheets_;
};

/// What one block gives: a vertex for each sheet of the surface in each cell, and the sample edges
/// that cross the surface.
struct BlockSurface {
  struct Vertex {
    Cell cell;
    CellSheets sheets;
    int8_t sheet;
    Eigen::Vector3f position;
  };
  struct Edge {
    Cell sample;
    int axis;
    bool leaves;  // inside at the lower sample
  };
  std::vector<Vertex> vertices;
  std::vector<Edge> edges;
};

class Extractor {
 public:
  Extractor(const DistanceFunction& distance, const SurfaceOptions& options)
      : distance_(distance), options_(options) {
    const Eigen::Vector3f size = (options.high - options.low) / options.voxel_m;
    for (int axis = 0; axis < 3; ++axis) {
      blocks_[axis] = static_cast<int>(std::ceil(size[axis] / kBlock));
    }
  }

  size_t BlockCount() const { return static_cast<size_t>(blocks_.prod()); }

  BlockSurface Extract(size_t index) const {
    const Cell origin = BlockOrigin(index);
    BlockSurface block;
    if (!MayHoldSurface(origin, kBlock)) return block;
    bool any = false;
    for (int i = 0; i < 8 && !any; ++i) {
      any = MayHoldSurface(origin + kBlock / 2 * Cell(i & 1, i >> 1 & 1, i >> 2), kBlock / 2);
    }
    if (!any) return block;
    std::vector<float> values(kSamples * kSamples * kSamples);
    for (int z = 0, i = 0; z < kSamples; ++z) {
      for (int y = 0; y < kSamples; ++y) {
        for (int x = 0; x < kSamples; ++x, ++i) {
          values[i] = distance_(Position((origin + Cell(x, y, z)).cast<float>()));
        }
      }
    }
    for (int z = 0; z < kBlock; ++z) {
      for (int y = 0; y < kBlock; ++y) {
        for (int x = 0; x < kBlock; ++x) VisitCell(origin, Cell(x, y, z), values, &block);
      }
    }
    return block;
  }

 private:
  static size_t SampleIndex(const Cell& s) {
    return static_cast<size_t>((s.z() * kSamples + s.y()) * kSamples + s.x());
  }
  Cell BlockOrigin(size_t index) const {
    const int i = static_cast<int>(index);
    return Cell(i % blocks_.x(), i / blocks_.x() % blocks_.y(), i / (blocks_.x() * blocks_.y())) *
           kBlock;
  }
  Eigen::Vector3f Position(const Eigen::Vector3f& sample) const {
    return options_.low + options_.voxel_m * sample;
  }

  /// False when the surface is too far from the middle of a cube of cells to reach into it.
  bool MayHoldSurface(const Cell& origin, int cells) const {
    const float half = 0.5f * static_cast<float>(cells);
    const Eigen::Vector3f middle = Position(origin.cast<float>() + Eigen::Vector3f::Constant(half));
    return std::abs(distance_(middle)) <=
           kLargestGradient * std::sqrt(3.0f) * half * options_.voxel_m;
  }

  void VisitCell(const Cell& origin, const Cell& cell, const std::vector<float>& values,
                 BlockSurface* block) const {
    const auto value = [&](const Cell& corner) { return values[SampleIndex(cell + corner)]; };
    int inside_count = 0;
    for (int i = 0; i < 8; ++i) inside_count += value(Cell(i & 1, i >> 1 & 1, i >> 2)) < 0;
    if (inside_count == 0 || inside_count == 8) return;
    const SheetFinder finder([&](const Cell& corner) { return value(corner) < 0; });
    const CellSheets& sheets = finder.sheets();
    std::array<Eigen::Vector3f, kCellEdges> sum;
    std::array<int, kCellEdges> crossings = {};
    sum.fill(Eigen::Vector3f::Zero());
    for (int edge = 0; edge < kCellEdges; ++edge) {
      if (sheets[edge] < 0) continue;
      const int axis = edge / 4;
      Cell from = Cell::Zero();
      from[(axis + 1) % 3] = edge & 1;
      from[(axis + 2) % 3] = edge >> 1 & 1;
      const float a = value(from), b = value(from + Cell::Unit(axis));
      Eigen::Vector3f at = (cell + from).cast<float>();
      at[axis] += a / (a - b);
      sum[sheets[edge]] += at;
      ++crossings[sheets[edge]];
      if (edge % 4 == 0) block->edges.push_back({origin + cell, axis, a < 0});
    }
    for (int8_t sheet = 0; sheet < kCellEdges; ++sheet) {
      if (crossings[sheet] == 0) continue;
      const Eigen::Vector3f mean = sum[sheet] / static_cast<float>(crossings[sheet]);
      block->vertices.push_back(
          {origin + cell, sheets, sheet, OnSurface(Position(origin.cast<float>() + mean))});
    }
  }

  /// One Newton step along the gradient, kept within half a cell.
  Eigen::Vector3f OnSurface(const Eigen::Vector3f& start) const {
    const float h = 0.25f * options_.voxel_m;
    Eigen::Vector3f gradient;
    for (int axis = 0; axis < 3; ++axis) {
      const Eigen::Vector3f step = h * Eigen::Vector3f::Unit(axis);
      gradient[axis] = (distance_(start + step) - distance_(start - step)) / (2 * h);
    }
    const float squared = std::max(gradient.squaredNorm(), 0.25f);
    Eigen::Vector3f move = -distance_(start) / squared * gradient;
    const float limit = 0.5f * options_.voxel_m;
    if (move.norm() > limit) move *= limit / move.norm();
    return start + move;
  }

  const DistanceFunction& distance_;
  const SurfaceOptions& options_;
  Eigen::Vector3i blocks_;
};

}  // namespace

Mesh ExtractSurface(const DistanceFunction& distance, const SurfaceOptions& options,
                    ThreadPool& threads) {
  const Extractor extractor(distance, options);
  std::vector<BlockSurface> blocks(extractor.BlockCount());
  threads.ParallelFor(blocks.size(), [&](size_t i) { blocks[i] = extractor.Extract(i); });
  Mesh mesh;
  struct CellEntry {
    CellSheets sheets;
    std::array<uint32_t, kCellEdges> vertex_of_sheet;
  };
  std::unordered_map<uint64_t, CellEntry> cells;
  for (const BlockSurface& block : blocks) {
    for (const BlockSurface::Vertex& vertex : block.vertices) {
      CellEntry& entry = cells[KeyOf(vertex.cell)];
      entry.sheets = vertex.sheets;
      entry.vertex_of_sheet[vertex.sheet] = static_cast<uint32_t>(mesh.vertices.size());
      mesh.vertices.push_back(vertex.position);
    }
  }
  // The four cells around a crossed edge make a quad that faces out of the inside.
  for (const BlockSurface& block : blocks) {
    for (const BlockSurface::Edge& edge : block.edges) {
      std::array<uint32_t, 4> quad;
      constexpr std::array<std::array<int, 2>, 4> kAround = {{{1, 1}, {0, 1}, {0, 0}, {1, 0}}};
      bool complete = true;
      for (int i = 0; i < 4; ++i) {
        const auto [u, v] = kAround[i];
        const Cell cell =
            edge.sample - u * Cell::Unit((edge.axis + 1) % 3) - v * Cell::Unit((edge.axis + 2) % 3);
        const auto entry = cells.find(KeyOf(cell));
        complete = complete && entry != cells.end();
        if (!complete) break;
        const int8_t sheet = entry->second.sheets[4 * edge.axis + u + 2 * v];
        quad[i] = entry->second.vertex_of_sheet[sheet];
      }
      if (!complete) continue;  // the surface leaves the box
      if (!edge.leaves) std::swap(quad[1], quad[3]);
      mesh.triangles.push_back({quad[0], quad[1], quad[2]});
      mesh.triangles.push_back({quad[0], quad[2], quad[3]});
    }
  }
  ComputeNormals(&mesh);
  return mesh;
}

}  // namespace rotunda::sim
