#include "rig/corner_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

namespace rotunda::rig {
namespace {

constexpr int kParameters = 10;
using Vector = Eigen::Matrix<double, kParameters, 1>;
using Matrix = Eigen::Matrix<double, kParameters, kParameters>;
enum Parameter { kX, kY, kAngle1, kAngle2, kBlur, kBlack, kContrast, kTone, kSlopeX, kSlopeY };

constexpr int kMaxIterations = 30;
constexpr double kConverged_px = 1e-4;
constexpr double kStartBlur_px = 0.7;
constexpr double kMinBlur_px = 0.15;  // less cannot be told from a step
constexpr double kFar = 4.5;          // erf is 1 to 2e-10
constexpr double kStartTone = 0.5;
constexpr double kMaxTone = 6;
constexpr double kMaxToneStep = 1;
constexpr int kHeldTone = 3;  // iterations: edges that are not yet where they are bend the curve
constexpr double kEdgeBand_px = 4;     // pixels farther from both edges say nothing
constexpr double kMarkerGuard_px = 2;  // what a marker's edge blurs into
constexpr double kMaxTurn_rad = 0.3;   // of an edge against the guess
constexpr size_t kLeastPixels = 30;

struct Sample {
  double x, y;  // from the guess
  double grey;
};

struct Edges {
  Eigen::Vector2d normal1, normal2;
};

double AngleOf(const Eigen::Vector2d& v) { return std::atan2(v.y(), v.x()); }

/// Pixels of the window that the model describes. Symmetric about the guess. Empty when the window
/// is not all in the picture.
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

/// What pixels see of an edge from -1 to 1 that a Gaussian spot of standard deviation `blur_px`
/// blurs: its mean over the pixel's square, as a function of the pixel's distance from the edge.
/// Along the edge's normal n the square is a box of width |nx| convolved with one of width |ny|.
/// The wider (a) is integrated, the narrower (b) is taken for a Gaussian of its variance b^2/12:
///     E(d) = (G(d + a/2) - G(d - a/2)) / a,  G' = erf(x / (sqrt(2) s)),  s^2 = blur^2 + b^2/12.
class EdgeProfile {
 public:
  struct Value {
    double value, by_distance, by_blur;
  };

  EdgeProfile(const Eigen::Vector2d& normal, double blur_px)
      : width_(normal.cwiseAbs().maxCoeff()), blur_px_(blur_px) {
    const double narrow = normal.cwiseAbs().minCoeff();
    sigma_ = std::sqrt(blur_px * blur_px + narrow * narrow / 12);
  }

  Value At(double distance) const {
    const double scale = 1 / (std::sqrt(2.0) * sigma_);
    const double ahead = distance + 0.5 * width_, behind = distance - 0.5 * width_;
    if (scale * behind > kFar) return {1, 0, 0};
    if (scale * ahead < -kFar) return {-1, 0, 0};
    const double erf1 = std::erf(scale * ahead), erf2 = std::erf(scale * behind);
    // The spot's density at both ends of the box, times 2 sigma.
    const double bell = std::sqrt(2 / M_PI);
    const double bell1 = bell * std::exp(-scale * scale * ahead * ahead);
    const double bell2 = bell * std::exp(-scale * scale * behind * behind);
    return {(ahead * erf1 - behind * erf2 + sigma_ * (bell1 - bell2)) / width_,
            (erf1 - erf2) / width_, (bell1 - bell2) / width_ * blur_px_ / sigma_};
  }

 private:
  double width_, blur_px_, sigma_;
};

/// What makes an edge seem to lie to one side, on black's side for a camera's tone curve, on
/// white's for ink that spreads: a curve between black (0) and white (1). It is the power of sRGB,
///     T(w) = ((1 + t w)^(1/2.4) - 1) / ((1 + t)^(1/2.4) - 1),  t = exp(u) - 1,
/// u > 0: as sRGB on light of which white has exp(u) times as much as black; u = 0: linear; -u: the
/// same curve turned about its middle, 1 - T(1 - w).
class ToneCurve {
 public:
  struct Value {
    double value, by_light, by_strength;
  };

  explicit ToneCurve(double strength)
      : base_(std::exp(std::abs(strength) < kLinear ? kLinear : strength)),
        white_(std::pow(base_, kPower)) {}

  Value At(double light) const {
    if (light < kFlat) return {0, 1, 0};
    if (light > 1 - kFlat) return {1, 1, 0};
    const double base = 1 + (base_ - 1) * light;
    const double power = std::pow(base, kPower), steep = kPower * power / base;
    const double value = (power - 1) / (white_ - 1);
    return {value, steep * (base_ - 1) / (white_ - 1),
            (steep * light * base_ - value * kPower * white_) / (white_ - 1)};
  }

 private:
  static constexpr double kPower = 1 / 2.4;
  static constexpr double kFlat = 1e-9;    // from black and white: no edge is here
  static constexpr double kLinear = 1e-3;  // less cannot be told from none
  double base_, white_;
};

class CornerModel {
 public:
  CornerModel(const std::vector<Sample>& samples, bool top_left_black)
      : samples_(samples), sign_(top_left_black ? -1.0 : 1.0) {}

