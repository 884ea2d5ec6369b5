#include "rig/sim/obj_body.h"

#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <assimp/Importer.hpp>
#include <cctype>
#include <cmath>
#include <system_error>

#include "rig/sim/noise.h"
#include "rig/sim/ray_scene.h"

namespace rotunda::sim {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;

// Places on a standing person in a T-pose, as fractions of the height.
constexpr float kArmHeight = 0.812f;
constexpr float kShoulderY = 0.100f;
constexpr float kHandLength = 0.112f;
constexpr float kNeckZ = 0.850f;
constexpr float kArmDrop_rad = 0.87f;

struct Extent {
  float low = 1e9f;
  float high = -1e9f;
  void Add(float value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
  float Middle() const { return 0.5f * (low + high); }
  float Size() const { return high - low; }
};

template <typename Keep>
Extent ExtentWhere(const Mesh& mesh, int axis, const Keep& keep) {
  Extent extent;
  for (const Vector3f& p : mesh.vertices) {
    if (keep(p)) extent.Add(p[axis]);
  }
  return extent;
}

void AppendAssimp(const aiMesh& part, Mesh* mesh) {
  const uint32_t offset = static_cast<uint32_t>(mesh->vertices.size());
  for (unsigned i = 0; i < part.mNumVertices; ++i) {
    const aiVector3D& p = part.mVertices[i];
    mesh->vertices.emplace_back(p.x, p.y, p.z);
    const bool has_uv = part.HasTextureCoords(0);
    mesh->uvs.emplace_back(has_uv ? part.mTextureCoords[0][i].x : 0.0f,
                           has_uv ? part.mTextureCoords[0][i].y : 0.0f);
    const aiVector3D n = part.HasNormals() ? part.mNormals[i] : aiVector3D(0, 0, 1);
    mesh->normals.emplace_back(n.x, n.y, n.z);
  }
  for (unsigned i = 0; i < part.mNumFaces; ++i) {
    const aiFace& face = part.mFaces[i];
    if (face.mNumIndices != 3) continue;
    mesh->triangles.push_back(
        {face.mIndices[0] + offset, face.mIndices[1] + offset, face.mIndices[2] + offset});
    mesh->materials.push_back(static_cast<uint8_t>(part.mMaterialIndex));
  }
}

/// Turns, scales and places the mesh: z up, facing +x, feet at z = 0. kBadInput when it has no
/// height that could be scaled.
Status StandUp(float height_m, Mesh* mesh) {
  const auto all = [](const Vector3f&) { return true; };
  const bool y_up = ExtentWhere(*mesh, 1, all).Size() > ExtentWhere(*mesh, 2, all).Size();
  for (Vector3f& p : mesh->vertices)
    p = y_up ? Vector3f(p.z(), p.x(), p.y()) : Vector3f(-p.y(), p.x(), p.z());
  const Extent up = ExtentWhere(*mesh, 2, all);
  const float scale = height_m / up.Size();
  if (!(scale > 0) || !std::isfinite(scale)) {
    return Error{ErrorCode::kBadInput,
                 "is flat: its height (the larger extent in Y and Z) is " +
                     std::to_string(up.Size()) + ", expected a body that stands",
                 ""};
  }
  const float middle_y = ExtentWhere(*mesh, 1, all).Middle();
  for (Vector3f& p : mesh->vertices) p = scale * (p - Vector3f(0, middle_y, up.low));
  const Extent feet =
      ExtentWhere(*mesh, 0, [&](const Vector3f& p) { return p.z() < 0.03f * height_m; });
  const Extent shins = ExtentWhere(*mesh, 0, [&](const Vector3f& p) {
    return p.z() > 0.1f * height_m && p.z() < 0.2f * height_m;
  });
  const Extent trunk = ExtentWhere(*mesh, 0, [&](const Vector3f& p) {
    return p.z() > 0.5f * height_m && p.z() < 0.75f * height_m;
  });
  const float facing = feet.Middle() >= shins.Middle() ? 1.0f : -1.0f;
  for (Vector3f& p : mesh->vertices) {
    p = Vector3f(facing * (p.x() - trunk.Middle()), facing * p.y(), p.z());
  }
  return {};
}

bool IsTPose(const Mesh& mesh, float height_m) {
  const Extent span = ExtentWhere(mesh, 1, [](const Vector3f&) { return true; });
  return span.Size() > 0.8f * height_m;
}

/// Bends the shoulders: each arm turns down about its shoulder, the cloth around it in part.
void LowerArms(float height_m, Mesh* mesh) {
  for (Vector3f& p : mesh->vertices) {
    const Vector3f q = p / height_m;
    const float out = std::abs(q.y());
    const float above = SmoothStep(kArmHeight - 0.085f, kArmHeight - 0.035f, q.z());
    const float arm = out > 0.155f ? 1.0f : above;
    const float weight = arm * SmoothStep(0.065f, 0.145f, out);
    const float angle_rad = kArmDrop_rad * weight;
    const Vector2f pivot(kShoulderY, kArmHeight - 0.004f);
    const Vector2f from_pivot = Vector2f(out, q.z()) - pivot;
    const Vector2f turned = Eigen::Rotation2Df(-angle_rad) * from_pivot + pivot;
    p.y() = height_m * std::copysign(turned.x(), q.y());
    p.z() = height_m * turned.y();
  }
}

BodyLayout LayoutOf(const Mesh& mesh, float height_m, bool lowered, float reach_m) {
  BodyLayout layout;
  layout.height_m = height_m;
  const auto middle_x = [&](float low, float high, float out) {
    return ExtentWhere(mesh, 0,
                       [&](const Vector3f& p) {
                         return p.z() > low * height_m && p.z() < high * height_m &&
                                std::abs(p.y()) > out * height_m;
                       })
        .Middle();
  };
  const float torso_x = middle_x(0.55f, 0.75f, 0.0f), leg_x = middle_x(0.12f, 0.42f, 0.0f);
  const float arm_x = lowered ? middle_x(0.6f, 0.75f, 0.18f) : middle_x(0.75f, 0.85f, 0.2f);
  const float drop = lowered ? kArmDrop_rad : 0.0f;
  const float length = reach_m - (kShoulderY + kHandLength) * height_m;
  for (float side : {1.0f, -1.0f}) {
    const Vector2f shoulder = height_m * Vector2f(side * kShoulderY, kArmHeight - 0.004f);
    const Vector2f wrist = shoulder + length * Vector2f(side * std::cos(drop), -std::sin(drop));
    const Part arm = side > 0 ? Part::kLeftArm : Part::kRightArm;
    const Part leg = side > 0 ? Part::kLeftLeg : Part::kRightLeg;
    layout.parts[static_cast<size_t>(arm)] = {shoulder, wrist, arm_x, 0.030f * height_m,
                                              0.030f * height_m};
    layout.parts[static_cast<size_t>(leg)] = {height_m * Vector2f(side * 0.055f, 0.48f),
                                              height_m * Vector2f(side * 0.047f, 0.05f), leg_x,
                                              0.042f * height_m, 0.045f * height_m};
  }
  layout.parts[static_cast<size_t>(Part::kTorso)] = {Vector2f(0, 0.85f * height_m),
                                                     Vector2f(0, 0.45f * height_m), torso_x,
                                                     0.095f * height_m, 0.070f * height_m};
  layout.neck_z_m = kNeckZ * height_m;
  layout.cuff_s_m = length;
  layout.ankle_z_m = 0.058f * height_m;
  layout.hem_z_m = 0.49f * height_m;
  layout.crotch_z_m = 0.455f * height_m;
  return layout;
}

bool NamesHair(const aiMaterial& material) {
  std::string name = material.GetName().C_Str();
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return name.find("hair") != std::string::npos;
}

Result<Texture> TextureOf(const aiMaterial& material, const std::filesystem::path& folder) {
  aiString name;
  if (material.GetTexture(aiTextureType_DIFFUSE, 0, &name) != AI_SUCCESS) {
    Picture white(1, 1);
    white.rgb.assign(3, 200);
    return Texture(std::move(white));
  }
  ROTUNDA_ASSIGN_OR_RETURN(Picture picture, ReadPicture(folder / name.C_Str()));
  return Texture(std::move(picture), Texture::Wrap::kRepeat);
}

class ObjPaint : public Paint {
 public:
  ObjPaint(ObjBody body, std::unique_ptr<Garment> garment, Cover cover)
      : body_(std::move(body)),
        garment_(std::move(garment)),
        covered_(cover == Cover::kHeadAndShoes) {
    // A texel's size on the body, from areas in space and in the texture.
    double area_m2 = 0, area_uv = 0;
    const Mesh& mesh = body_.mesh;
    for (const auto& [a, b, c] : mesh.triangles) {
      const Vector3f u = mesh.vertices[b] - mesh.vertices[a],
                     v = mesh.vertices[c] - mesh.vertices[a];
      const Vector2f s = mesh.uvs[b] - mesh.uvs[a], t = mesh.uvs[c] - mesh.uvs[a];
      area_m2 += 0.5 * u.cross(v).norm();
      area_uv += 0.5 * std::abs(s.x() * t.y() - s.y() * t.x());
    }
    uv_per_m_ = static_cast<float>(std::sqrt(area_uv / std::max(area_m2, 1e-9)));
    body_.mesh = Mesh();
  }

