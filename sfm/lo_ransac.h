#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <random>
#include <span>
#include <vector>

namespace rotunda::sfm {

/// MSAC (Torr & Zisserman, CVIU 2000): cost = sum over the data of min(r^2, t^2), with the
/// estimator's residual r and threshold t; inliers = data with r < t. Lower cost is better.
struct RansacScore {
  double cost = std::numeric_limits<double>::infinity();
  size_t inliers = 0;
};

struct RansacOptions {
  /// Probability that at least one all-inlier sample was drawn when the loop stops.
  double confidence = 0.999;
  int min_iterations = 10;
  int max_iterations = 10000;
  /// The caller has no use for a model with fewer inliers than this share of the data, so that the
  /// loop needs not draw more samples than `confidence` asks for at this share.
  double min_inlier_ratio = 0.0;
  uint64_t seed = 0;
};

/// What LoRansac is run over.
///   kSampleSize         data in a minimal sample
///   size()              number of data
///   Solve(sample, out)  puts the models that a minimal sample of distinct indices allows (any
///                       number, also none) into `out`, which comes empty
///   Score(model, bail)  the score of a model; may return early, with any count of inliers and a
///                       cost above `bail`, once the cost is known to exceed `bail`
///   Refine(model)       the model after non-minimal optimisation on its inliers, or the model
///                       itself when they are too few
template <typename E>
concept RansacEstimator = requires(const E& estimator,
                                   std::span<const size_t, E::kSampleSize> sample,
                                   std::vector<typename E::Model>& models,
                                   const typename E::Model& model, double bail) {
  { E::kSampleSize } -> std::convertible_to<size_t>;
  { estimator.size() } -> std::convertible_to<size_t>;
  {estimator.Solve(sample, models)};
  { estimator.Score(model, bail) } -> std::same_as<RansacScore>;
  { estimator.Refine(model) } -> std::same_as<typename E::Model>;
};

template <typename Model>
struct RansacResult {
  Model model;
  RansacScore score;
  int iterations = 0;
};

/// A whole number in [0, count) from 32 random bits: the same on every standard library, which
/// std::uniform_int_distribution is not. The bias is below count / 2^32.
inline size_t RandomIndex(std::mt19937_64& random, size_t count) {
  return static_cast<size_t>(((random() >> 32) * count) >> 32);
}

/// Distinct indices below `count` (>= sample.size()), by rejection: samples are small.
inline void DrawSample(std::mt19937_64& random, size_t count, std::span<size_t> sample) {
  for (size_t i = 0; i < sample.size(); ++i) {
    do {
      sample[i] = RandomIndex(random, count);
    } while (std::find(sample.begin(), sample.begin() + i, sample[i]) != sample.begin() + i);
  }
}

/// Samples needed to draw one of `sample_size` inliers only with probability `confidence`
/// (Fischler & Bolles, CACM 1981), at most `limit`.
inline int RequiredIterations(double inlier_ratio, size_t sample_size, double confidence,
                              int limit) {
  const double all_inliers = std::pow(inlier_ratio, static_cast<double>(sample_size));
  if (all_inliers >= 1.0) return 1;
  if (all_inliers <= std::numeric_limits<double>::epsilon()) return limit;
  const double needed = std::ceil(std::log1p(-confidence) / std::log1p(-all_inliers));
  return needed < limit ? std::max(1, static_cast<int>(needed)) : limit;
}

/// RANSAC with local optimisation of every best-so-far model (Chum, Matas & Kittler, DAGM 2003;
/// Lebeda, Matas & Chum, BMVC 2012): the steps of the optimisation are accepted while they lower
/// the cost. nullopt when there are fewer data than a sample needs or no sample gave a model. The
/// result depends on the estimator and the options alone.
template <RansacEstimator E>
std::optional<RansacResult<typename E::Model>> LoRansac(const E& estimator,
                                                        const RansacOptions& options) {
  constexpr int kMaxLocalSteps = 5;
  const size_t count = estimator.size();
  if (count < E::kSampleSize) return std::nullopt;
  std::mt19937_64 random(options.seed);
  std::array<size_t, E::kSampleSize> sample;
  std::vector<typename E::Model> models;
  std::optional<typename E::Model> best;
  RansacScore best_score;
  const int limit = std::max(options.min_iterations,
                             RequiredIterations(options.min_inlier_ratio, E::kSampleSize,
                                                options.confidence, options.max_iterations));
  int needed = limit;
  int iteration = 0;
  for (; iteration < needed; ++iteration) {
    DrawSample(random, count, sample);
    models.clear();
    estimator.Solve(sample, models);
    bool improved = false;
    for (const typename E::Model& model : models) {
      const RansacScore score = estimator.Score(model, best_score.cost);
      if (!(score.cost < best_score.cost)) continue;
      best = model;
      best_score = score;
      improved = true;
    }
    if (!improved) continue;
    for (int step = 0; step < kMaxLocalSteps; ++step) {
      const typename E::Model refined = estimator.Refine(*best);
      const RansacScore score = estimator.Score(refined, best_score.cost);
      if (!(score.cost < best_score.cost)) break;
      best = refined;
      best_score = score;
    }
    const double inlier_ratio =
        static_cast<double>(best_score.inliers) / static_cast<double>(count);
    needed = std::clamp(RequiredIterations(inlier_ratio, E::kSampleSize, options.confidence, limit),
                        std::min(options.min_iterations, limit), limit);
  }
  if (!best) return std::nullopt;
  return RansacResult<typename E::Model>{*best, best_score, iteration};
}

}  // namespace rotunda::sfm
