#include "rig/sim/lighting.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "rig/sim/noise.h"
#include "rig/sim/ray_scene.h"

namespace rotunda::sim {
namespace {

using Eigen::Vector3f;

constexpr int kDirections = 64;    // a vertex; a multiple of kRayPacket
constexpr float kBounce = 0.22f;   // radiance of an occluder
constexpr float kLift_m = 0.002f;  // start above the surface, against its own facets
constexpr int kChunk = 512;
constexpr int kSmoothing = 2;  // passes over neighbours, against sampling noise

struct SoftBox {
  Vector3f towards;
  float radiance;
  float cosine;  // of its angular radius
};

/// Cosine-weighted directions around +z: a Fibonacci spiral on the disc, lifted (Malley).
std::array<Vector3f, kDirections> CosineDirections() {
  std::array<Vector3f, kDirections> directions;
  for (int i = 0; i < kDirections; ++i) {
    const float radius = std::sqrt((static_cast<float>(i) + 0.5f) / kDirections);
    const float angle = 2.3999632f * static_cast<float>(i);
    directions[i] = {radius * std::cos(angle), radius * std::sin(angle),
                     std::sqrt(1.0f - radius * radius)};
  }
  return directions;
}

float LightAt(const RayScene& scene, const Vector3f& position, const Vector3f& normal,
              const std::array<Vector3f, kDirections>& directions) {
  const Eigen::Matrix3f turn =
      Eigen::Quaternionf::FromTwoVectors(Vector3f::UnitZ(), normal).toRotationMatrix();
  const Vector3f origin = position + kLift_m * normal;
  float sum = 0;
  for (size_t first = 0; first < kDirections; first += kRayPacket) {
    std::array<Vector3f, kRayPacket> packet;
    std::array<bool, kRayPacket> occluded;
    for (size_t i = 0; i < kRayPacket; ++i) packet[i] = turn * directions[first + i];
    scene.Occluded(origin, packet, occluded);
    for (size_t i = 0; i < kRayPacket; ++i) {
      sum += occluded[i] ? kBounce : StudioRadiance(packet[i]);
    }
  }
  return sum / kDirections;
}

void Smooth(const Mesh& mesh, std::vector<float>* values) {
  std::vector<float> sum = *values;
  std::vector<float> weight(values->size(), 1.0f);
  for (const auto& triangle : mesh.triangles) {
    for (int i = 0; i < 3; ++i) {
      sum[triangle[i]] += (*values)[triangle[(i + 1) % 3]];
      weight[triangle[i]] += 1.0f;
    }
  }
  for (size_t i = 0; i < sum.size(); ++i) (*values)[i] = sum[i] / weight[i];
}

}  // namespace

float StudioRadiance(const Vector3f& direction) {
  static const std::array<SoftBox, 6> kBoxes = {{
      {Vector3f(0.80f, 0.45f, 0.40f).normalized(), 1.5f, 0.86f},
      {Vector3f(0.75f, -0.55f, 0.35f).normalized(), 1.1f, 0.86f},
      {Vector3f(-0.80f, 0.50f, 0.40f).normalized(), 1.2f, 0.86f},
      {Vector3f(-0.75f, -0.50f, 0.45f).normalized(), 1.4f, 0.86f},
      {Vector3f(0.0f, 1.0f, 0.1f).normalized(), 0.8f, 0.90f},
      {Vector3f(0.0f, -1.0f, 0.1f).normalized(), 0.8f, 0.90f},
  }};
  const float ceiling = 0.9f * SmoothStep(0.45f, 0.95f, direction.z());
  float radiance = 0.42f + 0.18f * direction.z() + ceiling;
  for (const SoftBox& box : kBoxes) {
    radiance +=
        box.radiance * SmoothStep(box.cosine, 0.5f + 0.5f * box.cosine, direction.dot(box.towards));
  }
  return radiance;
}

Status BakeLight(World* world, ThreadPool& threads) {
  ROTUNDA_ASSIGN_OR_RETURN(const RayScene scene, RayScene::Build(*world, true));
  const std::array<Vector3f, kDirections> directions = CosineDirections();
  for (WorldObject& object : world->objects) {
    const Mesh& mesh = object.mesh;
    std::vector<float> light(mesh.vertices.size());
    threads.ParallelFor((light.size() + kChunk - 1) / kChunk, [&](size_t chunk) {
      const size_t end = std::min(light.size(), (chunk + 1) * kChunk);
      for (size_t i = chunk * kChunk; i < end; ++i) {
        light[i] = LightAt(scene, mesh.vertices[i], mesh.normals[i], directions);
      }
    });
    for (int pass = 0; pass < kSmoothing; ++pass) Smooth(mesh, &light);
    object.light = std::move(light);
  }
  return {};
}

}  // namespace rotunda::sim
