#include "sfm/incremental.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <memory>

#include "sfm/focal_estimation.h"
#include "sfm/model_builder.h"
#include "sfm/track_selection.h"

namespace rotunda::sfm {
namespace {

constexpr char kStage[] = "reconstruction";
/// Tracks a picture that a model is grown on; the rest come in when all images are there.
constexpr size_t kGrowingTracksPerImage = 1000;
/// Images whose poses are estimated side by side, as a share of the model, and at most.
constexpr double kBatchShare = 0.15;
constexpr size_t kMaxBatch = 8;
/// An image that could not be registered is tried again when it sees this many times the points.
constexpr double kRetryGrowth = 1.2;
/// Initial pairs tried for one model.
constexpr size_t kMaxInitialPairs = 60;
/// How far the demands on the initial pair are relaxed, by halves.
constexpr int kInitialRelaxations = 3;
constexpr size_t kLeastInitialInliers = 30;
/// PnP inliers that are enough when nothing else can be registered, as a share of the usual.
constexpr double kLeastPnpShare = 0.5;
/// Rounds of triangulation, adjustment and filtering over all tracks end when one takes out less
/// than this share of the observations.
constexpr double kSettledShare = 0.01;
constexpr int kMaxFinalRounds = 4;
/// Observations that must hold an image in the finished model: as many as a pair needs matches.
/// Poses are accepted at a wider error than observations, so an image can lose all of them.
constexpr size_t kMinHeldObservations = 15;
/// Lenses are refined only in models of at least this many images: fewer do not determine them.
constexpr size_t kMinImagesToRefine = 4;
/// Residuals of keypoints have heavier tails than a Gaussian: the last adjustments use the Cauchy
/// loss at this many robust standard deviations, and only what is further off than kMaxSigmas of
/// them is taken for a mismatch. On a rendered set of 90 cameras, cutting at 4 and adjusting by
/// least squares made camera centres 14 % worse and their predicted deviations half of the true.
constexpr double kFinalLossScale = 3.0;
constexpr double kMaxSigmas = 20.0;

/// Neighbours of every image in the view graph.
struct Neighbour {
  ImageId image;
  double weight;
};
using Adjacency = std::vector<std::vector<Neighbour>>;

Adjacency NeighboursOf(const ViewGraph& graph) {
  Adjacency neighbours(graph.images);
  for (const ViewGraphEdge& edge : graph.edges) {
    neighbours[edge.pair.first.index()].push_back({edge.pair.second, edge.weight});
    neighbours[edge.pair.second.index()].push_back({edge.pair.first, edge.weight});
  }
  return neighbours;
}

/// Everything the growth of one model after the other shares.
struct Growth {
  const IncrementalInput& input;
  const IncrementalOptions& options;
  RunContext& context;
  Adjacency neighbours;
  std::vector<bool> growing_tracks;  // by TrackId
  std::vector<bool> allowed;         // by ImageId: in no model yet
  std::vector<std::string> reasons;  // by ImageId: why it was last refused
};

/// Candidates for an initial pair, in the order of trial: those that meet the full demands first;
/// among equals the strongest link of the view graph.
struct InitialCandidate {
  size_t two_view = 0;
  int relaxation = 0;
  double weight = 0;
};

std::optional<int> RelaxationFor(const TwoView& pair, const IncrementalOptions& options) {
  if (pair.kind == TwoViewKind::kPanoramic) return std::nullopt;
  for (int level = 0; level < kInitialRelaxations; ++level) {
    const double factor = std::pow(0.5, level);
    const auto inliers =
        std::max(kLeastInitialInliers, static_cast<size_t>(factor * options.min_initial_inliers));
    if (pair.median_angle_rad >= factor * options.min_initial_angle_rad &&
        pair.inliers.size() >= inliers) {
      return level;
    }
  }
  return std::nullopt;
}

std::vector<InitialCandidate> InitialCandidates(const Growth& growth) {
  std::vector<InitialCandidate> candidates;
  for (const ViewGraphEdge& edge : growth.input.view_graph.edges) {
    const TwoView& pair = growth.input.two_views.pairs[edge.two_view];
    if (!growth.allowed[pair.pair.first.index()] || !growth.allowed[pair.pair.second.index()]) {
      continue;
    }
    const std::optional<int> level = RelaxationFor(pair, growth.options);
    if (level) candidates.push_back({edge.two_view, *level, edge.weight});
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const InitialCandidate& a, const InitialCandidate& b) {
                     if (a.relaxation != b.relaxation) return a.relaxation < b.relaxation;
                     return a.weight > b.weight;
                   });
  return candidates;
}

BundleAdjustmentOptions GrowingAdjustment() {
  BundleAdjustmentOptions options;
  options.loss = Loss::kSoftL1;
  options.max_iterations = 15;
  options.function_tolerance = 1e-3;
  return options;
}

/// Grows one model from its initial pair.
class Grower {
 public:
  Grower(Growth& growth, ModelBuilder& builder)
      : growth_(growth),
        builder_(builder),
        weight_to_model_(growth.allowed.size(), 0.0),
        refused_at_(growth.allowed.size(), 0) {
    for (const ImageId image : builder.RegisteredImages()) LinkNeighbours(image);
  }

