#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "sfm/core/run_context.h"

namespace rotunda::sim {

/// Triangles, counter-clockwise seen from outside; metres, rig frame. `uvs` is empty or has one
/// entry a vertex; `materials` is empty or has one entry a triangle.
struct Mesh {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<Eigen::Vector3f> normals;  // one a vertex, unit length
  std::vector<Eigen::Vector2f> uvs;
  std::vector<std::array<uint32_t, 3>> triangles;
  std::vector<uint8_t> materials;
};

/// Area-weighted vertex normals.
void ComputeNormals(Mesh* mesh);

/// The same where several vertices stand at one place because their texture coordinates differ:
/// they get one normal.
void ComputeSmoothNormals(Mesh* mesh);

/// Every edge is used by exactly two triangles, once in each direction.
bool IsClosedManifold(const Mesh& mesh);

/// Appends `part`; a mesh gets normals from each part as they are.
void AppendMesh(const Mesh& part, Mesh* mesh);

/// A box with sharp edges: `centre`, half sizes along the columns of `axes` (orthonormal).
Mesh MakeBox(const Eigen::Vector3f& centre, const Eigen::Matrix3f& axes,
             const Eigen::Vector3f& half_size);
/// A vertical cylinder without caps, `sides` facets with smooth normals. Facing outward, or inward
/// when `inward`.
struct CylinderShape {
  Eigen::Vector2f centre = Eigen::Vector2f::Zero();
  float radius = 1;
  float bottom = 0;
  float top = 1;
  int sides = 24;
  int rings = 1;
  bool inward = false;
};
Mesh MakeCylinder(const CylinderShape& shape);

/// Signed distance-like function: negative inside, |gradient| about 1 near its zero.
using DistanceFunction = std::function<float(const Eigen::Vector3f&)>;

struct SurfaceOptions {
  Eigen::Vector3f low = Eigen::Vector3f::Zero();
  Eigen::Vector3f high = Eigen::Vector3f::Ones();
  float voxel_m = 0.004f;
};

/// Zero set of `distance` in a box as a closed mesh: surface nets (Gibson 1998) with a vertex for
/// each sheet of the surface in a cell (as in Nielson's dual marching cubes, 2004), each then moved
/// onto the zero set. It closes always; where two sheets touch within neighbouring
/// cells an edge may be shared by four triangles. Blocks far from the surface are skipped, which
/// needs |gradient| <= 2.5.
Mesh ExtractSurface(const DistanceFunction& distance, const SurfaceOptions& options,
                    ThreadPool& threads);

}  // namespace rotunda::sim
