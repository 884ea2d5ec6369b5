#pragma once

#include <string>
#include <vector>

#include "sfm/core/result.h"
#include "sfm/core/run_context.h"
#include "sfm/model_links.h"
#include "sfm/model_similarity.h"
#include "sfm/reconstruction.h"

namespace rotunda::sfm {

struct MergeOptions {
  /// Optimise the bidirectional consistency cost (TC-SfM III-D) after the closed-form similarity.
  bool bidirectional = true;
  /// Weight of the true reprojection of points seen from the other model; 0: the paper's cost.
  double reprojection_weight = 1.0;
  /// Mean cost per residual weighs an edge of the graph of models; false: the sum (the paper).
  bool mean_cost = true;
  double max_duplicate_px = 4.0;  // points of one track closer than this are fused
  SimilarityOptions similarity;   // what a merge must be supported by
  Status Validate() const;
};

struct MergeResult {
  std::vector<Reconstruction> models;  // most images first, ties by most points
  /// Why models that are left were not joined: one for every two between which links exist.
  std::vector<std::string> refusals;
};

/// Models in, models out: what could be joined is one model (TC-SfM III-D): the graph of models,
/// its minimum spanning tree, from the leaves inward, the model with fewer images into the other.
/// A merge is estimated anew once one of its models has grown, and tried again when a whole round
/// is through, so that all evidence counts. An image has one pose and a keypoint one point
/// (FuseModels). No bundle adjustment: the poses are as good as the models' and the similarity's.
/// kInvalidArgument: a model is of another set of pictures.
Result<MergeResult> MergeModels(const MergeInput& input, std::vector<Reconstruction> models,
                                const MergeOptions& options, RunContext& context);

}  // namespace rotunda::sfm
