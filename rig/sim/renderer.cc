#include "rig/sim/renderer.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "rig/sim/lighting.h"

namespace rotunda::sim {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;

constexpr float kNear_m = 0.2f;         // a lens does not see its own housing
constexpr float kDepthStep_m = 0.006f;  // between neighbours: more is an edge

/// Rays of a camera in the rig frame. Undistorted directions are solved on every eighth pixel and
/// interpolated between: the error is below 0.002 px for the lenses RigOptions allows.
class CameraRays {
 public:
  explicit CameraRays(const CalibratedCamera& camera) {
    const CameraIntrinsics& intrinsics = camera.intrinsics;
    columns_ = intrinsics.width_px / kStep + 2;
    const int rows = intrinsics.height_px / kStep + 2;
    rig_from_cam_ = camera.cam_from_rig.RotationMatrix().transpose().cast<float>();
    origin_ = camera.cam_from_rig.OriginInSource().cast<float>();
    pixel_angle_ = static_cast<float>(1.0 / intrinsics.MeanFocal_px());
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns_; ++column) {
        const Eigen::Vector2d pixel(column * kStep, row * kStep);
        const auto normalized = intrinsics.NormalizedFromPixel(pixel);
        nodes_.push_back(normalized.value_or(Eigen::Vector2d::Zero()).cast<float>());
      }
    }
  }

  /// Not of unit length: one metre deep in the camera.
  Vector3f Direction(float x, float y) const {
    const float gx = x / kStep, gy = y / kStep;
    const int ix = static_cast<int>(gx), iy = static_cast<int>(gy);
    const float tx = gx - static_cast<float>(ix), ty = gy - static_cast<float>(iy);
    const Vector2f* node = &nodes_[static_cast<size_t>(iy) * columns_ + ix];
    const Vector2f top = node[0] + tx * (node[1] - node[0]);
    const Vector2f bottom = node[columns_] + tx * (node[columns_ + 1] - node[columns_]);
    const Vector2f uv = top + ty * (bottom - top);
    return rig_from_cam_ * Vector3f(uv.x(), uv.y(), 1.0f);
  }
  const Vector3f& origin() const { return origin_; }
  float pixel_angle() const { return pixel_angle_; }

 private:
  static constexpr int kStep = 8;
  int columns_;
  Eigen::Matrix3f rig_from_cam_;
  Vector3f origin_;
  float pixel_angle_;
  std::vector<Vector2f> nodes_;
};

class CameraRenderer {
 public:
  CameraRenderer(const World& world, const RayScene& scene, const CalibratedCamera& camera,
                 const Vector3f& backdrop)
      : world_(world), scene_(scene), rays_(camera), backdrop_(backdrop) {
    image_.width = camera.intrinsics.width_px;
    image_.height = camera.intrinsics.height_px;
    hits_.resize(static_cast<size_t>(image_.width) * image_.height);
    image_.samples.resize(hits_.size() * kParts);
  }

  LightImage Render() {
    for (int y = 0; y < image_.height; y += 2) {
      for (int x = 0; x < image_.width; x += 4) TraceBlock(x, y);
    }
    for (int y = 0; y < image_.height; ++y) {
      for (int x = 0; x < image_.width; ++x) {
        const PixelLight light = IsEdge(x, y) ? EdgePixel(x, y) : SmoothPixel(x, y);
        for (int i = 0; i < kParts; ++i) {
          image_.at(kLightSamples * x + i % kLightSamples, kLightSamples * y + i / kLightSamples) =
              light[i];
        }
      }
    }
    return std::move(image_);
  }

 private:
  static constexpr int kParts = kLightSamples * kLightSamples;
  using PixelLight = std::array<Vector3f, kParts>;  // the pixel's samples, row by row
  static constexpr int kEdgeRays = 2;               // along each side of a sample, at an edge
  static constexpr int kEdgeGrid = kEdgeRays * kLightSamples;  // along a pixel's

  const RayHit& HitAt(int x, int y) const {
    return hits_[static_cast<size_t>(y) * image_.width + x];
  }