  struct Evaluation {
    double squares = 0;
    Matrix normal = Matrix::Zero();  // J'J, lower half
    Vector gradient = Vector::Zero();
  };
  Evaluation Evaluate(const Vector& p) const {
    const Eigen::Vector2d n1(std::cos(p[kAngle1]), std::sin(p[kAngle1]));
    const Eigen::Vector2d n2(std::cos(p[kAngle2]), std::sin(p[kAngle2]));
    const EdgeProfile profile1(n1, p[kBlur]), profile2(n2, p[kBlur]);
    const ToneCurve tone(p[kTone]);
    Evaluation all;
    Vector j;
    for (const Sample& sample : samples_) {
      const double x = sample.x - p[kX], y = sample.y - p[kY];
      const EdgeProfile::Value e1 = profile1.At(n1.x() * x + n1.y() * y);
      const EdgeProfile::Value e2 = profile2.At(n2.x() * x + n2.y() * y);
      const double w = 0.5 * (1 + sign_ * e1.value * e2.value);
      const double slope = p[kSlopeX] * x + p[kSlopeY] * y;
      const ToneCurve::Value seen = tone.At(w);
      const double v = seen.value;
      const double residual = p[kBlack] + (p[kContrast] + slope) * v - sample.grey;
      all.squares += residual * residual;
      const double by_v = p[kContrast] + slope;
      const double by_w = by_v * seen.by_light;
      const double f1 = 0.5 * sign_ * by_w * e2.value, f2 = 0.5 * sign_ * by_w * e1.value;
      const double d1 = f1 * e1.by_distance, d2 = f2 * e2.by_distance;
      j[kX] = -d1 * n1.x() - d2 * n2.x() - v * p[kSlopeX];
      j[kY] = -d1 * n1.y() - d2 * n2.y() - v * p[kSlopeY];
      j[kAngle1] = d1 * (n1.x() * y - n1.y() * x);
      j[kAngle2] = d2 * (n2.x() * y - n2.y() * x);
      j[kBlur] = f1 * e1.by_blur + f2 * e2.by_blur;
      j[kBlack] = 1;
      j[kContrast] = v;
      j[kTone] = by_v * seen.by_strength;
      j[kSlopeX] = v * x;
      j[kSlopeY] = v * y;
      all.normal.selfadjointView<Eigen::Lower>().rankUpdate(j);
      all.gradient += residual * j;
    }
    return all;
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
  start[kTone] = kStartTone;
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
  // Nearly every step is taken: derivatives come with each evaluation, not in a second one.
  CornerModel::Evaluation here = model.Evaluate(p);
  double damping = 1e-3;
  for (int i = 0; i < kMaxIterations; ++i) {
    Matrix damped = here.normal.selfadjointView<Eigen::Lower>();
    Vector gradient = here.gradient;
    if (i < kHeldTone) {
      damped.row(kTone).setZero();
      damped.col(kTone).setZero();
      damped(kTone, kTone) = 1;
      gradient[kTone] = 0;
    }
    damped.diagonal() *= 1 + damping;
    damped.diagonal().array() += 1e-12;
    Vector step = -damped.ldlt().solve(gradient);
    if (!step.allFinite()) return std::nullopt;
    step *= std::min(1.0, kMaxToneStep / std::max(std::abs(step[kTone]), 1e-9));
    Vector next = p + step;
    next[kBlur] = std::max(next[kBlur], kMinBlur_px);
    next[kTone] = std::clamp(next[kTone], -kMaxTone, kMaxTone);
    CornerModel::Evaluation there = model.Evaluate(next);
    if (there.squares <= here.squares) {
      p = next;
      damping = std::max(damping / 8, 1e-9);
      here = there;
    } else {
      damping *= 8;
    }
    if (i >= kHeldTone && std::abs(step[kX]) + std::abs(step[kY]) < kConverged_px) {
      const Matrix full = here.normal.selfadjointView<Eigen::Lower>();
      return Solution{p, full.ldlt().solve(Matrix::Identity()), here.squares};
    }
  }
  return std::nullopt;
}

}  // namespace

CornerMeasurement FitCorner(const cv::Mat& grey, const CornerGuess& guess,
                            const CornerFitOptions& options) {
  const std::vector<Sample> samples = CollectSamples(grey, guess, options);
  if (samples.empty()) return CornerRejection::kAtEdge;
  if (samples.size() < kLeastPixels) return CornerRejection::kSmall;
  const Vector start = StartOf(samples, guess);
  if (start[kContrast] < 0.5 * options.min_contrast) return CornerRejection::kFaint;
  const CornerModel model(samples, guess.top_left_black);
  const std::optional<Solution> solution = Solve(model, start);
  if (!solution) return CornerRejection::kUnclear;
  const Vector& p = solution->parameters;
  const double freedom = static_cast<double>(samples.size()) - kParameters;
  CornerFit fit;
  fit.pixel = guess.pixel + Eigen::Vector2d(p[kX], p[kY]);
  fit.blur_px = p[kBlur];
  fit.contrast = p[kContrast];
  fit.residual = std::sqrt(solution->squares / freedom);
  if (std::abs(fit.contrast) < options.min_contrast) return CornerRejection::kFaint;
  const bool turned = std::abs(p[kAngle1] - start[kAngle1]) > kMaxTurn_rad ||
                      std::abs(p[kAngle2] - start[kAngle2]) > kMaxTurn_rad;
  const double variance =
      0.5 * (solution->inverse_normal(kX, kX) + solution->inverse_normal(kY, kY));
  // Of an inverted corner the contrast is negative, and any residual too large.
  if (turned || fit.residual > options.max_residual * fit.contrast || !(variance > 0)) {
    return CornerRejection::kUnclear;
  }
  fit.sigma_px = std::hypot(fit.residual * std::sqrt(variance), options.floor_px);
  return fit;
}

}  // namespace rotunda::rig
