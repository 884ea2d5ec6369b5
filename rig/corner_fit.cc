#include "rig/corner_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <vector>

namespace rotunda::rig {
namespace {

constexpr int kParameters = 10;
using Vector = Eigen::Matrix<double, kParameters, 1>;
using Matrix = Eigen::Matrix<double, kParameters, kParameters>;
enum Parameter { kX, kY, kAngle1, kAngle2, kBlur, kBlack, kContrast, kCurve, kSlopeX, kSlopeY };

constexpr int kMaxIterations = 20;
constexpr double kConverged_px = 1e-4;
constexpr double kStartBlur_px = 0.8;
constexpr double kMinBlur_px = 0.25;   // less cannot be told from a step
constexpr double kEdgeBand_px = 4;     // pixels farther from both edges say nothing
constexpr double kMarkerGuard_px = 2;  // what a marker's edge blurs into
constexpr double kMaxTurn_rad = 0.3;   // of an edge against the guess
constexpr double kLeastPixels = 30;

struct Sample {
  double x, y;  // from the guess
  double grey;
};

struct Edges {
  Eigen::Vector2d normal1, normal2;
};

double AngleOf(const Eigen::Vector2d& v) { return std::atan2(v.y(), v.x()); }

/// Pixels of the window that the model describes. Symmetric about the guess.
std::vector<Sample> CollectSamples(const cv::Mat& grey, const CornerGuess& guess,
                                   const CornerFitOptions& options) {
  const Eigen::Matrix2d squares_per_px = guess.px_per_square.inverse();
  const double side1 = guess.px_per_square.col(0).norm(), side2 = guess.px_per_square.col(1).norm();
  // Distance in pixels of a point (u, v) in squares from the edges: |u| * height1, |v| * height2.
  const double area = std::abs(guess.px_per_square.determinant());
  const double height1 = area / side2, height2 = area / side1;
  const double reach1 = std::min(options.max_reach_squares, options.max_reach_px / side1);
  const double reach2 = std::min(options.max_reach_squares, options.max_reach_px / side2);
  const auto gap = [&](double height) {
    return guess.marker_gap - std::min(kMarkerGuard_px / height, 0.5 * guess.marker_gap);
  };
  const double gap1 = gap(height1), gap2 = gap(height2);
  const Eigen::Vector2d extent = reach1 * guess.px_per_square.col(0).cwiseAbs() +
                                 reach2 * guess.px_per_square.col(1).cwiseAbs();
  const int x0 = static_cast<int>(std::floor(guess.pixel.x() - extent.x()));
  const int x1 = static_cast<int>(std::ceil(guess.pixel.x() + extent.x()));
  const int y0 = static_cast<int>(std::floor(guess.pixel.y() - extent.y()));
  const int y1 = static_cast<int>(std::ceil(guess.pixel.y() + extent.y()));
  if (x0 < 0 || y0 < 0 || x1 >= grey.cols || y1 >= grey.rows) return {};
  std::vector<Sample> samples;
  for (int y = y0; y <= y1; ++y) {
    const uint8_t* row = grey.ptr<uint8_t>(y);
    for (int x = x0; x <= x1; ++x) {
      const Eigen::Vector2d from(x + 0.5 - guess.pixel.x(), y + 0.5 - guess.pixel.y());
      const Eigen::Vector2d uv = squares_per_px * from;
      const double u = std::abs(uv.x()), v = std::abs(uv.y());
      if (u > reach1 || v > reach2) continue;
      if (u * height1 > kEdgeBand_px && v * height2 > kEdgeBand_px) continue;
      const bool black = (uv.x() * uv.y() > 0) == guess.top_left_black;
      if (!black && u > gap1 && v > gap2) continue;
      samples.push_back({from.x(), from.y(), static_cast<double>(row[x])});
    }
  }
  return samples;
}

class CornerModel {
 public:
  CornerModel(const std::vector<Sample>& samples, bool top_left_black)
      : samples_(samples), sign_(top_left_black ? -1.0 : 1.0) {}

  /// Sum of squares; J'J and J'r when `normal` is given.
  double Evaluate(const Vector& p, Matrix* normal, Vector* gradient) const {
    const Eigen::Vector2d n1(std::cos(p[kAngle1]), std::sin(p[kAngle1]));
    const Eigen::Vector2d n2(std::cos(p[kAngle2]), std::sin(p[kAngle2]));
    const double scale = 1 / (std::sqrt(2.0) * p[kBlur]);
    double squares = 0;
    if (normal) normal->setZero();
    if (gradient) gradient->setZero();
    Vector j;
    for (const Sample& sample : samples_) {
      const double x = sample.x - p[kX], y = sample.y - p[kY];
      const double d1 = n1.x() * x + n1.y() * y, d2 = n2.x() * x + n2.y() * y;
      const double e1 = std::erf(scale * d1), e2 = std::erf(scale * d2);
      const double w = 0.5 * (1 + sign_ * e1 * e2);
      const double slope = p[kSlopeX] * x + p[kSlopeY] * y;
      const double by_w = p[kContrast] + p[kCurve] * (1 - 2 * w) + slope;
      const double residual =
          p[kBlack] + (p[kContrast] + slope) * w + p[kCurve] * w * (1 - w) - sample.grey;
      squares += residual * residual;
      if (!normal) continue;
      const double factor = 0.5 * sign_ * by_w * scale * 2 / std::sqrt(M_PI);
      const double f1 = factor * e2 * std::exp(-scale * scale * d1 * d1);
      const double f2 = factor * e1 * std::exp(-scale * scale * d2 * d2);
      j[kX] = -f1 * n1.x() - f2 * n2.x() - w * p[kSlopeX];
      j[kY] = -f1 * n1.y() - f2 * n2.y() - w * p[kSlopeY];
      j[kAngle1] = f1 * (n1.x() * y - n1.y() * x);
      j[kAngle2] = f2 * (n2.x() * y - n2.y() * x);
      j[kBlur] = -(f1 * d1 + f2 * d2) / p[kBlur];
      j[kBlack] = 1;
      j[kContrast] = w;
      j[kCurve] = w * (1 - w);
      j[kSlopeX] = w * x;
      j[kSlopeY] = w * y;
      normal->selfadjointView<Eigen::Lower>().rankUpdate(j);
      *gradient += residual * j;
    }
    return squares;
  }

