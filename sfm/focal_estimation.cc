#include "sfm/focal_estimation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "sfm/core/statistics.h"
#include "sfm/epipolar.h"

namespace rotunda::sfm {
namespace {

/// Pairs that vote: those with most matches seen under a useful angle.
constexpr size_t kMaxPairs = 40;
constexpr double kMinAngle_rad = RadFromDeg(3.0);
/// Steps of the grid each way from 1, and their ratio: 1.08^12 = 2.5.
constexpr int kSteps = 12;
constexpr double kStepRatio = 1.08;
constexpr size_t kGridSize = 2 * kSteps + 1;
/// Least fall of the mean log squared error for a factor to replace the guess.
constexpr double kMinFall = 0.01;
constexpr int kRefineIterations = 15;

CameraIntrinsics Scaled(CameraIntrinsics lens, double factor) {
  for (size_t p = 0; p < lens.params.size(); ++p) {
    if (IsFocal(lens.model, p)) lens.params[p] *= factor;
  }
  return lens;
}

std::vector<Correspondence> Correspondences(const Features& features, const TwoView& pair,
                                            const CameraIntrinsics& first,
                                            const CameraIntrinsics& second) {
  std::vector<Correspondence> data;
  for (const Match& match : pair.inliers) {
    const Keypoint& a = features.image(pair.pair.first).keypoints[match.first.index()];
    const Keypoint& b = features.image(pair.pair.second).keypoints[match.second.index()];
    const auto ray_a = first.NormalizedFromPixel({a.x_px, a.y_px});
    const auto ray_b = second.NormalizedFromPixel({b.x_px, b.y_px});
    if (ray_a && ray_b) data.push_back({*ray_a, *ray_b});
  }
  return data;
}

double SumOfSampson(const Rigid3& second_from_first, const std::vector<Correspondence>& data) {
  const Eigen::Matrix3d essential = EssentialFromPose(second_from_first);
  double sum = 0;
  for (const Correspondence& c : data) sum += SquaredSampson(essential, c);
  return sum;
}

/// Log of the mean squared Sampson distance, in pixels, of the pair's best pose at every factor of
/// the grid. The pose at one factor starts from its neighbour's, nearer to 1, and from the pair's
/// own; the better end counts.
std::array<double, kGridSize> LogErrors(const Features& features, const Intrinsics& guessed,
                                        const TwoView& pair) {
  std::array<double, kGridSize> errors;
  for (const int direction : {-1, 1}) {
    Rigid3 pose = pair.second_from_first;
    for (int step = 0; step <= kSteps; ++step) {
      const double factor = std::pow(kStepRatio, direction * step);
      const CameraIntrinsics first = Scaled(guessed.of(pair.pair.first), factor);
      const CameraIntrinsics second = Scaled(guessed.of(pair.pair.second), factor);
      const std::vector<Correspondence> data = Correspondences(features, pair, first, second);
      double sum = std::numeric_limits<double>::infinity();
      for (const Rigid3& start : {Rigid3(pose), pair.second_from_first}) {
        const Rigid3 refined = RefinePose(start, data, kRefineIterations);
        const double error = SumOfSampson(refined, data);
        if (!(error < sum)) continue;
        sum = error;
        pose = refined;
      }
      const double focal_px = 0.5 * (first.MeanFocal_px() + second.MeanFocal_px());
      constexpr double kLeastError_px2 = 1e-6;  // exact matches: below the keypoints' rounding
      errors[static_cast<size_t>(kSteps + direction * step)] =
          std::log(kLeastError_px2 +
                   focal_px * focal_px * sum / std::max(1.0, static_cast<double>(data.size())));
    }
  }
  return errors;
}

std::vector<const TwoView*> VotingPairs(const TwoViews& two_views) {
  std::vector<const TwoView*> pairs;
  for (const TwoView& pair : two_views.pairs) {
    if (pair.kind == TwoViewKind::kUncalibrated && pair.median_angle_rad >= kMinAngle_rad) {
      pairs.push_back(&pair);
    }
  }
  std::stable_sort(pairs.begin(), pairs.end(), [](const TwoView* a, const TwoView* b) {
    return a->inliers.size() > b->inliers.size();
  });
  pairs.resize(std::min(pairs.size(), kMaxPairs));
  return pairs;
}

/// Where a parabola through the least value of the grid and its neighbours is least, as a factor.
double FactorOfMinimum(const std::array<double, kGridSize>& values) {
  const auto least =
      static_cast<size_t>(std::min_element(values.begin(), values.end()) - values.begin());
  if (!(values[least] < values[kSteps] - kMinFall)) return 1.0;
  double place = static_cast<double>(least);
  if (least > 0 && least + 1 < kGridSize) {
    const double below = values[least - 1], above = values[least + 1];
    const double curvature = below + above - 2.0 * values[least];
    if (curvature > 0) place += 0.5 * (below - above) / curvature;
  }
  return std::pow(kStepRatio, place - kSteps);
}

double EstimateFactor(const Features& features, const Intrinsics& guessed,
                      const TwoViews& two_views, RunContext& context) {
  const std::vector<const TwoView*> pairs = VotingPairs(two_views);
  if (pairs.empty()) return 1.0;
  std::vector<std::array<double, kGridSize>> errors(pairs.size());
  context.threads.ParallelFor(
      pairs.size(), [&](size_t i) { errors[i] = LogErrors(features, guessed, *pairs[i]); });
  std::array<double, kGridSize> mean = {};
  for (const auto& of_pair : errors) {
    for (size_t g = 0; g < kGridSize; ++g) {
      mean[g] += of_pair[g] / static_cast<double>(pairs.size());
    }
  }
  return FactorOfMinimum(mean);
}

TwoView Reposed(const Features& features, const Intrinsics& intrinsics, TwoView pair) {
  if (pair.kind == TwoViewKind::kPanoramic) return pair;
  const std::vector<Correspondence> data = Correspondences(
      features, pair, intrinsics.of(pair.pair.first), intrinsics.of(pair.pair.second));
  if (data.empty()) return pair;
  pair.second_from_first = RefinePose(pair.second_from_first, data, kRefineIterations);
  std::vector<double> angles;
  for (const Correspondence& c : data) angles.push_back(RayAngle_rad(pair.second_from_first, c));
  pair.median_angle_rad = Median(std::move(angles));
  return pair;
}

}  // namespace

SelfCalibration EstimateFocalLengths(const Features& features, const Intrinsics& guessed,
                                     const TwoViews& two_views, RunContext& context) {
  SelfCalibration result = {guessed, two_views,
                            EstimateFactor(features, guessed, two_views, context)};
  if (result.focal_factor == 1.0) return result;
  for (CameraIntrinsics& lens : result.intrinsics.lenses) {
    lens = Scaled(lens, result.focal_factor);
  }
  context.threads.ParallelFor(two_views.pairs.size(), [&](size_t i) {
    result.two_views.pairs[i] = Reposed(features, result.intrinsics, two_views.pairs[i]);
  });
  return result;
}

}  // namespace rotunda::sfm
