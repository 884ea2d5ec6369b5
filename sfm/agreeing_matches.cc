#include "sfm/agreeing_matches.h"

#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "sfm/epipolar.h"

namespace rotunda::sfm {
namespace {

/// Views whose poses the model has.
std::vector<const TwoView*> ViewsOf(const Reconstruction& model, const TwoViews& two_views) {
  std::vector<const TwoView*> views;
  for (const TwoView& view : two_views.pairs) {
    if (view.kind == TwoViewKind::kPanoramic) continue;
    if (!model.Registered(view.pair.first) || !model.Registered(view.pair.second)) continue;
    views.push_back(&view);
  }
  return views;
}

/// Normalised coordinates, by KeypointId; nullopt: in no match, or beyond the lens model.
using Rays = std::vector<std::optional<Eigen::Vector2d>>;

/// By ImageId. A keypoint is in many matches, and to undistort it is most of the work.
std::vector<Rays> RaysOfMatches(const Reconstruction& model, const Features& features,
                                const std::vector<const TwoView*>& views, RunContext& context) {
  std::vector<std::vector<bool>> matched;
  for (const ImageFeatures& image : features.images) matched.emplace_back(image.keypoints.size());
  for (const TwoView* view : views) {
    for (const Match& match : view->inliers) {
      matched[view->pair.first.index()][match.first.index()] = true;
      matched[view->pair.second.index()][match.second.index()] = true;
    }
  }
  std::vector<Rays> rays(features.images.size());
  context.threads.ParallelFor(rays.size(), [&](size_t i) {
    const std::vector<Keypoint>& keypoints = features.images[i].keypoints;
    rays[i].resize(keypoints.size());
    for (size_t k = 0; k < keypoints.size(); ++k) {
      if (!matched[i][k]) continue;
      const Eigen::Vector2d pixel(keypoints[k].x_px, keypoints[k].y_px);
      rays[i][k] = model.intrinsics.of(ImageId(i)).NormalizedFromPixel(pixel);
    }
  });
  return rays;
}

/// The view with the model's pose and the matches that agree with it.
TwoView Agreeing(const Reconstruction& model, const std::vector<Rays>& rays, const TwoView& view,
                 double max_error_px) {
  TwoView agreeing = view;
  const Rigid3& first_from_model = *model.cam_from_model[view.pair.first.index()];
  const Rigid3& second_from_model = *model.cam_from_model[view.pair.second.index()];
  agreeing.second_from_first = second_from_model * first_from_model.Inverse();
  agreeing.second_from_first.translation.normalize();
  const double focal_px = std::sqrt(model.intrinsics.of(view.pair.first).MeanFocal_px() *
                                    model.intrinsics.of(view.pair.second).MeanFocal_px());
  const double max_error = max_error_px / focal_px;
  const Eigen::Matrix3d essential = EssentialFromPose(agreeing.second_from_first);
  const Rays& of_first = rays[view.pair.first.index()];
  const Rays& of_second = rays[view.pair.second.index()];
  std::erase_if(agreeing.inliers, [&](const Match& match) {
    const auto& first = of_first[match.first.index()];
    const auto& second = of_second[match.second.index()];
    if (!first || !second) return true;
    const Correspondence c = {*first, *second};
    return SquaredSampson(essential, c) > max_error * max_error ||
           !InFront(agreeing.second_from_first, c, max_error);
  });
  return agreeing;
}

}  // namespace

TwoViews AgreeingMatches(const Reconstruction& model, const Features& features,
                         const TwoViews& two_views, const AgreeingMatchesOptions& options,
                         RunContext& context) {
  const std::vector<const TwoView*> views = ViewsOf(model, two_views);
  const std::vector<Rays> rays = RaysOfMatches(model, features, views, context);
  std::vector<TwoView> judged(views.size());
  context.threads.ParallelFor(views.size(), [&](size_t v) {
    judged[v] = Agreeing(model, rays, *views[v], options.max_error_px);
  });
  TwoViews agreeing;
  for (size_t v = 0; v < views.size(); ++v) {
    const size_t kept = judged[v].inliers.size();
    const double least = options.min_share * static_cast<double>(views[v]->inliers.size());
    if (kept < options.min_matches || static_cast<double>(kept) < least) continue;
    agreeing.pairs.push_back(std::move(judged[v]));
  }
  return agreeing;
}

}  // namespace rotunda::sfm
