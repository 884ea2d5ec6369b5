#pragma once

#include <stop_token>
#include <vector>

#include "sfm/core/rigid3.h"
#include "sfm/model_links.h"

namespace rotunda::sfm {

/// Two models, the links that count, and where they say the one lies in the other.
struct ConsistencyInput {
  const Features& features;
  const Reconstruction& source;
  const Reconstruction& target;
  const std::vector<ModelLink>& links;
};

struct ConsistencyOptions {
  /// Weight of the true reprojection error beside the paper's cost.
  double reprojection_weight = 1.0;
  bool optimise = true;  // false: only the cost of the given similarity
};

struct Consistency {
  Sim3 target_from_source;
  double cost_px2 = 0;       // sum over the residuals of weight * Huber of the squared distance
  double mean_cost_px2 = 0;  // cost / sum of the weights; infinite: no residual at all
};

/// Bidirectional consistency (TC-SfM III-D, eq. 5-8): a point of the one model that a link shows in
/// a picture of the other goes there through the similarity and through the link's relative pose;
/// the pixel distance of the two is the residual, both ways, weighted by the link. Moves rotation,
/// translation, log(scale) and the lambdas of the links; relative poses stay. When the rotations
/// agree that distance does not depend on the point, so the cost says nothing of 3D-3D agreement:
/// the pixel distance to the matched keypoint is added with its own weight. The paper asks for
/// points that both models have; a keypoint needs one only of the model it comes from. Huber loss;
/// Ceres on one thread: the same bytes every time. Once `stop` is set: the similarity as given.
Consistency MinimiseInconsistency(const ConsistencyInput& input, const Sim3& target_from_source,
                                  const ConsistencyOptions& options, std::stop_token stop = {});

}  // namespace rotunda::sfm