  Status Run() {
    RememberSize();
    bool relaxed = false;
    while (!growth_.context.Stopped()) {
      const std::vector<ImageId> candidates = Candidates(relaxed);
      if (candidates.empty()) {
        if (relaxed) break;
        relaxed = true;
        continue;
      }
      const std::vector<ImageId> added = RegisterSome(candidates, relaxed);
      if (added.empty()) continue;
      relaxed = false;
      ROTUNDA_RETURN_IF_ERROR(Absorb(added));
    }
    if (growth_.context.Stopped()) return Error{ErrorCode::kCancelled, "cancelled", kStage};
    return {};
  }

 private:
  size_t MinInliers(bool relaxed) const {
    const size_t usual = growth_.options.min_pnp_inliers;
    return relaxed ? static_cast<size_t>(kLeastPnpShare * usual) : usual;
  }

  void LinkNeighbours(ImageId image) {
    for (const Neighbour& neighbour : growth_.neighbours[image.index()]) {
      double& weight = weight_to_model_[neighbour.image.index()];
      weight = std::max(weight, neighbour.weight);
    }
  }

  /// Images that see enough points, strongest link to the model first (Prim's order: the image most
  /// like one of the model's, not the one with most matches, which look-alike sides win).
  std::vector<ImageId> Candidates(bool relaxed) const {
    std::vector<ImageId> candidates;
    for (size_t i = 0; i < growth_.allowed.size(); ++i) {
      const ImageId image(i);
      if (!growth_.allowed[i] || builder_.IsRegistered(image)) continue;
      const size_t visible = builder_.VisiblePoints(image);
      if (visible < MinInliers(relaxed)) continue;
      const size_t refused_at = relaxed ? refused_relaxed_at_[i] : refused_at_[i];
      if (static_cast<double>(visible) <= kRetryGrowth * static_cast<double>(refused_at)) continue;
      candidates.push_back(image);
    }
    std::stable_sort(candidates.begin(), candidates.end(), [&](ImageId a, ImageId b) {
      return weight_to_model_[a.index()] > weight_to_model_[b.index()];
    });
    return candidates;
  }

  std::vector<ImageId> RegisterSome(const std::vector<ImageId>& candidates, bool relaxed) {
    const auto batch =
        std::clamp(static_cast<size_t>(kBatchShare * static_cast<double>(builder_.Registered())),
                   size_t{1}, std::min(kMaxBatch, candidates.size()));
    std::vector<std::optional<Result<ImageEstimate>>> poses(batch);
    growth_.context.threads.ParallelFor(batch, [&](size_t i) {
      poses[i] = builder_.EstimatePose(candidates[i], MinInliers(relaxed));
    });
    std::vector<ImageId> added;
    for (size_t i = 0; i < batch; ++i) {
      const ImageId image = candidates[i];
      if (!poses[i]->ok()) {
        auto& refused_at = relaxed ? refused_relaxed_at_ : refused_at_;
        refused_at[image.index()] = builder_.VisiblePoints(image);
        growth_.reasons[image.index()] = poses[i]->error().message;
        continue;
      }
      builder_.Register(image, **poses[i]);
      LinkNeighbours(image);
      added.push_back(image);
    }
    return added;
  }

