#include "rig/sim/texture.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

namespace rotunda::sim {
namespace {

Picture Halved(const Picture& fine) {
  Picture coarse(std::max(fine.width / 2, 1), std::max(fine.height / 2, 1));
  for (int y = 0; y < coarse.height; ++y) {
    for (int x = 0; x < coarse.width; ++x) {
      const int x0 = 2 * x, x1 = std::min(x0 + 1, fine.width - 1);
      const int y0 = 2 * y, y1 = std::min(y0 + 1, fine.height - 1);
      for (int c = 0; c < 3; ++c) {
        const int sum =
            fine.at(x0, y0)[c] + fine.at(x1, y0)[c] + fine.at(x0, y1)[c] + fine.at(x1, y1)[c];
        coarse.at(x, y)[c] = static_cast<uint8_t>((sum + 2) / 4);
      }
    }
  }
  return coarse;
}

}  // namespace

Result<Picture> ReadPicture(const std::filesystem::path& file) {
  cv::Mat bgr;
  try {
    bgr = cv::imread(file.string(), cv::IMREAD_COLOR);
  } catch (const cv::Exception& exception) {
    return Error{ErrorCode::kBadInput, "cannot decode: " + exception.err, file.string()};
  }
  if (bgr.empty()) {
    return Error{ErrorCode::kBadInput, "is not a picture that can be read", file.string()};
  }
  Picture picture(bgr.cols, bgr.rows);
  for (int y = 0; y < bgr.rows; ++y) {
    const uint8_t* row = bgr.ptr<uint8_t>(y);
    for (int x = 0; x < bgr.cols; ++x) {
      for (int c = 0; c < 3; ++c) picture.at(x, y)[c] = row[3 * x + 2 - c];
    }
  }
  return picture;
}

Texture::Texture(Picture base, Wrap wrap) : wrap_(wrap) {
  levels_.push_back(std::move(base));
  while (std::min(levels_.back().width, levels_.back().height) > 1) {
    levels_.push_back(Halved(levels_.back()));
  }
}

Eigen::Vector3f Texture::Bilinear(const Picture& level, float x, float y) const {
  const float fx = std::floor(x - 0.5f), fy = std::floor(y - 0.5f);
  const float tx = x - 0.5f - fx, ty = y - 0.5f - fy;
  const auto place = [this](int i, int size) {
    if (wrap_ == Wrap::kClamp) return std::clamp(i, 0, size - 1);
    i %= size;
    return i < 0 ? i + size : i;
  };
  const int x0 = place(static_cast<int>(fx), level.width);
  const int x1 = place(static_cast<int>(fx) + 1, level.width);
  const int y0 = place(static_cast<int>(fy), level.height);
  const int y1 = place(static_cast<int>(fy) + 1, level.height);
  const uint8_t *a = level.at(x0, y0), *b = level.at(x1, y0);
  const uint8_t *c = level.at(x0, y1), *d = level.at(x1, y1);
  Eigen::Vector3f coded;
  for (int i = 0; i < 3; ++i) {
    const float top = a[i] + (b[i] - a[i]) * tx, bottom = c[i] + (d[i] - c[i]) * tx;
    coded[i] = (top + (bottom - top) * ty) * (1.0f / 255.0f);
  }
  return coded.cwiseProduct(coded);
}

Eigen::Vector3f Texture::Sample(float x, float y, float footprint) const {
  const float level = std::clamp(std::log2(std::max(footprint, 1e-6f)), 0.0f,
                                 static_cast<float>(levels_.size() - 1));
  const int fine = static_cast<int>(level);
  const float t = level - static_cast<float>(fine);
  const float scale = 1.0f / static_cast<float>(1 << fine);
  const Eigen::Vector3f near = Bilinear(levels_[fine], x * scale, y * scale);
  if (t < 0.01f) return near;
  return near + t * (Bilinear(levels_[fine + 1], 0.5f * x * scale, 0.5f * y * scale) - near);
}

}  // namespace rotunda::sim