  void TraceBlock(int x0, int y0) {
    std::array<Vector3f, kRayPacket> directions;
    std::array<RayHit, kRayPacket> hits;
    for (int i = 0; i < static_cast<int>(kRayPacket); ++i) {
      const int x = std::min(x0 + i % 4, image_.width - 1);
      const int y = std::min(y0 + i / 4, image_.height - 1);
      directions[i] = rays_.Direction(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f);
    }
    scene_.Trace(rays_.origin(), kNear_m, directions, hits);
    for (int i = 0; i < static_cast<int>(kRayPacket); ++i) {
      const int x = x0 + i % 4, y = y0 + i / 4;
      if (x < image_.width && y < image_.height) {
        hits_[static_cast<size_t>(y) * image_.width + x] = hits[i];
      }
    }
  }

  bool IsEdge(int x, int y) const {
    const RayHit& here = HitAt(x, y);
    const auto differs = [&](int nx, int ny) {
      if (nx < 0 || ny < 0 || nx >= image_.width || ny >= image_.height) return false;
      const RayHit& there = HitAt(nx, ny);
      if (there.object != here.object) return true;
      if (here.object == UINT32_MAX) return false;
      const float limit =
          world_.objects[here.object].casts_shadow ? kDepthStep_m : 0.02f * here.distance;
      return std::abs(there.distance - here.distance) > limit;
    };
    return differs(x - 1, y) || differs(x + 1, y) || differs(x, y - 1) || differs(x, y + 1);
  }

  /// Everything about a hit but the colour.
  struct Shading {
    const WorldObject* object;
    SurfacePoint point;
    float light;
    float footprint_m;  // of a pixel
    std::array<const Vector3f*, 3> corners;
    std::array<uint32_t, 3> vertices;
  };
  Shading ShadingOf(const RayHit& hit, const Vector3f& direction) const {
    Shading s;
    s.object = &world_.objects[hit.object];
    const Mesh& mesh = s.object->mesh;
    s.vertices = mesh.triangles[hit.triangle];
    const std::array<float, 3> weights = {1.0f - hit.u - hit.v, hit.u, hit.v};
    s.point.position = rays_.origin() + hit.distance * direction;
    s.point.normal = Vector3f::Zero();
    s.point.uv = Vector2f::Zero();
    s.light = 0;
    for (int i = 0; i < 3; ++i) {
      s.corners[i] = &mesh.vertices[s.vertices[i]];
      s.point.normal += weights[i] * mesh.normals[s.vertices[i]];
      s.light += weights[i] * s.object->light[s.vertices[i]];
      if (!mesh.uvs.empty()) s.point.uv += weights[i] * mesh.uvs[s.vertices[i]];
    }
    s.point.normal.normalize();
    if (!mesh.materials.empty()) s.point.material = mesh.materials[hit.triangle];
    const float cosine = std::abs(s.point.normal.dot(direction)) / direction.norm();
    s.footprint_m = hit.distance * rays_.pixel_angle() / std::max(cosine, 0.35f);
    return s;
  }

  Vector3f Highlight(const Shading& s, const Vector3f& direction) const {
    const float gloss = s.object->paint->Gloss(s.point);
    if (gloss == 0) return Vector3f::Zero();
    const Vector3f view = direction.normalized();
    const Vector3f mirrored = view - 2.0f * view.dot(s.point.normal) * s.point.normal;
    return Vector3f::Constant(gloss * std::min(s.light, 1.0f) * StudioRadiance(mirrored));
  }

