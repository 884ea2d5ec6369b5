#pragma once

#include <optional>
#include <string>
#include <vector>

#include "sfm/alternative_poses.h"
#include "sfm/calibration_prior.h"
#include "sfm/consistent_view_graph.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"
#include "sfm/covisibility.h"
#include "sfm/features.h"
#include "sfm/incremental.h"
#include "sfm/intrinsics.h"
#include "sfm/model_merging.h"
#include "sfm/reconstruction.h"
#include "sfm/two_view.h"
#include "sfm/view_graph.h"

namespace rotunda::sfm {

/// What look-alike structure is told apart by; each can be left out to see what it is worth.
struct TcSfmOptions {
  bool consistent_view_graph = true;  // edges that contradict the rotations of the others go first
  bool unfolding = true;              // groups of images that do not meet what they should
  CalibrationPriorOptions prior;
  /// What the draft was not built on but its poses agree with makes the final tracks, too.
  bool matches_brought_back = true;
  bool single_image_doubt = true;  // an image that may be on the look-alike side makes it unsure
  ConsistencyOptions consistency;
  CovisibilityOptions covisibility;
  MergeOptions merging;
  int max_unfoldings = 8;  // one simulated body in plaid takes six
  /// Log-likelihood that a split into groups must gain; by chance it stays below a few units.
  double min_gain = 20.0;
  /// Log-likelihood against everything that looks alike, below which the verdict is "unsure".
  double min_evidence = 50.0;
  /// Widest gap, around the subject, between cameras that are known to stand all around it. A whole
  /// fold leaves about half of the ring empty; four neighbouring columns of 15 lost leave 120 deg.
  /// nullopt: the cameras may stand anywhere.
  std::optional<double> max_gap_deg = 130.0;
  Status Validate() const;
};

struct TcSfmInput {
  const Features& features;
  const Intrinsics& intrinsics;
  const TwoViews& two_views;
  const ViewGraph& view_graph;
  CalibratedPoses calibrated = {};  // a prior, when asked for
};

enum class Verdict {
  kSure,    // nothing contradicts the poses, and what looks alike was told apart by evidence
  kUnsure,  // what looks alike is not told apart, images are doubtful, or the model is in pieces
  kFolded,  // the poses lay different things over each other
};
const char* VerdictName(Verdict verdict);  // "sure", "unsure", "folded"

struct TcSfmResult {
  IncrementalResult models;  // most images first
  /// What the last model was made of: matches that agree with its poses, and their edges.
  TwoViews two_views;
  ViewGraph view_graph;
  std::vector<EdgeVerdict> verdicts;  // parallel to the edges of TcSfmInput::view_graph
  Verdict verdict = Verdict::kUnsure;
  std::string reason;   // of the verdict
  double evidence = 0;  // Alternatives::evidence_against; infinite without alternatives
  /// ConsistentViewGraph::Margin of all edges, before any was refuted; nullopt also without that
  /// graph and with a prior.
  std::optional<double> view_graph_margin;
  std::vector<double> certainty;  // by ImageId: of its group; infinite where no draft was folded
  std::vector<AlternativePose> alternatives;  // of the finished model, sorted by image
  std::vector<ImageId> late;  // not in the draft that became the model: placed against its poses
  /// Images that may be on the wrong side: their heaviest edge of all contradicts their pose and
  /// AlternativePose::evidence_against does not decide for it, or evidence_for decides for the
  /// alternative.
  std::vector<ImageId> doubtful;
  /// Calibrated, but the pictures contradict it: TcSfmInput::calibrated was no prior for them.
  std::vector<ImageId> not_as_calibrated;
  std::vector<std::string> notes;
};

/// TC-SfM for captures in which front and back look the same (Wang et al.): consistent view graph,
/// draft, test of the draft by what its images fail to meet, and the drafts again without the edges
/// that the test refutes; then merging, everything that agrees with the poses brought back, and the
/// last adjustment.
Result<TcSfmResult> RunTcSfm(const TcSfmInput& input, const TcSfmOptions& options,
                             const IncrementalOptions& incremental, RunContext& context);

}  // namespace rotunda::sfm
