#pragma once

#include <optional>
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

/// Two models that links tie, and what came of it. Models are named by the places of the input
/// models they consist of, sorted.
struct MergeAttempt {
  std::vector<size_t> source, target;
  std::string refusal;  // empty: the source went into the target
  SimilarityEvidence evidence;
  /// Of the bidirectional consistency; 0 when refused, infinite when no point is seen across.
  double mean_cost_px2 = 0;
};

struct MergeResult {
  std::vector<Reconstruction> models;        // most images first, ties by most points
  std::vector<std::vector<size_t>> sources;  // by model: places of the input models in it, sorted
  std::vector<MergeAttempt> merges;          // in order
  std::vector<MergeAttempt> refusals;        // between the models that are left, where links exist
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