  /// One triangle fills the pixel: its plane is sampled, no more rays are needed.
  PixelLight SmoothPixel(int x, int y) const {
    PixelLight light;
    const RayHit& hit = HitAt(x, y);
    if (hit.object == UINT32_MAX) {
      light.fill(backdrop_);
      return light;
    }
    const Vector3f direction =
        rays_.Direction(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f);
    const Shading s = ShadingOf(hit, direction);
    if (!s.object->paint->Detailed()) {
      SurfacePoint whole = s.point;
      whole.footprint_m = s.footprint_m;
      light.fill(s.light * s.object->paint->Albedo(whole) + Highlight(s, direction));
      return light;
    }
    const Vector3f plane =
        (*s.corners[1] - *s.corners[0]).cross(*s.corners[2] - *s.corners[0]).normalized();
    const float height = plane.dot(s.point.position - rays_.origin());
    const Vector3f highlight = Highlight(s, direction);
    SurfacePoint sample = s.point;
    sample.footprint_m = s.footprint_m / kLightSamples;
    std::array<Vector3f, kParts> positions;
    for (int i = 0; i < kParts; ++i) {
      const Vector2f at = GridPoint(i, kLightSamples);
      const Vector3f ray =
          rays_.Direction(static_cast<float>(x) + at.x(), static_cast<float>(y) + at.y());
      const float facing = plane.dot(ray);
      // A plane seen edge-on may meet the neighbouring ray far away.
      const float distance = std::abs(facing) > 0.05f ? height / facing : hit.distance;
      positions[i] = rays_.origin() + distance * ray;
    }
    const bool has_uv = !s.object->mesh.uvs.empty();
    if (has_uv) {
      const Vector2f first = UvAt(s, positions[0]);
      sample.uv_footprint = (UvAt(s, positions[1]) - first).cwiseAbs() +
                            (UvAt(s, positions[kLightSamples]) - first).cwiseAbs();
    }
    for (int i = 0; i < kParts; ++i) {
      sample.position = positions[i];
      if (has_uv) sample.uv = UvAt(s, sample.position);
      light[i] = s.light * s.object->paint->Albedo(sample) + highlight;
    }
    return light;
  }

  /// Texture coordinates of a point in the plane of the triangle.
  static Vector2f UvAt(const Shading& s, const Vector3f& position) {
    const Vector3f a = *s.corners[1] - *s.corners[0], b = *s.corners[2] - *s.corners[0];
    const Vector3f p = position - *s.corners[0];
    const float aa = a.dot(a), ab = a.dot(b), bb = b.dot(b), pa = p.dot(a), pb = p.dot(b);
    const float determinant = std::max(aa * bb - ab * ab, 1e-20f);
    const float u = (bb * pa - ab * pb) / determinant, v = (aa * pb - ab * pa) / determinant;
    const std::vector<Vector2f>& uvs = s.object->mesh.uvs;
    return (1.0f - u - v) * uvs[s.vertices[0]] + u * uvs[s.vertices[1]] + v * uvs[s.vertices[2]];
  }

  static Vector2f GridPoint(int i, int grid) {
    const float step = 1.0f / static_cast<float>(grid);
    return {(static_cast<float>(i % grid) + 0.5f) * step,
            (static_cast<float>(i / grid) + 0.5f) * step};
  }

  PixelLight EdgePixel(int x, int y) const {
    constexpr int kSamples = kEdgeGrid * kEdgeGrid;
    std::array<Vector3f, kSamples> directions;
    std::array<RayHit, kSamples> hits;
    for (int i = 0; i < kSamples; ++i) {
      const Vector2f at = GridPoint(i, kEdgeGrid);
      directions[i] =
          rays_.Direction(static_cast<float>(x) + at.x(), static_cast<float>(y) + at.y());
    }
    for (size_t first = 0; first < kSamples; first += kRayPacket) {
      scene_.Trace(rays_.origin(), kNear_m, std::span(directions).subspan(first, kRayPacket),
                   std::span(hits).subspan(first, kRayPacket));
    }
    constexpr float kShare = 1.0f / (kEdgeRays * kEdgeRays);
    PixelLight light;
    light.fill(Vector3f::Zero());
    for (int i = 0; i < kSamples; ++i) {
      Vector3f& part = light[i / kEdgeGrid / kEdgeRays * kLightSamples + i % kEdgeGrid / kEdgeRays];
      if (hits[i].object == UINT32_MAX) {
        part += kShare * backdrop_;
        continue;
      }
      Shading s = ShadingOf(hits[i], directions[i]);
      s.point.footprint_m = s.footprint_m / kEdgeGrid;
      part += kShare * (s.light * s.object->paint->Albedo(s.point) + Highlight(s, directions[i]));
    }
    return light;
  }

  const World& world_;
  const RayScene& scene_;
  CameraRays rays_;
  Vector3f backdrop_;
  LightImage image_;
  std::vector<RayHit> hits_;
};

}  // namespace

LightImage RenderLight(const World& world, const RayScene& scene, const CalibratedCamera& camera,
                       const Eigen::Vector3f& backdrop) {
  return CameraRenderer(world, scene, camera, backdrop).Render();
}

}  // namespace rotunda::sim
