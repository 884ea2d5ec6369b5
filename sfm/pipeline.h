#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "sfm/core/calibration.h"
#include "sfm/core/frame_set.h"
#include "sfm/core/pose_set.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"
#include "sfm/features.h"
#include "sfm/incremental.h"
#include "sfm/literal_tc_sfm.h"
#include "sfm/matching.h"
#include "sfm/reconstruction.h"
#include "sfm/run_choices.h"
#include "sfm/segments.h"
#include "sfm/tc_sfm.h"
#include "sfm/two_view.h"

namespace rotunda::sfm {

/// Products that can be written to disk and started from, in the order of the data.
enum class Stage { kFeatures, kMatches, kTwoViews, kTracks };
Result<Stage> StageFromName(std::string_view name);  // "features", "matches", "two-views", "tracks"

struct PipelineOptions {
  Method method = Method::kTcSfm;
  PairSelection pairs = PairSelection::kExhaustive;
  /// The calibrated poses, not only the lenses, help to tell look-alike sides apart (tc-sfm). The
  /// result is then no independent evidence that the rig is still where its calibration says.
  bool calibration_prior = false;
  /// Camera in the middle of the front, by which the others have their sides where no calibration
  /// gives a rig frame; empty: they have none.
  std::string front_camera;
  std::optional<bool> refine_intrinsics;  // unset: refined when they do not come from a calibration
  FeatureOptions features;
  MatchOptions matching;
  TwoViewOptions two_view;
  IncrementalOptions incremental;
  TcSfmOptions tc_sfm;
  LiteralOptions literal;
  SuperpixelOptions superpixels;
  TrackGraphOptions track_graph;
  CommunityOptions communities;
  SegmentOptions segments;
  /// By what the options above were set, to be told with the result (sfm/presets.h).
  std::string preset = "rig";
  std::map<std::string, std::string> settings;
  /// COLMAP database.db whose keypoints and matches are used in place of our own front end.
  std::optional<std::filesystem::path> database;
  /// Where features, matches, two-view geometries and tracks are written, for inspection and for
  /// `start_from`.
  std::optional<std::filesystem::path> stages_folder;
  /// Products up to and including this one are read from `stages_folder` instead of being made.
  std::optional<Stage> start_from;
  /// Of all stages that the method has, and whether the fields go together.
  Status Validate() const;
};

struct PipelineResult {
  FrameSet set;  // with the sizes of the pictures
  Features features;
  Reconstruction reconstruction;  // the largest model; in the rig frame when `poses.metric`
  PoseSet poses;
  std::optional<Segments> segments;  // of the methods that have communities
  std::vector<std::string> notes;    // what could not be done although the poses stand
};

/// Pictures in, camera poses out. `calibration` gives intrinsics, metric scale and the rig frame.
Result<PipelineResult> RunPipeline(const FrameSet& set,
                                   const std::optional<Calibration>& calibration,
                                   const PipelineOptions& options, RunContext& context);

/// The calibration a result is compared with.
struct CalibrationInForce {
  std::optional<Calibration> calibration;
  std::string page;  // HTML of its own report, to be shown in ours; empty: none
};

/// Writes poses.json, sparse/0 (COLMAP binary model), points.ply and report.html into `folder`,
/// which must exist.
Status WriteResult(const PipelineResult& result, const CalibrationInForce& in_force,
                   const std::filesystem::path& folder, RunContext& context);

}  // namespace rotunda::sfm
