#include "sfm/tc_sfm.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "sfm/agreeing_matches.h"
#include "sfm/camera_ring.h"
#include "sfm/core/html_text.h"
#include "sfm/tracks.h"
#include "sfm/unfolding.h"

namespace rotunda::sfm {
namespace {

constexpr char kStage[] = "disambiguation";
/// Log-likelihood that decides between two poses of one image: 20 to 1.
constexpr double kDecidedForImage = 3.0;
/// Of the largest gain so far: a draft whose split gains less is right but for a few images, which
/// the last adjustment may put right; taken apart it would lose pairs that are.
constexpr double kNearlyUnfolded = 0.05;

/// What is known of the edges while drafts come and go.
struct State {
  const TcSfmInput& input;
  const TcSfmOptions& options;
  RunContext& context;
  std::vector<bool> refuted;  // parallel to the edges: by the groups of a draft or the prior
  std::vector<bool> placed;   // by ImageId: its side is known from the calibration
  int unfoldings = 0;         // how often a draft or a finished model was found to be folded
  double largest_gain = 0;    // DraftGroups::gain of those
  TcSfmResult result = {};
};

ViewGraph NotRefuted(const State& state) {
  ViewGraph graph{state.input.view_graph.images, {}};
  for (size_t e = 0; e < state.refuted.size(); ++e) {
    if (!state.refuted[e]) graph.edges.push_back(state.input.view_graph.edges[e]);
  }
  return graph;
}

/// The edges a draft is built on.
Result<ViewGraph> EdgesForDraft(State& state) {
  const ViewGraph left = NotRefuted(state);
  if (!state.options.consistent_view_graph) return left;
  ROTUNDA_ASSIGN_OR_RETURN(
      const ConsistentViewGraph consistent,
      BuildConsistentViewGraph(left, state.input.two_views, state.options.consistency));
  if (state.unfoldings == 0 && state.input.calibrated.empty()) {
    state.result.view_graph_margin = consistent.Margin();
  }
  return EdgesThatAgree(left, consistent);
}

/// Group of every image over all models of a draft: no two models share a group.
struct DraftGroups {
  std::vector<int> model_of_image;  // kNoGroup: in none
  std::vector<int> group_of_image;
  std::vector<double> certainty;  // LookAlikeGroups::certainty, infinite where nothing is split
  double gain = 0;
};

ViewGraph EdgesWithin(const Reconstruction& model, const ViewGraph& graph) {
  ViewGraph within{graph.images, {}};
  for (const ViewGraphEdge& edge : graph.edges) {
    if (model.Registered(edge.pair.first) && model.Registered(edge.pair.second)) {
      within.edges.push_back(edge);
    }
  }
  return within;
}

Result<DraftGroups> GroupsOfDraft(const State& state, const std::vector<Reconstruction>& models,
                                  const TwoViews& two_views, const ViewGraph& graph) {
  const size_t images = state.input.features.images.size();
  DraftGroups groups{std::vector<int>(images, kNoGroup), std::vector<int>(images, kNoGroup),
                     std::vector<double>(images, std::numeric_limits<double>::infinity()), 0};
  for (size_t m = 0; m < models.size(); ++m) {
    const CovisibilityCounter counter(models[m], state.input.features, two_views, graph,
                                      state.options.covisibility);
    const Covisibility covisibility = counter.CountAll(state.context);
    if (state.context.Stopped()) return Error{ErrorCode::kCancelled, "cancelled", kStage};
    const LookAlikeGroups found = FindLookAlikeGroups(covisibility, EdgesWithin(models[m], graph));
    const bool split = found.gain >= state.options.min_gain;
    for (size_t i = 0; i < images; ++i) {
      if (!models[m].Registered(ImageId(i))) continue;
      groups.model_of_image[i] = static_cast<int>(m);
      groups.group_of_image[i] = split ? found.of_image[i] : 0;
      if (split) groups.certainty[i] = found.certainty[i];
    }
    if (split) groups.gain = std::max(groups.gain, found.gain);
  }
  return groups;
}

bool HasPair(const TwoViews& two_views, const ImagePair& pair) {
  const auto found =
      std::lower_bound(two_views.pairs.begin(), two_views.pairs.end(), pair,
                       [](const TwoView& a, const ImagePair& b) { return a.pair < b; });
  return found != two_views.pairs.end() && found->pair == pair;
}

/// Two images of one model: an edge whose matches agree with the model's poses is refuted across
/// groups (it joins what looks alike), one whose matches do not is refuted within a group.
void Refute(State& state, const std::vector<Reconstruction>& models, const DraftGroups& groups) {
  const std::vector<ViewGraphEdge>& edges = state.input.view_graph.edges;
  for (size_t m = 0; m < models.size(); ++m) {
    const TwoViews agreeing =
        AgreeingMatches(models[m], state.input.features, state.input.two_views, {}, state.context);
    for (size_t e = 0; e < edges.size(); ++e) {
      const size_t i = edges[e].pair.first.index(), j = edges[e].pair.second.index();
      if (groups.model_of_image[i] != static_cast<int>(m)) continue;
      if (groups.model_of_image[j] != static_cast<int>(m)) continue;
      const bool together = groups.group_of_image[i] == groups.group_of_image[j];
      if (HasPair(agreeing, edges[e].pair) != together) state.refuted[e] = true;
    }
  }
}

/// Takes a folded draft apart: its groups are kept in mind and the edges that they refute dropped.
void TakeApart(State& state, const std::vector<Reconstruction>& models, const DraftGroups& groups) {
  std::vector<double>& certainty = state.result.certainty;
  ++state.unfoldings;
  state.largest_gain = std::max(state.largest_gain, groups.gain);
  for (size_t i = 0; i < groups.certainty.size(); ++i) {
    certainty[i] = std::min(certainty[i], groups.certainty[i]);
  }
  Refute(state, models, groups);
}

bool MayTakeApart(const State& state) {
  return state.options.unfolding && state.unfoldings < state.options.max_unfoldings;
}

struct Draft {
  std::vector<Reconstruction> models;
  ViewGraph graph;
};

/// Drafts until one is not folded, or as often as the options allow.
Result<Draft> BuildDraft(State& state, const IncrementalOptions& incremental) {
  IncrementalOptions options = incremental;
  options.draft = true;
  Draft last;
  for (int round = 0;; ++round) {
    Draft draft;
    ROTUNDA_ASSIGN_OR_RETURN(draft.graph, EdgesForDraft(state));
    const Tracks tracks = BuildTracks(state.input.features, state.input.two_views, draft.graph);
    const IncrementalInput input = {state.input.features, state.input.intrinsics,
                                    state.input.two_views, draft.graph, tracks};
    Result<IncrementalResult> built = BuildReconstructions(input, options, state.context);
    if (!built.ok() && round > 0 && built.error().code == ErrorCode::kFailed) {
      state.result.notes.push_back("too little is left without what looks alike: " +
                                   built.error().message);
      return last;
    }
    if (!built.ok()) return built.error();
    draft.models = std::move(built->models);
    if (!MayTakeApart(state)) return draft;
    state.context.Report(kStage, 0, 1);
    ROTUNDA_ASSIGN_OR_RETURN(
        const DraftGroups groups,
        GroupsOfDraft(state, draft.models, state.input.two_views, draft.graph));
    if (groups.gain <= kNearlyUnfolded * state.largest_gain) return draft;
    TakeApart(state, draft.models, groups);
    last = std::move(draft);
  }
}

/// What is left when drafts could not be joined to the first.
void NoteRefusals(const MergeResult& merged, TcSfmResult& result) {
  for (const std::string& refusal : merged.refusals) {
    result.notes.push_back("two pieces of the reconstruction were not joined: " + refusal);
  }
}

/// One model out of the drafts, if they can be joined; the others stay behind it.
Status Join(State& state, Draft& draft) {
  if (draft.models.size() < 2) return {};
  state.context.Report("merging", 0, 1);
  const MergeInput input = {state.input.features, state.input.two_views, draft.graph};
  ROTUNDA_ASSIGN_OR_RETURN(MergeResult merged, MergeModels(input, std::move(draft.models),
                                                           state.options.merging, state.context));
  NoteRefusals(merged, state.result);
  draft.models = std::move(merged.models);
  return {};
}

/// The matches of the pairs that may still place an image that is not in the first model, be it in
/// none or in a piece that could not be joined: of all edges that no group refuted, since the poses
/// of the model now judge them.
void AddOpenPairs(const State& state, const Reconstruction& model, TwoViews& two_views) {
  for (const ViewGraphEdge& edge : NotRefuted(state).edges) {
    if (model.Registered(edge.pair.first) && model.Registered(edge.pair.second)) continue;
    two_views.pairs.push_back(state.input.two_views.pairs[edge.two_view]);
  }
  std::sort(two_views.pairs.begin(), two_views.pairs.end(),
            [](const TwoView& x, const TwoView& y) { return x.pair < y.pair; });
}

TwoViews TwoViewsOf(const ViewGraph& graph, const TwoViews& all) {
  TwoViews chosen;
  for (const ViewGraphEdge& edge : graph.edges) chosen.pairs.push_back(all.pairs[edge.two_view]);
  return chosen;
}

/// The matches that agree with the first model.
TwoViews MatchesToComplete(const State& state, const Draft& draft) {
  const TcSfmInput& input = state.input;
  const TwoViews& all = input.two_views;
  return AgreeingMatches(draft.models.front(), input.features,
                         state.options.matches_brought_back ? all : TwoViewsOf(draft.graph, all),
                         {}, state.context);
}

std::vector<ImageId> NewlyRegistered(const Reconstruction& model, const Reconstruction& before) {
  std::vector<ImageId> images;
  for (size_t i = 0; i < model.cam_from_model.size(); ++i) {
    if (model.Registered(ImageId(i)) && !before.Registered(ImageId(i))) images.emplace_back(i);
  }
  return images;
}

/// Brings back every match that agrees with the first model, places what is left over and adjusts
/// everything; the result's matches are then those that agree with the finished poses.
Status Complete(State& state, Draft& draft, const IncrementalOptions& options) {
  TcSfmResult& result = state.result;
  const Features& features = state.input.features;
  const Reconstruction& start = draft.models.front();
  TwoViews two_views = MatchesToComplete(state, draft);
  AddOpenPairs(state, start, two_views);
  const ViewGraph graph = BuildViewGraph(features, two_views);
  const Tracks tracks = BuildTracks(features, two_views, graph);
  const IncrementalInput input = {features, start.intrinsics, two_views, graph, tracks};
  ROTUNDA_ASSIGN_OR_RETURN(result.models,
                           ExtendReconstruction(input, start, options, state.context));
  result.late = NewlyRegistered(result.models.models.front(), start);
  result.two_views = AgreeingMatches(result.models.models.front(), features, state.input.two_views,
                                     {}, state.context);
  result.view_graph = BuildViewGraph(features, result.two_views);
  draft.models.erase(draft.models.begin());
  AppendModels(std::move(draft.models), options.min_model_images, result.models);
  return {};
}

/// Images of the first model that are more like one that contradicts their pose than like any that
/// agrees with it, unless what they fail to meet or the prior decides for their pose; and those of
/// which it decides for the alternative.
std::vector<ImageId> DoubtfulImages(const State& state, const Alternatives& alternatives) {
  const TcSfmInput& input = state.input;
  const Reconstruction& model = state.result.models.models.front();
  std::vector<double> agreeing(input.view_graph.images, 0.0), contradicting = agreeing;
  for (const ViewGraphEdge& edge : input.view_graph.edges) {
    if (input.two_views.pairs[edge.two_view].kind == TwoViewKind::kPanoramic) continue;
    if (!model.Registered(edge.pair.first) || !model.Registered(edge.pair.second)) continue;
    std::vector<double>& heaviest =
        HasPair(state.result.two_views, edge.pair) ? agreeing : contradicting;
    for (const ImageId image : {edge.pair.first, edge.pair.second}) {
      heaviest[image.index()] = std::max(heaviest[image.index()], edge.weight);
    }
  }
  for (const AlternativePose& pose : alternatives.poses) {
    double& doubt = contradicting[pose.image.index()];
    if (pose.evidence_against >= kDecidedForImage) doubt = 0;
    if (pose.evidence_for >= kDecidedForImage) doubt = std::numeric_limits<double>::infinity();
  }
  std::vector<ImageId> doubtful;
  for (size_t i = 0; i < agreeing.size(); ++i) {
    if (contradicting[i] > agreeing[i] && !state.placed[i]) doubtful.push_back(ImageId(i));
  }
  return doubtful;
}

/// The gap in a ring of cameras that should have none: a whole fold, whose sides show nothing that
/// could contradict it, looks like this.
std::optional<double> GapInRing_deg(const Reconstruction& model, const TcSfmOptions& options) {
  if (!options.max_gap_deg) return std::nullopt;
  const std::optional<CameraRing> ring = FindCameraRing(model);
  const double gap_deg = ring ? DegFromRad(ring->widest_gap_rad) : 360.0;
  return gap_deg > *options.max_gap_deg ? std::optional(gap_deg) : std::nullopt;
}

std::string GapReason(double gap_deg, const Reconstruction& model) {
  const size_t lost = model.cam_from_model.size() - RegisteredCount(model);
  return "no camera stands in " + std::to_string(std::lround(gap_deg)) +
         " of the 360 deg around the subject, as in a folded reconstruction" +
         (lost > 0
              ? ", and " + Counted(lost, "camera") + (lost == 1 ? " has" : " have") + " no pose"
              : "") +
         " (for cameras that do not surround it there is the preset internet)";
}

/// What tells look-alike parts of the subject apart.
enum class ToldApart { kNothing, kPictures, kCalibration };

ToldApart WhatTellsApart(const State& state, const Alternatives& alternatives) {
  if (state.result.evidence >= state.options.min_evidence) return ToldApart::kPictures;
  const bool placed =
      std::all_of(alternatives.poses.begin(), alternatives.poses.end(),
                  [&](const AlternativePose& pose) { return state.placed[pose.image.index()]; });
  return placed ? ToldApart::kCalibration : ToldApart::kNothing;
}

/// Why the verdict is not better, or what it rests on.
std::string ReasonFor(const TcSfmResult& result, double gain, ToldApart told_apart,
                      const std::optional<double>& gap_deg) {
  if (gain > 0) return "the poses lay different parts of the subject over each other";
  if (gap_deg) return GapReason(*gap_deg, result.models.models.front());
  if (told_apart == ToldApart::kNothing) {
    return "parts of the subject look alike and nothing tells them apart";
  }
  if (!result.doubtful.empty()) {
    return Counted(result.doubtful.size(), "camera") + " may be on the look-alike side";
  }
  if (result.models.models.size() > 1) {
    return "the reconstruction is in " + std::to_string(result.models.models.size()) + " pieces";
  }
  if (std::isinf(result.evidence)) return "nothing looks alike";
  return std::string("what looks alike was told apart") +
         (told_apart == ToldApart::kCalibration ? " by the calibration" : "");
}

/// The finished model and what it says of itself.
Status Judge(State& state, double gain) {
  TcSfmResult& result = state.result;
  const Reconstruction& model = result.models.models.front();
  Alternatives alternatives =
      FindAlternatives(model, state.input.features, state.input.two_views, result.two_views,
                       state.options.covisibility, {}, state.context);
  if (state.context.Stopped()) return Error{ErrorCode::kCancelled, "cancelled", kStage};
  result.evidence = alternatives.poses.empty() ? std::numeric_limits<double>::infinity()
                                               : alternatives.evidence_against;
  if (state.options.single_image_doubt) result.doubtful = DoubtfulImages(state, alternatives);
  const std::optional<double> gap_deg = GapInRing_deg(model, state.options);
  const ToldApart told_apart = WhatTellsApart(state, alternatives);
  const bool sure = told_apart != ToldApart::kNothing && !gap_deg && result.doubtful.empty() &&
                    result.models.models.size() == 1;
  result.alternatives = std::move(alternatives.poses);
  result.reason = ReasonFor(result, gain, told_apart, gap_deg);
  result.verdict = gain > 0 ? Verdict::kFolded : sure ? Verdict::kSure : Verdict::kUnsure;
  return {};
}

/// From the edges that are left to a finished model.
Status Finish(State& state, const IncrementalOptions& incremental) {
  state.result.notes.clear();
  ROTUNDA_ASSIGN_OR_RETURN(Draft draft, BuildDraft(state, incremental));
  ROTUNDA_RETURN_IF_ERROR(Join(state, draft));
  return Complete(state, draft, incremental);
}

/// Finished models until one passes the test of the drafts, or as often as the options allow: what
/// joining and completing brought in may fold again.
Status FinishUnfolded(State& state, const IncrementalOptions& incremental) {
  ROTUNDA_RETURN_IF_ERROR(Finish(state, incremental));
  for (;;) {
    state.context.Report(kStage, 0, 1);
    const std::vector<Reconstruction> model = {state.result.models.models.front()};
    ROTUNDA_ASSIGN_OR_RETURN(
        const DraftGroups groups,
        GroupsOfDraft(state, model, state.result.two_views, state.result.view_graph));
    if (groups.gain == 0 || !MayTakeApart(state)) return Judge(state, groups.gain);
    const TcSfmResult folded = state.result;
    TakeApart(state, model, groups);
    const Status again = Finish(state, incremental);
    if (again.ok()) continue;
    if (again.error().code != ErrorCode::kFailed) return again;
    state.result = folded;
    return Judge(state, groups.gain);
  }
}

/// Refutes what the calibration refutes, when it is to be a prior.
Status ApplyPrior(State& state) {
  const CalibratedPoses& calibrated = state.input.calibrated;
  if (calibrated.empty()) return {};
  ROTUNDA_ASSIGN_OR_RETURN(CalibrationPrior prior,
                           BuildCalibrationPrior(state.input.view_graph, state.input.two_views,
                                                 calibrated, state.options.prior));
  state.refuted = std::move(prior.refuted);
  state.placed = std::move(prior.placed);
  state.result.not_as_calibrated = std::move(prior.contradicted);
  return {};
}

std::vector<EdgeVerdict> VerdictsOf(const TcSfmInput& input, const TcSfmResult& result) {
  std::vector<EdgeVerdict> verdicts;
  for (const ViewGraphEdge& edge : input.view_graph.edges) {
    verdicts.push_back(HasPair(result.two_views, edge.pair) ? EdgeVerdict::kAgrees
                                                            : EdgeVerdict::kRejected);
  }
  return verdicts;
}

}  // namespace

const char* VerdictName(Verdict verdict) {
  switch (verdict) {
    case Verdict::kSure:
      return "sure";
    case Verdict::kUnsure:
      return "unsure";
    case Verdict::kFolded:
      return "folded";
  }
  return "";
}

Status TcSfmOptions::Validate() const {
  ROTUNDA_RETURN_IF_ERROR(prior.Validate());
  ROTUNDA_RETURN_IF_ERROR(consistency.Validate());
  ROTUNDA_RETURN_IF_ERROR(covisibility.Validate());
  ROTUNDA_RETURN_IF_ERROR(merging.Validate());
  if (max_unfoldings < 0) {
    return Error{ErrorCode::kInvalidArgument,
                 std::to_string(max_unfoldings) + " is out of range, expected >= 0",
                 "max_unfoldings"};
  }
  if (!(min_evidence >= 0)) {
    return Error{ErrorCode::kInvalidArgument,
                 std::to_string(min_evidence) + " is out of range, expected >= 0", "min_evidence"};
  }
  if (max_gap_deg && !(*max_gap_deg > 0 && *max_gap_deg <= 360)) {
    return Error{ErrorCode::kInvalidArgument,
                 std::to_string(*max_gap_deg) + " is out of range, expected above 0 to 360",
                 "max_gap_deg"};
  }
  if (!(min_gain > 0)) {
    return Error{ErrorCode::kInvalidArgument,
                 std::to_string(min_gain) + " is out of range, expected > 0", "min_gain"};
  }
  return {};
}

Result<TcSfmResult> RunTcSfm(const TcSfmInput& input, const TcSfmOptions& options,
                             const IncrementalOptions& incremental, RunContext& context) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  State state = {input, options, context, std::vector<bool>(input.view_graph.edges.size(), false),
                 std::vector<bool>(input.features.images.size(), false)};
  state.result.certainty.assign(input.features.images.size(),
                                std::numeric_limits<double>::infinity());
  ROTUNDA_RETURN_IF_ERROR(ApplyPrior(state));
  ROTUNDA_RETURN_IF_ERROR(FinishUnfolded(state, incremental));
  state.result.verdicts = VerdictsOf(input, state.result);
  return std::move(state.result);
}

}  // namespace rotunda::sfm
