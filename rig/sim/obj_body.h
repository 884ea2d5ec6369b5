#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "rig/sim/body_shape.h"
#include "rig/sim/garment.h"
#include "rig/sim/texture.h"
#include "rig/sim/world.h"
#include "sfm/core/result.h"

namespace rotunda::sim {

/// A scanned or modelled person from a file, standing in the rig: feet on the floor, on the axis,
/// facing +x, arms lowered from a T-pose.
struct ObjBody {
  Mesh mesh;  // materials index `textures`; uvs in 0..1, v up
  BodyLayout layout;
  std::vector<Texture> textures;  // of each material; one plain white texel when it has none
  std::vector<bool> is_hair;      // of each material, by its name
};

/// Reads an OBJ (anything Assimp reads) with Y or Z up, in any unit, scaled to `height_m`. Up is
/// the larger of the extents in Y and Z (x is across in both); the front is where the feet point.
/// kBadInput when there is no triangle or no height; kNotFound when there is no file.
Result<ObjBody> ReadObjBody(const std::filesystem::path& file, float height_m);

/// Mirrors the front of the garment region onto its back (x -> -x about the body's middle). Errors
/// as RayScene::Build.
Status MirrorFrontOntoBack(const BodyLayout& layout, Mesh* mesh);

/// The body's own colours; `garment` covers all but head, hands and feet when it is there. `cover`
/// leaves hair as it is if it has a material of its own.
std::unique_ptr<Paint> MakeObjPaint(ObjBody body, std::unique_ptr<Garment> garment, Cover cover);

}  // namespace rotunda::sim
