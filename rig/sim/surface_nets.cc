#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "rig/sim/mesh.h"

namespace rotunda::sim {
namespace {

// A block is kBlock^3 cells; its samples are (kBlock + 1)^3, shared with its neighbours' rims.
constexpr int kBlock = 8;
constexpr int kSamples = kBlock + 1;
constexpr float kLargestGradient = 1.5f;

using Cell = Eigen::Vector3i;

uint64_t KeyOf(const Cell& cell) {
  return static_cast<uint64_t>(cell.x()) << 42 | static_cast<uint64_t>(cell.y()) << 21 |
         static_cast<uint64_t>(cell.z());
}

/// What one block gives: a vertex for each cell the surface passes, and for each sample edge that
/// crosses the surface, which owns the edge's lower sample in this block, a quad's whereabouts.
struct BlockSurface {
  std::vector<Cell> cells;
  std::vector<Eigen::Vector3f> vertices;
  struct Edge {
    Cell sample;
    int axis;
    bool leaves;  // inside at the lower sample
  };
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
    const float half = 0.5f * kBlock * options_.voxel_m;
    const Eigen::Vector3f middle = Position(origin.cast<float>()) + Eigen::Vector3f::Constant(half);
    const float reach = kLargestGradient * std::sqrt(3.0f) * (half + options_.voxel_m);
    BlockSurface block;
    if (std::abs(distance_(middle)) > reach) return block;
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

  void VisitCell(const Cell& origin, const Cell& cell, const std::vector<float>& values,
                 BlockSurface* block) const {
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    int crossings = 0;
    for (int axis = 0; axis < 3; ++axis) {
      for (int corner = 0; corner < 4; ++corner) {
        Cell from = cell;
        from[(axis + 1) % 3] += corner & 1;
        from[(axis + 2) % 3] += corner >> 1;
        Cell to = from;
        ++to[axis];
        const float a = values[SampleIndex(from)], b = values[SampleIndex(to)];
        if ((a < 0) == (b < 0)) continue;
        Eigen::Vector3f at = from.cast<float>();
        at[axis] += a / (a - b);
        sum += at;
        ++crossings;
        if (corner == 0) block->edges.push_back({origin + from, axis, a < 0});
      }
    }
    if (crossings == 0) return;
    const Eigen::Vector3f mean = sum / static_cast<float>(crossings);
    block->cells.push_back(origin + cell);
    block->vertices.push_back(OnSurface(Position(origin.cast<float>() + mean)));
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
  std::unordered_map<uint64_t, uint32_t> vertex_of_cell;
  for (const BlockSurface& block : blocks) {
    for (size_t i = 0; i < block.cells.size(); ++i) {
      vertex_of_cell[KeyOf(block.cells[i])] = static_cast<uint32_t>(mesh.vertices.size());
      mesh.vertices.push_back(block.vertices[i]);
    }
  }
  // The four cells around a crossed edge make a quad that faces out of the inside.
  for (const BlockSurface& block : blocks) {
    for (const BlockSurface::Edge& edge : block.edges) {
      const Cell u = Cell::Unit((edge.axis + 1) % 3), v = Cell::Unit((edge.axis + 2) % 3);
      std::array<uint32_t, 4> quad;
      const std::array<Cell, 4> around = {edge.sample - u - v, edge.sample - v, edge.sample,
                                          edge.sample - u};
      for (int i = 0; i < 4; ++i) quad[i] = vertex_of_cell[KeyOf(around[i])];
      if (!edge.leaves) std::swap(quad[1], quad[3]);
      mesh.triangles.push_back({quad[0], quad[1], quad[2]});
      mesh.triangles.push_back({quad[0], quad[2], quad[3]});
    }
  }
  ComputeNormals(&mesh);
  return mesh;
}

}  // namespace rotunda::sim