  Status Absorb(const std::vector<ImageId>& added) {
    const double max_error_px = growth_.options.max_reprojection_px;
    const double no_limit = std::numeric_limits<double>::infinity();
    builder_.TriangulateFor(added);
    ReportProgress();
    if (!Outgrown()) {
      ROTUNDA_RETURN_IF_ERROR(builder_.AdjustLocally(added));
      builder_.Filter(max_error_px, no_limit);
      return {};
    }
    ROTUNDA_RETURN_IF_ERROR(builder_.AdjustGlobally(GrowingAdjustment()));
    builder_.Filter(max_error_px, no_limit);
    builder_.TriangulateAll();
    RememberSize();
    return {};
  }

  bool Outgrown() const {
    const double factor = growth_.options.global_ba_growth;
    return static_cast<double>(builder_.Registered()) >= factor * images_at_global_ ||
           static_cast<double>(builder_.PointCount()) >= factor * points_at_global_;
  }
  void RememberSize() {
    images_at_global_ = static_cast<double>(builder_.Registered());
    points_at_global_ = static_cast<double>(builder_.PointCount());
  }
  void ReportProgress() const {
    const auto placed =
        static_cast<size_t>(std::count(growth_.allowed.begin(), growth_.allowed.end(), false));
    growth_.context.Report(kStage, placed + builder_.Registered(), growth_.allowed.size());
  }

  Growth& growth_;
  ModelBuilder& builder_;
  std::vector<double> weight_to_model_;  // by ImageId
  std::vector<size_t> refused_at_;       // by ImageId: points it saw when it was refused
  std::vector<size_t> refused_relaxed_at_ = refused_at_;
  double images_at_global_ = 0;
  double points_at_global_ = 0;
};

/// Takes images out that too little holds; says why, and whether there were any.
bool DropWeakImages(ModelBuilder& builder, Growth& growth) {
  const std::vector<WeakImage> weak = builder.UnregisterWeak(kMinHeldObservations);
  for (const WeakImage& w : weak) {
    growth.reasons[w.image.index()] =
        "only " + std::to_string(w.observations) + " observations hold after adjustment";
  }
  return !weak.empty();
}

/// All tracks: rounds of triangulation, robust adjustment and filtering until mismatches are gone,
/// then one adjustment to convergence of the images that enough observations hold. What is left
/// may be too small for a model.
Status Finish(ModelBuilder& builder, Growth& growth) {
  const IncrementalOptions& options = growth.options;
  BundleAdjustmentOptions adjustment;
  adjustment.loss = Loss::kCauchy;
  adjustment.function_tolerance = 1e-4;
  adjustment.max_iterations = 30;
  builder.UseAllTracks();
  if (options.draft) {
    builder.TriangulateAll();
    builder.Filter(options.max_reprojection_px, std::numeric_limits<double>::infinity());
    DropWeakImages(builder, growth);
    return {};
  }
  for (int round = 0; round < kMaxFinalRounds; ++round) {
    builder.TriangulateAll();
    adjustment.loss_scale = kFinalLossScale * builder.RobustSigma();
    ROTUNDA_RETURN_IF_ERROR(builder.AdjustGlobally(adjustment));
    const size_t removed = builder.Filter(options.max_reprojection_px, kMaxSigmas);
    if (static_cast<double>(removed) <
        kSettledShare * static_cast<double>(builder.ObservationCount())) {
      break;
    }
  }
  adjustment.function_tolerance = 1e-7;
  adjustment.max_iterations = 50;
  DropWeakImages(builder, growth);
  do {
    if (builder.Registered() < options.min_model_images) return {};
    adjustment.loss_scale = kFinalLossScale * builder.RobustSigma();
    ROTUNDA_RETURN_IF_ERROR(builder.AdjustGlobally(adjustment));
    builder.Filter(options.max_reprojection_px, kMaxSigmas);
  } while (DropWeakImages(builder, growth));
  return {};
}

/// From an initialised pair to a finished model; kFailed when it ends with too few images or an
/// adjustment fails.
Status Complete(ModelBuilder& builder, Growth& growth) {
  const auto check_size = [&]() -> Status {
    if (builder.Registered() >= growth.options.min_model_images) return {};
    return Error{ErrorCode::kFailed,
                 "its model stays at " + std::to_string(builder.Registered()) + " images", kStage};
  };
  ROTUNDA_RETURN_IF_ERROR(Grower(growth, builder).Run());
  ROTUNDA_RETURN_IF_ERROR(check_size());
  ROTUNDA_RETURN_IF_ERROR(Finish(builder, growth));
  return check_size();
}

/// The next model from images of no model yet; nullopt when none begins or none gets big enough.
/// `lacking` then says what the last pair lacked.
Result<std::optional<Reconstruction>> NextModel(Growth& growth, std::string& lacking) {
  const std::vector<InitialCandidate> candidates = InitialCandidates(growth);
  const size_t trials = std::min(candidates.size(), kMaxInitialPairs);
  for (size_t c = 0; c < trials; ++c) {
    const InitialCandidate& candidate = candidates[c];
    const TwoView& pair = growth.input.two_views.pairs[candidate.two_view];
    const double factor = std::pow(0.5, candidate.relaxation);
    ModelBuilder builder(growth.input, growth.options, growth.growing_tracks, growth.context);
    Status built = builder.Initialize(pair, kLeastInitialInliers,
                                      0.5 * factor * growth.options.min_initial_angle_rad);
    if (built.ok()) built = Complete(builder, growth);
    if (built.ok()) return std::optional<Reconstruction>(builder.Take());
    if (built.error().code == ErrorCode::kCancelled) return built.error();
    lacking = built.error().message;
  }
  return std::optional<Reconstruction>();
}

Error NoInitialPair(const IncrementalInput& input, const std::string& lacking) {
  const TwoView* best = nullptr;
  for (const TwoView& pair : input.two_views.pairs) {
    if (!best || pair.inliers.size() > best->inliers.size()) best = &pair;
  }
  if (!best) return {ErrorCode::kFailed, "no two pictures match", kStage};
  return {ErrorCode::kFailed,
          "no pair of pictures starts a model; the best has " +
              std::to_string(best->inliers.size()) + " matches at a median angle of " +
              std::to_string(DegFromRad(best->median_angle_rad)) + " deg" +
              (lacking.empty() ? "" : "; last tried: " + lacking),
          kStage};
}

std::vector<UnregisteredImage> Unregistered(const Growth& growth) {
  std::vector<UnregisteredImage> unregistered;
  for (size_t i = 0; i < growth.allowed.size(); ++i) {
    if (!growth.allowed[i]) continue;
    std::string reason = growth.reasons[i];
    if (growth.input.features.images[i].keypoints.empty()) {
      reason = "no keypoints";
    } else if (growth.neighbours[i].empty()) {
      reason = "matches no other picture";
    } else if (reason.empty()) {
      reason = "sees too few points of any model";
    }
    unregistered.push_back({ImageId(i), reason});
  }
  return unregistered;
}

}  // namespace

