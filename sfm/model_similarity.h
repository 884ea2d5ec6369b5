#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "sfm/core/result.h"
#include "sfm/core/rigid3.h"
#include "sfm/model_links.h"

namespace rotunda::sfm {

struct SimilarityOptions {
  double max_rotation_rad =
      0.15;  // between a link's rotation and the similarity's; the paper's e_r
  double max_direction_rad = 0.35;  // between baselines; of a common camera: centre error / depth
  /// Agreeing links needed; a common camera counts twice, for it has no open scale.
  size_t min_support = 3;
  /// Weight of the agreeing links over that of the heaviest group of links that contradict them:
  /// parts that look alike make such groups.
  double min_rival_ratio = 2.0;
  double max_scale_sigma = 0.1;  // predicted standard deviation of log(scale)
  Status Validate() const;
};

/// What speaks for and against a similarity.
struct SimilarityEvidence {
  size_t common_cameras = 0, agreeing_cameras = 0;
  size_t cross_pairs = 0, agreeing_pairs = 0;
  double support_weight = 0;  // of the agreeing links
  double rival_weight = 0;    // of the heaviest group of links against them
  double scale_sigma = 0;     // of log(scale), from the agreement of the links; infinite: open
};

struct SimilarityVerdict {
  std::optional<Sim3> target_from_source;  // nullopt: refused
  std::string refusal;                     // why; empty when it stands
  std::vector<bool> agrees;                // by link
  SimilarityEvidence evidence;
};

/// Similarity between two models from their links (TC-SfM III-D, eq. 2-4), in closed form and
/// robust: the rotation by the heaviest group of like votes and L1 averaging on SO(3); scale and
/// translation by consensus over links with points in both models (eq. 3: each has a scale of its
/// own) and over pairs of links (eq. 4: two common cameras, one and a pair, or two pairs that share
/// no picture and whose baselines are not parallel), then L1 by reweighted least squares. Refused
/// when too little supports it, when a rival does as well, or when the links leave the scale open.
SimilarityVerdict EstimateSimilarity(const std::vector<ModelLink>& links,
                                     const Reconstruction& source, const Reconstruction& target,
                                     const SimilarityOptions& options, uint64_t seed);

/// The same judgement of a given similarity.
SimilarityVerdict JudgeSimilarity(const std::vector<ModelLink>& links, const Reconstruction& source,
                                  const Reconstruction& target, const Sim3& target_from_source,
                                  const SimilarityOptions& options);

}  // namespace rotunda::sfm
