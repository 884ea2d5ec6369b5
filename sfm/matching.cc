#include "sfm/matching.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <string>

#include "sfm/matching_kernel.h"

namespace rotunda::sfm {
namespace {

/// Inner product of a descriptor with itself, but for rounding (0.1 %, which changes small angles
/// alone; COLMAP takes the same constant).
constexpr double kDescriptorNorm = 512.0;

double Angle_rad(uint32_t dot) {
  return std::acos(std::min(1.0, dot / (kDescriptorNorm * kDescriptorNorm)));
}

bool IsDistinct(const NearestTwo& nearest, const MatchOptions& options) {
  if (nearest.best == NearestTwo::kNone) return false;
  const double best_rad = Angle_rad(nearest.best_dot);
  return best_rad <= options.max_distance_rad &&
         best_rad < options.max_ratio * Angle_rad(nearest.second_dot);
}

std::vector<Match> MatchPair(const ImageFeatures& first, const ImageFeatures& second,
                             const MatchOptions& options) {
  const NearestInPair nearest =
      FindNearest(MatchKernels().front(), {first.descriptors.data(), first.keypoints.size()},
                  {second.descriptors.data(), second.keypoints.size()});
  std::vector<Match> matches;
  for (size_t i = 0; i < nearest.of_first.size(); ++i) {
    const NearestTwo& forward = nearest.of_first[i];
    if (!IsDistinct(forward, options)) continue;
    const NearestTwo& backward = nearest.of_second[forward.best];
    if (backward.best != i || !IsDistinct(backward, options)) continue;
    matches.push_back({KeypointId(i), KeypointId(forward.best)});
  }
  return matches;
}

Status CheckInput(const Features& features, const std::vector<ImagePair>& pairs) {
  const auto bad = [](const std::string& what) {
    return Error{ErrorCode::kInvalidArgument, what, "matching"};
  };
  for (size_t i = 0; i < features.images.size(); ++i) {
    const ImageFeatures& image = features.images[i];
    if (image.descriptors.size() != image.keypoints.size() * kDescriptorSize) {
      return bad("picture " + std::to_string(i) + " has " +
                 std::to_string(image.descriptors.size()) + " descriptor bytes, expected " +
                 std::to_string(image.keypoints.size() * kDescriptorSize));
    }
  }
  for (const ImagePair& pair : pairs) {
    if (!(pair.first < pair.second) || pair.second.index() >= features.images.size()) {
      return bad("pair (" + std::to_string(pair.first.index()) + ", " +
                 std::to_string(pair.second.index()) + "), expected first < second < " +
                 std::to_string(features.images.size()));
    }
  }
  return {};
}

}  // namespace

Status MatchOptions::Validate() const {
  const auto bad = [](const std::string& what) {
    return Error{ErrorCode::kInvalidArgument, what, "matching"};
  };
  if (!(max_ratio > 0 && max_ratio <= 1)) {
    return bad("max_ratio is " + std::to_string(max_ratio) + ", expected more than 0, at most 1");
  }
  if (!(max_distance_rad > 0)) {
    return bad("max_distance_rad is " + std::to_string(max_distance_rad) +
               ", expected more than 0");
  }
  return {};
}

Result<Matches> BuildMatches(const Features& features, const std::vector<ImagePair>& pairs,
                             const MatchOptions& options, RunContext& context) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  ROTUNDA_RETURN_IF_ERROR(CheckInput(features, pairs));
  std::vector<ImagePair> sorted = pairs;
  std::sort(sorted.begin(), sorted.end());
  sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());

  Matches matches;
  matches.pairs.resize(sorted.size());
  std::atomic<size_t> done{0};
  context.threads.ParallelFor(
      sorted.size(),
      [&](size_t i) {
        const ImagePair& pair = sorted[i];
        matches.pairs[i] = {
            pair, MatchPair(features.image(pair.first), features.image(pair.second), options)};
        context.Report("matching", ++done, sorted.size());
      },
      context.stop);
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "stopped", "matching"};
  std::erase_if(matches.pairs, [&](const PairMatches& pair) {
    return pair.matches.empty() || pair.matches.size() < options.min_matches;
  });
  return matches;
}

const char* MatchKernelName() { return MatchKernels().front().name; }

}  // namespace rotunda::sfm