Status IncrementalOptions::Validate() const {
  const auto bad = [](const char* field, double value, const char* expected) {
    return Error{ErrorCode::kInvalidArgument,
                 std::to_string(value) + " is out of range, expected " + expected, field};
  };
  if (!(min_initial_angle_rad > 0))
    return bad("min_initial_angle_rad", min_initial_angle_rad, "> 0");
  if (!(max_reprojection_px > 0)) return bad("max_reprojection_px", max_reprojection_px, "> 0");
  if (!(min_triangulation_angle_rad > 0)) {
    return bad("min_triangulation_angle_rad", min_triangulation_angle_rad, "> 0");
  }
  if (!(max_pnp_error_px > 0)) return bad("max_pnp_error_px", max_pnp_error_px, "> 0");
  if (min_pnp_inliers < 6) return bad("min_pnp_inliers", min_pnp_inliers, ">= 6");
  if (!(min_pnp_inlier_ratio >= 0 && min_pnp_inlier_ratio <= 1)) {
    return bad("min_pnp_inlier_ratio", min_pnp_inlier_ratio, "0 to 1");
  }
  if (!(global_ba_growth > 1)) return bad("global_ba_growth", global_ba_growth, "> 1");
  if (min_model_images < 3) return bad("min_model_images", min_model_images, ">= 3");
  if (max_models < 1) return bad("max_models", max_models, ">= 1");
  return {};
}

bool RefinesIntrinsics(size_t registered_images, const IncrementalOptions& options) {
  return options.refine_intrinsics && registered_images >= kMinImagesToRefine;
}

