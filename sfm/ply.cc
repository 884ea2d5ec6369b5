#include <bit>

#include "sfm/colmap_io.h"
#include "sfm/core/file_io.h"

namespace rotunda::sfm {

static_assert(std::endian::native == std::endian::little, "the file says little-endian");

Status WritePly(const Reconstruction& reconstruction, const std::filesystem::path& file) {
  std::string bytes =
      "ply\n"
      "format binary_little_endian 1.0\n"
      "element vertex ";
  bytes += std::to_string(reconstruction.points.size());
  bytes +=
      "\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "end_header\n";
  for (const Point3& point : reconstruction.points) {
    const Eigen::Vector3f position = point.position.cast<float>();
    bytes.append(reinterpret_cast<const char*>(position.data()), 3 * sizeof(float));
    bytes.append(reinterpret_cast<const char*>(point.color_rgb.data()), point.color_rgb.size());
  }
  return WriteFileAtomically(file, bytes);
}

}  // namespace rotunda::sfm
