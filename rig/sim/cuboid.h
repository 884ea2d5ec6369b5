#pragma once

#include <Eigen/Core>
#include <array>

#include "rig/sim/texture.h"
#include "rig/sim/world.h"
#include "sfm/core/result.h"
#include "sfm/core/rigid3.h"

namespace rotunda::sim {

/// A box with a ChArUco board on its four sides and its top. Markers are AprilTag 36h11; ids run
/// on from face to face in the order of CuboidFace, row by row within one.
struct CuboidOptions {
  int columns = 7;  // squares across each side, and both ways on the top; odd
  int rows = 25;    // squares down each side; odd (OpenCV 4.6 draws even ones differently)
  double square_mm = 60;
  double marker_mm = 45;  // edge of a tag, black border included
  double margin_mm = 20;  // white around each board

  Status Validate() const;
  int MarkersOnSide() const { return columns * rows / 2; }
  int MarkersOnTop() const { return columns * columns / 2; }
};

enum class CuboidFace { kFront, kLeft, kBack, kRight, kTop };
inline constexpr int kCuboidFaces = 5;

/// Where a face is on the cuboid, whose frame has its origin in the middle of its bottom, z up,
/// the front face towards +x: a point (x right, y down, 0), metres from the face's top-left
/// corner as seen from outside, is origin + x * right + y * down.
struct CuboidFaceFrame {
  Eigen::Vector3d origin, right, down;
  double width_m = 0, height_m = 0;
  int columns = 0, rows = 0;
  int first_id = 0;

  Eigen::Vector3d At(double x_m, double y_m) const { return origin + x_m * right + y_m * down; }
};
CuboidFaceFrame FaceOf(const CuboidOptions& options, CuboidFace face);

/// The board printed on a face, with its margin. Squares are a whole number of texels, so that
/// nothing is rounded: texel = offset_texels + texels_per_m * metres on the face.
struct FacePrint {
  Picture picture;
  double texels_per_m = 0;
  double offset_texels = 0;
};
FacePrint DrawFace(const CuboidOptions& options, CuboidFace face);

/// Where the cuboid stands in shot `placement`: 0 upright on the axis facing +x; others turned,
/// shifted and a little tilted.
Rigid3 CuboidPlacement(int placement);

WorldObject MakeCuboid(const CuboidOptions& options, const Rigid3& rig_from_cuboid);

}  // namespace rotunda::sim
