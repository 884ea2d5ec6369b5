#include "rig/mosaic_detection.h"

#include <algorithm>
#include <array>
#include <map>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace rotunda::rig {
namespace {

/// Pixels of the board that its colours are balanced over. An edge that runs along the pixels'
/// rows passes through more pixels of one colour than of another, on its bright side or its dark
/// one: factors from N pixels are off by 0.09 / sqrt(N) (median; 0.25 for one in ten pictures), and
/// corners begin to suffer at 0.01 (by 0.002 px).
constexpr int kEnoughPixels = 4000;
/// The area's rim is blurred by this much: a sharp one adds as much again, an edge of its own.
constexpr double kSoftRim_px = 2;

/// 255 where the picture certainly shows the board: within the hull of each face's corners, which
/// are given in a picture `scale` times as large, and as far around as squares are wide at least.
cv::Mat MaskOf(const BoardDetection& detection, double scale, const cv::Size& size,
               const BoardDetectionOptions& options) {
  std::map<int, std::vector<cv::Point>> faces;
  for (const BoardCorner& corner : detection.corners) {
    const Eigen::Vector2d pixel = corner.pixel / scale;
    faces[corner.face].push_back({static_cast<int>(pixel.x()), static_cast<int>(pixel.y())});
  }
  const int rim_px = static_cast<int>(2 * options.min_square_px);  // half of it lies within
  cv::Mat mask = cv::Mat::zeros(size, CV_8UC1);
  for (const auto& [face, corners] : faces) {
    std::vector<cv::Point> hull;
    cv::convexHull(corners, hull);
    cv::fillConvexPoly(mask, hull, cv::Scalar(255));
    cv::polylines(mask, hull, true, cv::Scalar(255), rim_px);
  }
  return mask;
}

/// By colour of the mosaic: left and right of even rows, then of odd ones.
size_t PhaseOf(int x, int y) { return static_cast<size_t>(2 * (y & 1) + (x & 1)); }

/// Factors by phase that give the colours one mean within the mask, and keep its brightest pixel
/// below saturation. All 1 where the board is black in a colour.
std::array<double, 4> Gains(const cv::Mat& mosaic, const cv::Mat& mask) {
  cv::Mat soft;
  cv::GaussianBlur(mask, soft, {}, kSoftRim_px);
  std::array<double, 4> sum = {}, weight = {}, mean = {}, brightest = {}, gains = {1, 1, 1, 1};
  for (int y = 0; y < mosaic.rows; ++y) {
    const auto* row = mosaic.ptr<uint8_t>(y);
    const auto* weights = soft.ptr<uint8_t>(y);
    const auto* inside = mask.ptr<uint8_t>(y);
    for (int x = 0; x < mosaic.cols; ++x) {
      const size_t p = PhaseOf(x, y);
      sum[p] += weights[x] * row[x];
      weight[p] += weights[x];
      if (inside[x] > 0) brightest[p] = std::max<double>(brightest[p], row[x]);
    }
  }
  double grey = 0;
  for (size_t p = 0; p < gains.size(); ++p) {
    mean[p] = sum[p] / weight[p];
    grey += mean[p] / 4;
  }
  if (*std::min_element(mean.begin(), mean.end()) < 1) return gains;
  double top = 0;
  for (size_t p = 0; p < gains.size(); ++p) {
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
      out[x] = cv::saturate_cast<uint8_t>(gains[PhaseOf(x, y)] * row[x]);
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
  ROTUNDA_ASSIGN_OR_RETURN(const BoardDetection in_half, DetectBoard(small, board, options));
  cv::Mat mask = MaskOf(in_half, 0.5, mosaic.size(), options);
  if (cv::countNonZero(mask) < kEnoughPixels) {
    ROTUNDA_ASSIGN_OR_RETURN(const BoardDetection found, DetectBoard(demosaiced, board, options));
    mask |= MaskOf(found, 1, mosaic.size(), options);
    if (cv::countNonZero(mask) == 0) return found;
  }
  return DetectBoard(Balanced(mosaic, Gains(mosaic, mask)), board, options);
}

}  // namespace rotunda::rig