  Vector3f Albedo(const SurfacePoint& point) const override {
    if (!body_.is_hair[point.material]) {
      const BodyLayout& layout = body_.layout;
      if (garment_ && layout.GarmentInside_m(point.position) > 0) return garment_->Albedo(point);
      if (covered_ && layout.OnHead(point.position)) return kHoodAlbedo;
      if (covered_ && layout.OnFoot(point.position)) return kPlainShoeAlbedo;
    }
    const Texture& texture = body_.textures[point.material];
    const float width = static_cast<float>(texture.width());
    return texture.Sample(point.uv.x() * width,
                          (1.0f - point.uv.y()) * static_cast<float>(texture.height()),
                          point.footprint_m * uv_per_m_ * width);
  }

 private:
  ObjBody body_;
  std::unique_ptr<Garment> garment_;
  bool covered_;
  float uv_per_m_ = 1;
};

}  // namespace

Result<ObjBody> ReadObjBody(const std::filesystem::path& file, float height_m) {
  std::error_code error;
  if (!std::filesystem::exists(file, error)) {
    if (error) return Error{ErrorCode::kIo, "cannot open: " + error.message(), file.string()};
    return Error{ErrorCode::kNotFound, "there is no such file", file.string()};
  }
  Assimp::Importer importer;
  const aiScene* scene =
      importer.ReadFile(file.string(), aiProcess_Triangulate | aiProcess_JoinIdenticalVertices |
                                           aiProcess_PreTransformVertices | aiProcess_SortByPType);
  if (!scene || scene->mNumMeshes == 0) {
    return Error{ErrorCode::kBadInput, std::string("is not a mesh: ") + importer.GetErrorString(),
                 file.string()};
  }
  ObjBody body;
  for (unsigned i = 0; i < scene->mNumMeshes; ++i) AppendAssimp(*scene->mMeshes[i], &body.mesh);
  if (body.mesh.triangles.empty()) {
    return Error{ErrorCode::kBadInput, "has no triangle", file.string()};
  }
  for (unsigned i = 0; i < scene->mNumMaterials; ++i) {
    ROTUNDA_ASSIGN_OR_RETURN(Texture texture, TextureOf(*scene->mMaterials[i], file.parent_path()));
    body.textures.push_back(std::move(texture));
    body.is_hair.push_back(NamesHair(*scene->mMaterials[i]));
  }
  if (const Status standing = StandUp(height_m, &body.mesh); !standing) {
    return standing.error().In(file.string());
  }
  const bool lowered = IsTPose(body.mesh, height_m);
  const float reach_m = ExtentWhere(body.mesh, 1, [](const Vector3f&) { return true; }).high;
  if (lowered) LowerArms(height_m, &body.mesh);
  body.layout = LayoutOf(body.mesh, height_m, lowered, reach_m);
  ComputeSmoothNormals(&body.mesh);
  return body;
}

Status MirrorFrontOntoBack(const BodyLayout& layout, Mesh* mesh) {
  World world;
  world.objects.emplace_back().mesh = *mesh;
  ROTUNDA_ASSIGN_OR_RETURN(const RayScene scene, RayScene::Build(world, false));
  const auto middle_x = [&](const Vector3f& p) {
    const float torso = layout.axis(Part::kTorso).x_m, leg = layout.axis(Part::kLeftLeg).x_m;
    const float arm = layout.axis(Part::kLeftArm).x_m;
    const float up = SmoothStep(0.40f, 0.55f, p.z() / layout.height_m);
    const float out = SmoothStep(0.10f, 0.15f, std::abs(p.y()) / layout.height_m);
    const float trunk = leg + up * (torso - leg);
    return trunk + up * out * (arm - trunk);
  };
  std::array<Vector3f, kRayPacket> directions;
  directions.fill(-Vector3f::UnitX());
  std::array<RayHit, kRayPacket> hits;
  for (Vector3f& p : mesh->vertices) {
    const float weight = SmoothStep(-0.03f * layout.height_m, 0.0f, layout.GarmentInside_m(p));
    const float middle = middle_x(p);
    if (weight == 0 || p.x() >= middle) continue;
    scene.Trace({2.0f, p.y(), p.z()}, 0.0f, directions, hits);
    if (hits[0].object == UINT32_MAX) continue;
    const float front = 2.0f - hits[0].distance;
    if (front > middle) p.x() += weight * (2 * middle - front - p.x());
  }
  ComputeSmoothNormals(mesh);
  return {};
}

std::unique_ptr<Paint> MakeObjPaint(ObjBody body, std::unique_ptr<Garment> garment, Cover cover) {
  return std::make_unique<ObjPaint>(std::move(body), std::move(garment), cover);
}

}  // namespace rotunda::sim
