#include "rig/sim/ray_scene.h"

#include <embree3/rtcore.h>

#include <limits>
#include <string>
#include <utility>

namespace rotunda::sim {

namespace {

Error EmbreeFailed(RTCDevice device, const char* what) {
  const std::string code = std::to_string(static_cast<int>(rtcGetDeviceError(device)));
  return {ErrorCode::kFailed, std::string(what) + " (its error code is " + code + ")", "Embree"};
}

/// Hands the mesh to Embree; its id is the object's place in the world.
Status AttachMesh(const Mesh& mesh, unsigned id, RTCDevice device, RTCScene scene) {
  const std::unique_ptr<RTCGeometryTy, void (*)(RTCGeometry)> geometry(
      rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE), [](RTCGeometry g) {
        if (g != nullptr) rtcReleaseGeometry(g);
      });
  if (!geometry) return EmbreeFailed(device, "cannot make a geometry");
  auto* vertices = static_cast<float*>(
      rtcSetNewGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                              3 * sizeof(float), mesh.vertices.size()));
  auto* indices = static_cast<uint32_t*>(
      rtcSetNewGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                              3 * sizeof(uint32_t), mesh.triangles.size()));
  if (vertices == nullptr || indices == nullptr) {
    return EmbreeFailed(device, "cannot make a mesh's buffers");
  }
  for (const Eigen::Vector3f& vertex : mesh.vertices) {
    for (int axis = 0; axis < 3; ++axis) *vertices++ = vertex[axis];
  }
  for (const auto& triangle : mesh.triangles) {
    for (uint32_t vertex : triangle) *indices++ = vertex;
  }
  rtcCommitGeometry(geometry.get());
  rtcAttachGeometryByID(scene, geometry.get(), id);
  return {};
}

}  // namespace

struct RayScene::Impl {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  ~Impl() {
    if (scene != nullptr) rtcReleaseScene(scene);
    if (device != nullptr) rtcReleaseDevice(device);
  }
};

RayScene::RayScene(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
RayScene::RayScene(RayScene&&) noexcept = default;
RayScene& RayScene::operator=(RayScene&&) noexcept = default;
RayScene::~RayScene() = default;

Result<RayScene> RayScene::Build(const World& world, bool shadow_casters_only) {
  auto impl = std::make_unique<Impl>();
  // Embree's own threads would not change the result, only take cores that are not ours.
  impl->device = rtcNewDevice("threads=1,set_affinity=0");
  if (impl->device == nullptr) return EmbreeFailed(nullptr, "cannot start");
  impl->scene = rtcNewScene(impl->device);
  if (impl->scene == nullptr) return EmbreeFailed(impl->device, "cannot make a scene");
  rtcSetSceneFlags(impl->scene, RTC_SCENE_FLAG_ROBUST);
  for (size_t i = 0; i < world.objects.size(); ++i) {
    const WorldObject& object = world.objects[i];
    if (shadow_casters_only && !object.casts_shadow) continue;
    if (object.mesh.triangles.empty()) continue;
    ROTUNDA_RETURN_IF_ERROR(
        AttachMesh(object.mesh, static_cast<unsigned>(i), impl->device, impl->scene));
  }
  rtcCommitScene(impl->scene);
  if (const RTCError code = rtcGetDeviceError(impl->device); code != RTC_ERROR_NONE) {
    return Error{
        ErrorCode::kFailed,
        "cannot build the scene (its error code is " + std::to_string(static_cast<int>(code)) + ")",
        "Embree"};
  }
  return RayScene(std::move(impl));
}

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
