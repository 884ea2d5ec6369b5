#include "rig/mosaic_detection.h"

#include <algorithm>
#include <array>
#include <map>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace rotunda::rig {
namespace {

/// The pixels of one colour of the mosaic.
struct Phase {
  int x = 0;
  int y = 0;
};
constexpr std::array<Phase, 4> kPhases = {{{0, 0}, {1, 0}, {0, 1}, {1, 1}}};

/// 255 within the hull of each face's corners, in the picture of half the size.
cv::Mat MaskOf(const BoardDetection& detection, const cv::Size& size) {
  std::map<int, std::vector<cv::Point>> faces;
  for (const BoardCorner& corner : detection.corners) {
    faces[corner.face].push_back(
        {static_cast<int>(corner.pixel.x()), static_cast<int>(corner.pixel.y())});
  }
  cv::Mat mask = cv::Mat::zeros(size, CV_8UC1);
  for (const auto& [face, corners] : faces) {
    std::vector<cv::Point> hull;
    cv::convexHull(corners, hull);
    cv::fillConvexPoly(mask, hull, cv::Scalar(255));
  }
  return mask;
}

/// The pixels of a colour, as a picture of half the size.
cv::Mat PixelsOf(const cv::Mat& mosaic, const Phase& phase, const cv::Size& half) {
  cv::Mat pixels(half, CV_8UC1);
  for (int y = 0; y < half.height; ++y) {
    const auto* row = mosaic.ptr<uint8_t>(2 * y + phase.y);
    auto* out = pixels.ptr<uint8_t>(y);
    for (int x = 0; x < half.width; ++x) out[x] = row[2 * x + phase.x];
  }
  return pixels;
}

/// Factors by phase that give the colours one mean within the mask, and keep its brightest pixel
/// below saturation. All 1 where the board is black in a colour.
std::array<double, 4> Gains(const cv::Mat& mosaic, const cv::Mat& mask) {
  std::array<double, 4> mean = {}, brightest = {}, gains = {1, 1, 1, 1};
  double grey = 0;
  for (size_t p = 0; p < kPhases.size(); ++p) {
    const cv::Mat pixels = PixelsOf(mosaic, kPhases[p], mask.size());
    mean[p] = cv::mean(pixels, mask)[0];
    cv::minMaxLoc(pixels, nullptr, &brightest[p], nullptr, nullptr, mask);
    grey += mean[p] / 4;
  }
  if (*std::min_element(mean.begin(), mean.end()) < 1) return gains;
  double top = 0;
  for (size_t p = 0; p < kPhases.size(); ++p) {
    gains[p] = grey / mean[p];
    top = std::max(top, gains[p] * brightest[p]);
  }
  for (double& gain : gains) gain *= std::min(1.0, 255.0 / top);
  return gains;
}

cv::Mat Balanced(const cv::Mat& mosaic, const std::array<double, 4>& gains) {
  cv::Mat balanced(mosaic.size(), CV_8UC1);
  for (int y = 0; y < mosaic.rows; ++y) {
    const auto* row = mosaic.ptr<uint8_t>(y);
    auto* out = balanced.ptr<uint8_t>(y);
    for (int x = 0; x < mosaic.cols; ++x) {
      const auto phase = static_cast<size_t>(2 * (y & 1) + (x & 1));
      out[x] = cv::saturate_cast<uint8_t>(gains[phase] * row[x]);
    }
  }
  return balanced;
}

}  // namespace

Result<BoardDetection> DetectBoardInMosaic(const cv::Mat& mosaic, const cv::Mat& demosaiced,
                                           const Board& board,
                                           const BoardDetectionOptions& options) {
  const cv::Size half(mosaic.cols / 2, mosaic.rows / 2);
  if (half.empty()) return DetectBoard(demosaiced, board, options);
  cv::Mat small;
  cv::resize(mosaic(cv::Rect(0, 0, 2 * half.width, 2 * half.height)), small, half, 0, 0,
             cv::INTER_AREA);
  ROTUNDA_ASSIGN_OR_RETURN(BoardDetection found, DetectBoard(small, board, options));
  cv::Mat mask = MaskOf(found, half);
  if (cv::countNonZero(mask) == 0) {
    ROTUNDA_ASSIGN_OR_RETURN(found, DetectBoard(demosaiced, board, options));
    for (BoardCorner& corner : found.corners) corner.pixel /= 2;
    mask = MaskOf(found, half);
    if (cv::countNonZero(mask) == 0) return found;
  }
  return DetectBoard(Balanced(mosaic, Gains(mosaic, mask)), board, options);
}

}  // namespace rotunda::rig