namespace {

Growth BeginGrowth(const IncrementalInput& input, const IncrementalOptions& options,
                   RunContext& context) {
  const size_t images = input.features.images.size();
  return {input,
          options,
          context,
          NeighboursOf(input.view_graph),
          SelectTracks(input.features, input.tracks, kGrowingTracksPerImage),
          std::vector<bool>(images, true),
          std::vector<std::string>(images)};
}

Result<IncrementalResult> BuildModels(const IncrementalInput& input,
                                      const IncrementalOptions& options, RunContext& context) {
  const size_t images = input.features.images.size();
  Growth growth = BeginGrowth(input, options, context);
  IncrementalResult result;
  std::string lacking;
  while (result.models.size() < options.max_models) {
    ROTUNDA_ASSIGN_OR_RETURN(std::optional<Reconstruction> model, NextModel(growth, lacking));
    if (!model) break;
    for (size_t i = 0; i < images; ++i) {
      if (model->Registered(ImageId(i))) growth.allowed[i] = false;
    }
    result.models.push_back(*std::move(model));
  }
  if (result.models.empty()) return NoInitialPair(input, lacking);
  std::stable_sort(result.models.begin(), result.models.end(),
                   [](const Reconstruction& a, const Reconstruction& b) {
                     const size_t a_images = RegisteredCount(a), b_images = RegisteredCount(b);
                     if (a_images != b_images) return a_images > b_images;
                     return a.points.size() > b.points.size();
                   });
  result.unregistered = Unregistered(growth);
  return result;
}

}  // namespace

Result<IncrementalResult> BuildReconstructions(const IncrementalInput& input,
                                               const IncrementalOptions& options,
                                               RunContext& context) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  if (!options.refine_intrinsics || input.intrinsics.known) {
    return BuildModels(input, options, context);
  }
  const SelfCalibration start =
      EstimateFocalLengths(input.features, input.intrinsics, input.two_views, context);
  const IncrementalInput calibrated = {input.features, start.intrinsics, start.two_views,
                                       input.view_graph, input.tracks};
  return BuildModels(calibrated, options, context);
}

void AppendModels(std::vector<Reconstruction> others, size_t min_images,
                  IncrementalResult& result) {
  for (Reconstruction& other : others) {
    for (size_t i = 0; i < other.cam_from_model.size(); ++i) {
      const bool taken =
          std::any_of(result.models.begin(), result.models.end(),
                      [&](const Reconstruction& model) { return model.Registered(ImageId(i)); });
      if (taken) other.cam_from_model[i].reset();
    }
    if (RegisteredCount(other) < min_images) continue;
    for (Point3& point : other.points) {
      std::erase_if(point.observations,
                    [&](const Observation& o) { return !other.Registered(o.image); });
    }
    std::erase_if(other.points, [](const Point3& p) { return p.observations.size() < 2; });
    std::erase_if(result.unregistered,
                  [&](const UnregisteredImage& u) { return other.Registered(u.image); });
    result.models.push_back(std::move(other));
  }
}

Result<IncrementalResult> ExtendReconstruction(const IncrementalInput& input,
                                               const Reconstruction& start,
                                               const IncrementalOptions& options,
                                               RunContext& context) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  context.Report(kStage, RegisteredCount(start), input.features.images.size());
  Growth growth = BeginGrowth(input, options, context);
  ModelBuilder builder(input, options, growth.growing_tracks, context);
  builder.Adopt(start);
  builder.TriangulateAll();
  if (builder.PointCount() == 0) {
    return Error{ErrorCode::kFailed, "no track is seen by two images of the model", kStage};
  }
  ROTUNDA_RETURN_IF_ERROR(builder.AdjustGlobally(GrowingAdjustment()));
  builder.Filter(options.max_reprojection_px, std::numeric_limits<double>::infinity());
  ROTUNDA_RETURN_IF_ERROR(Complete(builder, growth));
  IncrementalResult result;
  result.models.push_back(builder.Take());
  for (size_t i = 0; i < growth.allowed.size(); ++i) {
    growth.allowed[i] = !result.models.front().Registered(ImageId(i));
  }
  result.unregistered = Unregistered(growth);
  return result;
}

}  // namespace rotunda::sfm
