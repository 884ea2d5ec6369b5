#include "sfm/alternative_poses.h"

#include <algorithm>
#include <cmath>

#include "sfm/absolute_pose.h"
#include "sfm/model_links.h"

namespace rotunda::sfm {
namespace {

constexpr uint32_t kMinExpected = 6;

/// A keypoint and a point of the model that a contradicting match ties it to.
struct Tie {
  KeypointId keypoint;
  size_t point;
  auto operator<=>(const Tie&) const = default;
};

std::vector<std::vector<Tie>> ContradictingTies(const Reconstruction& model,
                                                const Features& features, const TwoViews& two_views,
                                                const TwoViews& agreeing) {
  const PointIndex points(features, model);
  std::vector<std::vector<Tie>> ties(features.images.size());
  auto kept = agreeing.pairs.begin();
  for (const TwoView& view : two_views.pairs) {
    while (kept != agreeing.pairs.end() && kept->pair < view.pair) ++kept;
    if (kept != agreeing.pairs.end() && kept->pair == view.pair) continue;
    if (view.kind == TwoViewKind::kPanoramic) continue;
    if (!model.Registered(view.pair.first) || !model.Registered(view.pair.second)) continue;
    for (const Match& match : view.inliers) {
      const auto of_first = points.Find(view.pair.first, match.first);
      const auto of_second = points.Find(view.pair.second, match.second);
      if (of_second) ties[view.pair.first.index()].push_back({match.first, *of_second});
      if (of_first) ties[view.pair.second.index()].push_back({match.second, *of_first});
    }
  }
  for (std::vector<Tie>& of_image : ties) {
    std::sort(of_image.begin(), of_image.end());
    of_image.erase(std::unique(of_image.begin(), of_image.end()), of_image.end());
  }
  return ties;
}

std::optional<AlternativePose> FindPose(const Reconstruction& model, const Features& features,
                                        ImageId image, const std::vector<Tie>& ties,
                                        const AlternativeOptions& options, uint64_t seed) {
  const CameraIntrinsics& lens = model.intrinsics.of(image);
  AbsolutePoseInput input;
  input.focal_px = lens.MeanFocal_px();
  for (const Tie& tie : ties) {
    const Keypoint& k = features.image(image).keypoints[tie.keypoint.index()];
    const auto ray = lens.NormalizedFromPixel({k.x_px, k.y_px});
    if (!ray) continue;
    input.normalized.push_back(*ray);
    input.points.push_back(model.points[tie.point].position);
  }
  if (input.points.size() < options.min_inliers) return std::nullopt;
  AbsolutePoseOptions pose_options;
  pose_options.max_error_px = options.max_error_px;
  pose_options.seed = DeriveSeed(seed, image.index());
  const Result<AbsolutePose> pose = EstimateAbsolutePose(input, pose_options);
  if (!pose.ok() || pose->inliers.size() < options.min_inliers) return std::nullopt;
  const Eigen::Quaterniond& own = model.cam_from_model[image.index()]->rotation;
  const double rotation_rad = RotationAngle_rad(pose->cam_from_model.rotation, own);
  if (rotation_rad < options.min_rotation_rad) return std::nullopt;
  return AlternativePose{image, pose->cam_from_model, rotation_rad};
}

using RegionCounts = std::vector<MeetingCount>;

/// Region by region, over all images; empty without images.
RegionCounts SumOver(const std::vector<RegionCounts>& images) {
  RegionCounts total;
  for (const RegionCounts& of_image : images) {
    total.resize(std::max(total.size(), of_image.size()));
    for (size_t r = 0; r < of_image.size(); ++r) {
      total[r].expected += of_image[r].expected;
      total[r].met += of_image[r].met;
    }
  }
  return total;
}

/// Of regions that images at their own poses meet but the alternatives miss: one that is hardly met
/// from anywhere tells nothing.
double EvidenceAgainst(const RegionCounts& at_alternatives, const RegionCounts& at_own) {
  double evidence = 0;
  for (size_t r = 0; r < at_alternatives.size(); ++r) {
    const MeetingCount& count = at_alternatives[r];
    if (std::min(count.expected, at_own[r].expected) < kMinExpected) continue;
    const double own = std::min(kMetShare, static_cast<double>(at_own[r].met) / at_own[r].expected);
    const double rate = std::max(0.005, static_cast<double>(count.met) / count.expected);
    if (rate > kMissedRatio * own) continue;
    evidence += count.met * std::log(rate / own) +
                (count.expected - count.met) * std::log((1 - rate) / (1 - own));
  }
  return evidence;
}

/// Log-likelihoods, of one image at one pose, of seeing nothing rather than what it should see.
struct Seen {
  double missed = 0;  // of the regions that it rather misses, <= 0
  double all = 0;     // of all regions: what is met counts, too
};

Seen WhatIsSeen(const RegionCounts& regions, uint32_t MeetingCount::*met) {
  Seen seen;
  for (const MeetingCount& count : regions) {
    const double region =
        count.*met * std::log(kMetShare / kMetByChance) +
        (count.expected - count.*met) * std::log((1 - kMetShare) / (1 - kMetByChance));
    seen.missed += std::min(0.0, region);
    seen.all += region;
  }
  return seen;
}

/// Misses alone compare the two: what looks alike is met at both, and how much of it there is to be
/// met differs from place to place.
void Weigh(const RegionCounts& at_own, const RegionCounts& at_alternative, AlternativePose& pose) {
  pose.evidence_against = WhatIsSeen(at_own, &MeetingCount::met).missed -
                          WhatIsSeen(at_alternative, &MeetingCount::met).missed;
  const Seen own = WhatIsSeen(at_own, &MeetingCount::in_place);
  const Seen there = WhatIsSeen(at_alternative, &MeetingCount::in_place);
  pose.evidence_for = std::min(there.missed - own.missed, there.all);
}

}  // namespace

Alternatives FindAlternatives(const Reconstruction& model, const Features& features,
                              const TwoViews& two_views, const TwoViews& agreeing,
                              const CovisibilityOptions& covisibility,
                              const AlternativeOptions& options, RunContext& context) {
  const std::vector<std::vector<Tie>> ties =
      ContradictingTies(model, features, two_views, agreeing);
  std::vector<std::optional<AlternativePose>> poses(ties.size());
  context.threads.ParallelFor(
      ties.size(),
      [&](size_t i) {
        if (ties[i].size() < options.min_inliers) return;
        poses[i] = FindPose(model, features, ImageId(i), ties[i], options, context.seed);
      },
      context.stop);
  Alternatives alternatives;
  for (const auto& pose : poses) {
    if (pose) alternatives.poses.push_back(*pose);
  }
  if (alternatives.poses.empty()) return alternatives;
  const ViewGraph everything = BuildViewGraph(features, two_views);
  const CovisibilityCounter counter(model, features, two_views, everything, covisibility);
  std::vector<RegionCounts> at_own(ties.size()), at_alternatives(alternatives.poses.size());
  context.threads.ParallelFor(
      at_own.size(),
      [&](size_t i) {
        if (!model.Registered(ImageId(i))) return;
        at_own[i] = counter.CountAt(ImageId(i), *model.cam_from_model[i], options.max_error_px);
      },
      context.stop);
  context.threads.ParallelFor(
      at_alternatives.size(),
      [&](size_t a) {
        AlternativePose& pose = alternatives.poses[a];
        at_alternatives[a] = counter.CountAt(pose.image, pose.cam_from_model, options.max_error_px);
        Weigh(at_own[pose.image.index()], at_alternatives[a], pose);
      },
      context.stop);
  alternatives.evidence_against = EvidenceAgainst(SumOver(at_alternatives), SumOver(at_own));
  return alternatives;
}

}  // namespace rotunda::sfm