 private:
  const std::vector<Sample>& samples_;
  double sign_;
};

Vector StartOf(const std::vector<Sample>& samples, const CornerGuess& guess) {
  std::vector<double> greys;
  for (const Sample& sample : samples) greys.push_back(sample.grey);
  std::sort(greys.begin(), greys.end());
  const double black = greys[greys.size() / 10], white = greys[greys.size() * 9 / 10];
  // The edge along the board's y is the one that d1 is measured from: its normal points along +x.
  const Eigen::Vector2d along_x = guess.px_per_square.col(0), along_y = guess.px_per_square.col(1);
  Eigen::Vector2d n1(along_y.y(), -along_y.x()), n2(-along_x.y(), along_x.x());
  if (n1.dot(along_x) < 0) n1 = -n1;
  if (n2.dot(along_y) < 0) n2 = -n2;
  Vector start = Vector::Zero();
  start[kAngle1] = AngleOf(n1);
  start[kAngle2] = AngleOf(n2);
  start[kBlur] = kStartBlur_px;
  start[kBlack] = black;
  start[kContrast] = white - black;
  return start;
}

struct Solution {
  Vector parameters;
  Matrix inverse_normal;
  double squares;
};

/// Levenberg-Marquardt; nullopt when it does not settle.
std::optional<Solution> Solve(const CornerModel& model, Vector p) {
  Matrix normal;
  Vector gradient;
  double squares = model.Evaluate(p, &normal, &gradient);
  double damping = 1e-3;
  for (int i = 0; i < kMaxIterations; ++i) {
    Matrix damped = normal.selfadjointView<Eigen::Lower>();
    damped.diagonal() *= 1 + damping;
    damped.diagonal().array() += 1e-12;
    const Vector step = -damped.ldlt().solve(gradient);
    if (!step.allFinite()) return std::nullopt;
    Vector next = p + step;
    next[kBlur] = std::max(next[kBlur], kMinBlur_px);
    const double next_squares = model.Evaluate(next, nullptr, nullptr);
    if (next_squares > squares) {
      damping *= 8;
      if (damping > 1e6) break;
      continue;
    }
    p = next;
    damping = std::max(damping / 8, 1e-9);
    squares = model.Evaluate(p, &normal, &gradient);
    if (std::abs(step[kX]) + std::abs(step[kY]) < kConverged_px) {
      const Matrix full = normal.selfadjointView<Eigen::Lower>();
      return Solution{p, full.ldlt().solve(Matrix::Identity()), squares};
    }
  }
  return std::nullopt;
}

}  // namespace

std::optional<CornerFit> FitCorner(const cv::Mat& grey, const CornerGuess& guess,
                                   const CornerFitOptions& options) {
  const std::vector<Sample> samples = CollectSamples(grey, guess, options);
  if (samples.size() < kLeastPixels) return std::nullopt;
  const Vector start = StartOf(samples, guess);
  if (start[kContrast] < 0.5 * options.min_contrast) return std::nullopt;
  const CornerModel model(samples, guess.top_left_black);
  const std::optional<Solution> solution = Solve(model, start);
  if (!solution) return std::nullopt;
  const Vector& p = solution->parameters;
  const double freedom = static_cast<double>(samples.size()) - kParameters;
  CornerFit fit;
  fit.pixel = guess.pixel + Eigen::Vector2d(p[kX], p[kY]);
  fit.blur_px = p[kBlur];
  fit.contrast = p[kContrast];
  fit.residual = std::sqrt(solution->squares / freedom);
  const bool turned = std::abs(p[kAngle1] - start[kAngle1]) > kMaxTurn_rad ||
                      std::abs(p[kAngle2] - start[kAngle2]) > kMaxTurn_rad;
  if (turned || fit.contrast < options.min_contrast ||
      fit.residual > options.max_residual * fit.contrast) {
    return std::nullopt;
  }
  const double variance =
      0.5 * (solution->inverse_normal(kX, kX) + solution->inverse_normal(kY, kY));
  if (!(variance > 0)) return std::nullopt;
  fit.sigma_px = std::hypot(fit.residual * std::sqrt(variance), options.floor_px);
  return fit;
}

}  // namespace rotunda::rig
