#include "rig/sim/ray_scene.h"

#include <embree3/rtcore.h>

#include <limits>

namespace rotunda::sim {

struct RayScene::Impl {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  ~Impl() {
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
  }
};

RayScene::RayScene(const World& world, bool shadow_casters_only) : impl_(std::make_unique<Impl>()) {
  // Embree's own threads would not change the result, only take cores that are not ours.
  impl_->device = rtcNewDevice("threads=1,set_affinity=0");
  impl_->scene = rtcNewScene(impl_->device);
  rtcSetSceneFlags(impl_->scene, RTC_SCENE_FLAG_ROBUST);
  for (size_t i = 0; i < world.objects.size(); ++i) {
    const WorldObject& object = world.objects[i];
    if (shadow_casters_only && !object.casts_shadow) continue;
    const Mesh& mesh = object.mesh;
    RTCGeometry geometry = rtcNewGeometry(impl_->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* vertices = static_cast<float*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                3 * sizeof(float), mesh.vertices.size()));
    for (const Eigen::Vector3f& vertex : mesh.vertices) {
      for (int axis = 0; axis < 3; ++axis) *vertices++ = vertex[axis];
    }
    auto* indices = static_cast<uint32_t*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                3 * sizeof(uint32_t), mesh.triangles.size()));
    for (const auto& triangle : mesh.triangles) {
      for (uint32_t vertex : triangle) *indices++ = vertex;
    }
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(impl_->scene, geometry, static_cast<unsigned>(i));
    rtcReleaseGeometry(geometry);
  }
  rtcCommitScene(impl_->scene);
}

RayScene::~RayScene() = default;

void RayScene::Trace(const Eigen::Vector3f& origin, float near,
                     std::span<const Eigen::Vector3f> directions, std::span<RayHit> hits) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  alignas(32) RTCRayHit8 packet;
  alignas(32) int valid[kRayPacket];
  for (size_t i = 0; i < kRayPacket; ++i) {
    valid[i] = -1;
    packet.ray.org_x[i] = origin.x();
    packet.ray.org_y[i] = origin.y();
    packet.ray.org_z[i] = origin.z();
    packet.ray.dir_x[i] = directions[i].x();
    packet.ray.dir_y[i] = directions[i].y();
    packet.ray.dir_z[i] = directions[i].z();
    packet.ray.tnear[i] = near;
    packet.ray.tfar[i] = std::numeric_limits<float>::infinity();
    packet.ray.time[i] = 0;
    packet.ray.mask[i] = ~0u;
    packet.ray.id[i] = 0;
    packet.ray.flags[i] = 0;
    packet.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    packet.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
  rtcIntersect8(valid, impl_->scene, &context, &packet);
  for (size_t i = 0; i < kRayPacket; ++i) {
    hits[i] = {packet.hit.geomID[i], packet.hit.primID[i], packet.ray.tfar[i], packet.hit.u[i],
               packet.hit.v[i]};
  }
}

void RayScene::Occluded(const Eigen::Vector3f& origin, std::span<const Eigen::Vector3f> directions,
                        std::span<bool> occluded) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  alignas(32) RTCRay8 packet;
  alignas(32) int valid[kRayPacket];
  for (size_t i = 0; i < kRayPacket; ++i) {
    valid[i] = -1;
    packet.org_x[i] = origin.x();
    packet.org_y[i] = origin.y();
    packet.org_z[i] = origin.z();
    packet.dir_x[i] = directions[i].x();
    packet.dir_y[i] = directions[i].y();
    packet.dir_z[i] = directions[i].z();
    packet.tnear[i] = 0;
    packet.tfar[i] = std::numeric_limits<float>::infinity();
    packet.time[i] = 0;
    packet.mask[i] = ~0u;
    packet.id[i] = 0;
    packet.flags[i] = 0;
  }
  rtcOccluded8(valid, impl_->scene, &context, &packet);
  for (size_t i = 0; i < kRayPacket; ++i) occluded[i] = packet.tfar[i] < 0;
}

}  // namespace rotunda::sim
