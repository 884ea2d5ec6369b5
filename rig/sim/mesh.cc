#include "rig/sim/mesh.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace rotunda::sim {
namespace {

constexpr float kTwoPi = 6.2831853f;

}  // namespace

void ComputeNormals(Mesh* mesh) {
  mesh->normals.assign(mesh->vertices.size(), Eigen::Vector3f::Zero());
  for (const auto& [a, b, c] : mesh->triangles) {
    const Eigen::Vector3f& origin = mesh->vertices[a];
    const Eigen::Vector3f twice_area =
        (mesh->vertices[b] - origin).cross(mesh->vertices[c] - origin);
    for (uint32_t vertex : {a, b, c}) mesh->normals[vertex] += twice_area;
  }
  for (Eigen::Vector3f& normal : mesh->normals) {
    if (normal.squaredNorm() > 0) normal.normalize();
  }
}

void ComputeSmoothNormals(Mesh* mesh) {
  std::vector<uint32_t> order(mesh->vertices.size());
  std::iota(order.begin(), order.end(), 0u);
  const auto key = [&](uint32_t i) {
    const Eigen::Vector3f& p = mesh->vertices[i];
    return std::array{p.x(), p.y(), p.z()};
  };
  std::stable_sort(order.begin(), order.end(),
                   [&](uint32_t a, uint32_t b) { return key(a) < key(b); });
  std::vector<uint32_t> first_here(order.size());
  for (size_t i = 0; i < order.size(); ++i) {
    const bool same = i > 0 && key(order[i]) == key(order[i - 1]);
    first_here[order[i]] = same ? first_here[order[i - 1]] : order[i];
  }
  std::vector<std::array<uint32_t, 3>> triangles = mesh->triangles;
  for (auto& triangle : mesh->triangles) {
    for (uint32_t& vertex : triangle) vertex = first_here[vertex];
  }
  ComputeNormals(mesh);
  mesh->triangles = std::move(triangles);
  for (size_t i = 0; i < order.size(); ++i) mesh->normals[i] = mesh->normals[first_here[i]];
}

bool IsClosedManifold(const Mesh& mesh) {
  std::vector<std::pair<uint32_t, uint32_t>> edges;
  edges.reserve(mesh.triangles.size() * 3);
  for (const auto& triangle : mesh.triangles) {
    for (int i = 0; i < 3; ++i) edges.emplace_back(triangle[i], triangle[(i + 1) % 3]);
  }
  std::sort(edges.begin(), edges.end());
  if (std::adjacent_find(edges.begin(), edges.end()) != edges.end()) return false;
  return std::all_of(edges.begin(), edges.end(), [&](const auto& edge) {
    return std::binary_search(edges.begin(), edges.end(), std::pair(edge.second, edge.first));
  });
}

void AppendMesh(const Mesh& part, Mesh* mesh) {
  const uint32_t offset = static_cast<uint32_t>(mesh->vertices.size());
  mesh->vertices.insert(mesh->vertices.end(), part.vertices.begin(), part.vertices.end());
  mesh->normals.insert(mesh->normals.end(), part.normals.begin(), part.normals.end());
  mesh->uvs.insert(mesh->uvs.end(), part.uvs.begin(), part.uvs.end());
  mesh->materials.insert(mesh->materials.end(), part.materials.begin(), part.materials.end());
  for (const auto& [a, b, c] : part.triangles) {
    mesh->triangles.push_back({a + offset, b + offset, c + offset});
  }
}

Mesh MakeBox(const Eigen::Vector3f& centre, const Eigen::Matrix3f& axes,
             const Eigen::Vector3f& half_size) {
  Mesh mesh;
  for (int axis = 0; axis < 3; ++axis) {
    for (float sign : {-1.0f, 1.0f}) {
      const Eigen::Vector3f normal = sign * axes.col(axis);
      const int next = (axis + 1) % 3;
      const Eigen::Vector3f side = axes.col(next) * half_size[next];
      const Eigen::Vector3f up = normal.cross(axes.col(next)) * half_size[(axis + 2) % 3];
      const Eigen::Vector3f middle = centre + normal * half_size[axis];
      const uint32_t first = static_cast<uint32_t>(mesh.vertices.size());
      for (auto [s, u] : {std::pair(-1, -1), {1, -1}, {1, 1}, {-1, 1}}) {
        mesh.vertices.push_back(middle + side * static_cast<float>(s) + up * static_cast<float>(u));
        mesh.normals.push_back(normal);
      }
      mesh.triangles.push_back({first, first + 1, first + 2});
      mesh.triangles.push_back({first, first + 2, first + 3});
    }
  }
  return mesh;
}

Mesh MakeCylinder(const CylinderShape& shape) {
  Mesh mesh;
  const float sign = shape.inward ? -1.0f : 1.0f;
  for (int ring = 0; ring <= shape.rings; ++ring) {
    const float z = shape.bottom + (shape.top - shape.bottom) * static_cast<float>(ring) /
                                       static_cast<float>(shape.rings);
    for (int side = 0; side < shape.sides; ++side) {
      const float angle = kTwoPi * static_cast<float>(side) / static_cast<float>(shape.sides);
      const Eigen::Vector3f outward(std::cos(angle), std::sin(angle), 0);
      mesh.vertices.push_back(Eigen::Vector3f(shape.centre.x(), shape.centre.y(), z) +
                              shape.radius * outward);
      mesh.normals.push_back(sign * outward);
    }
  }
  const auto vertex = [&](int ring, int side) {
    return static_cast<uint32_t>(ring * shape.sides + side % shape.sides);
  };
  for (int ring = 0; ring < shape.rings; ++ring) {
    for (int side = 0; side < shape.sides; ++side) {
      const uint32_t a = vertex(ring, side), b = vertex(ring, side + 1);
      const uint32_t c = vertex(ring + 1, side + 1), d = vertex(ring + 1, side);
      mesh.triangles.push_back(shape.inward ? std::array{a, c, b} : std::array{a, b, c});
      mesh.triangles.push_back(shape.inward ? std::array{a, d, c} : std::array{a, c, d});
    }
  }
  return mesh;
}

}  // namespace rotunda::sim
