#include "sfm/agreeing_matches.h"

#include <cmath>
#include <optional>

#include "sfm/epipolar.h"

namespace rotunda::sfm {
namespace {

std::optional<Eigen::Vector2d> Ray(const Reconstruction& model, const Features& features,
                                   ImageId image, KeypointId keypoint) {
  const Keypoint& k = features.image(image).keypoints[keypoint.index()];
  return model.intrinsics.of(image).NormalizedFromPixel({k.x_px, k.y_px});
}

/// The view with the model's pose and the matches that agree with it.
TwoView Agreeing(const Reconstruction& model, const Features& features, const TwoView& view,
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
  std::erase_if(agreeing.inliers, [&](const Match& match) {
    const auto first = Ray(model, features, view.pair.first, match.first);
    const auto second = Ray(model, features, view.pair.second, match.second);
    if (!first || !second) return true;
    const Correspondence c = {*first, *second};
    return SquaredSampson(essential, c) > max_error * max_error ||
           !InFront(agreeing.second_from_first, c, max_error);
  });
  return agreeing;
}

}  // namespace

TwoViews AgreeingMatches(const Reconstruction& model, const Features& features,
                         const TwoViews& two_views, const AgreeingMatchesOptions& options) {
  TwoViews agreeing;
  for (const TwoView& view : two_views.pairs) {
    if (view.kind == TwoViewKind::kPanoramic) continue;
    if (!model.Registered(view.pair.first) || !model.Registered(view.pair.second)) continue;
    TwoView kept = Agreeing(model, features, view, options.max_error_px);
    const auto matches = static_cast<double>(kept.inliers.size());
    if (kept.inliers.size() < options.min_matches ||
        matches < options.min_share * static_cast<double>(view.inliers.size())) {
      continue;
    }
    agreeing.pairs.push_back(std::move(kept));
  }
  return agreeing;
}

}  // namespace rotunda::sfm
