#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "sfm/core/result.h"

namespace rotunda::sim {

/// 8-bit RGB, rows from the top. Values are coded as 255 * sqrt(linear albedo).
struct Picture {
  int width = 0;
  int height = 0;
  std::vector<uint8_t> rgb;

  Picture() = default;
  Picture(int w, int h) : width(w), height(h), rgb(static_cast<size_t>(w) * h * 3) {}
  uint8_t* at(int x, int y) { return rgb.data() + (static_cast<size_t>(y) * width + x) * 3; }
  const uint8_t* at(int x, int y) const {
    return rgb.data() + (static_cast<size_t>(y) * width + x) * 3;
  }
};

/// Any picture file OpenCV reads.
Result<Picture> ReadPicture(const std::filesystem::path& file);

/// A picture with its pyramid of halved ones, looked up with trilinear filtering.
class Texture {
 public:
  enum class Wrap { kClamp, kRepeat };
  explicit Texture(Picture base, Wrap wrap = Wrap::kClamp);

  /// Linear albedo at (x, y) in texels of the base picture (0, 0 its top-left corner), averaged
  /// over about `footprint` texels.
  Eigen::Vector3f Sample(float x, float y, float footprint) const;
  int width() const { return levels_[0].width; }
  int height() const { return levels_[0].height; }

 private:
  Eigen::Vector3f Bilinear(const Picture& level, float x, float y) const;
  std::vector<Picture> levels_;
  Wrap wrap_;
};

}  // namespace rotunda::sim
