#include "sfm/correction.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <string>

#include "sfm/core/statistics.h"

namespace rotunda::sfm {
namespace {

constexpr char kStage[] = "correction";
/// An image that could not be judged is tried again when it sees this many times the points.
constexpr double kRetryGrowth = 1.2;
/// Fewer points that an image must see, or pairs with registered images, tell nothing.
constexpr size_t kMinExpectedPoints = 30;
constexpr size_t kMinPairs = 2;
/// A pair agrees with a rotation that is no farther off than this.
constexpr double kLoopAgrees_rad = RadFromDeg(15.0);
/// Initial pairs tried for one pass.
constexpr size_t kMaxInitialPairs = 60;
/// How far the angle of the initial pair is relaxed, by halves.
constexpr int kInitialRelaxations = 2;
/// Keypoints and points are not taken to be better than this when a pose's deviation is predicted.
constexpr double kLeastError_px = 1.0;

using Label = std::optional<uint32_t>;
using KeypointLabels = std::vector<std::vector<Label>>;

/// Everything the segments share.
struct Scene {
  const IncrementalInput& input;
  const Segments& segments;
  const CorrectionOptions& options;
  KeypointLabels labels;  // segments
  std::vector<std::vector<Eigen::Vector2d>> normalized;
  const std::set<ImagePair>& rejected;
};

KeypointLabels SegmentLabels(const Tracks& tracks, const Segments& segments, bool by_track) {
  KeypointLabels labels = segments.of_keypoint;
  if (!by_track) return labels;
  for (size_t t = 0; t < tracks.tracks.size(); ++t) {
    for (const Observation& o : tracks.tracks[t].observations) {
      labels[o.image.index()][o.keypoint.index()] = segments.of_track[t];
    }
  }
  return labels;
}

std::vector<std::vector<Eigen::Vector2d>> NormalizedKeypoints(const IncrementalInput& input,
                                                              RunContext& context) {
  std::vector<std::vector<Eigen::Vector2d>> normalized(input.features.images.size());
  context.threads.ParallelFor(normalized.size(), [&](size_t i) {
    const CameraIntrinsics& lens = input.intrinsics.of(ImageId(i));
    for (const Keypoint& keypoint : input.features.images[i].keypoints) {
      const auto ray = lens.NormalizedFromPixel({keypoint.x_px, keypoint.y_px});
      normalized[i].push_back(
          ray.value_or(Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN())));
    }
  });
  return normalized;
}

/// Matches of the segment's related images that lie in the segment or in one distinct segment.
SegmentModelInput ModelInput(const Scene& scene, uint32_t segment) {
  const size_t images = scene.input.features.images.size();
  SegmentModelInput result = {scene.input, scene.normalized, {}};
  result.neighbours.resize(images);
  std::vector<bool> related(images, false);
  for (const ImageId image : scene.segments.segments[segment].images) related[image.index()] = true;
  for (const ViewGraphEdge& edge : scene.input.view_graph.edges) {
    const auto [first, second] = edge.pair;
    const TwoView& view = scene.input.two_views.pairs[edge.two_view];
    if (!related[first.index()] || !related[second.index()]) continue;
    if (view.kind == TwoViewKind::kPanoramic) continue;
    const Eigen::Quaterniond& turn = view.second_from_first.rotation;
    const bool contradicts = scene.rejected.contains(edge.pair);
    SegmentNeighbour of_first = {second, edge.weight, turn.conjugate(), contradicts, {}};
    SegmentNeighbour of_second = {first, edge.weight, turn, contradicts, {}};
    for (const Match& match : view.inliers) {
      const Label label = scene.labels[first.index()][match.first.index()];
      if (!label || label != scene.labels[second.index()][match.second.index()]) continue;
      if (*label != segment && scene.segments.segments[*label].ambiguous) continue;
      const PointKind kind = *label == segment ? PointKind::kPrimary : PointKind::kAuxiliary;
      of_first.matches.push_back({match.first, match.second, kind});
      of_second.matches.push_back({match.second, match.first, kind});
    }
    if (of_first.matches.empty()) continue;
    result.neighbours[first.index()].push_back(std::move(of_first));
    result.neighbours[second.index()].push_back(std::move(of_second));
  }
  return result;
}

/// Standard deviations that keypoint noise leaves a pose with.
struct PoseDeviation {
  double rotation_rad = std::numeric_limits<double>::infinity();
  double center = std::numeric_limits<double>::infinity();  // model units
};

/// From the normal equations of the inliers' reprojection errors, whose own scatter is the noise.
PoseDeviation DeviationOf(const AbsolutePose& pose, const AbsolutePoseInput& input) {
  Eigen::Matrix<double, 6, 6> hessian = Eigen::Matrix<double, 6, 6>::Zero();
  double squares_px2 = 0;
  for (const size_t i : pose.inliers) {
    const Eigen::Vector3d x = pose.cam_from_model * input.points[i];
    Eigen::Matrix<double, 2, 3> by_point;
    by_point << 1, 0, -x.x() / x.z(), 0, 1, -x.y() / x.z();
    by_point *= input.focal_px / x.z();
    // x + w cross x + dt, so that the centre moves by -R^T dt.
    Eigen::Matrix<double, 2, 6> jacobian;
    jacobian << -by_point * CrossMatrix(x), by_point;
    hessian += jacobian.transpose() * jacobian;
    squares_px2 +=
        std::pow(input.focal_px, 2) * (x.hnormalized() - input.normalized[i]).squaredNorm();
  }
  const double freedom = 2.0 * static_cast<double>(pose.inliers.size()) - 6.0;
  const double variance_px2 =
      std::max(kLeastError_px * kLeastError_px, squares_px2 / std::max(1.0, freedom));
  const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> solver(hessian);
  if (solver.info() != Eigen::Success || !(solver.vectorD().minCoeff() > 0)) return {};
  const Eigen::Matrix<double, 6, 6> covariance =
      variance_px2 * solver.solve(Eigen::Matrix<double, 6, 6>::Identity());
  return {std::sqrt(covariance.topLeftCorner<3, 3>().trace()),
          std::sqrt(covariance.bottomRightCorner<3, 3>().trace())};
}

Eigen::Vector3d CentroidOfInliers(const AbsolutePose& pose, const AbsolutePoseInput& input) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const size_t i : pose.inliers) sum += input.points[i];
  return sum / static_cast<double>(pose.inliers.size());
}

/// Fills in the differences between the two poses and how well they are known.
void ComparePoses(const AbsolutePose& primary, const AbsolutePoseInput& primary_input,
                  const AbsolutePose& auxiliary, const AbsolutePoseInput& auxiliary_input,
                  PlaceDistance distance, Judgement& judgement) {
  const Rigid3 &a = primary.cam_from_model, &b = auxiliary.cam_from_model;
  const Eigen::Vector3d centroid = CentroidOfInliers(primary, primary_input);
  const PoseDeviation of_a = DeviationOf(primary, primary_input);
  const PoseDeviation of_b = DeviationOf(auxiliary, auxiliary_input);
  const double radius_a = (a.OriginInSource() - centroid).norm();
  const double radius_b = (b.OriginInSource() - centroid).norm();
  judgement.rotation_rad = RotationAngle_rad(a.rotation, b.rotation);
  judgement.place_rad = distance == PlaceDistance::kCenterAngle ? CenterAngle_rad(a, b, centroid)
                                                                : TranslationAngle_rad(a, b);
  judgement.rotation_sigma_rad = std::hypot(of_a.rotation_rad, of_b.rotation_rad);
  judgement.place_sigma_rad = std::hypot(of_a.center / radius_a, of_b.center / radius_b);
}

/// One ambiguous segment and its passes.
struct Case {
  const Scene& scene;
  RunContext& context;
  uint32_t segment;
  SegmentModelInput model_input;
  std::vector<bool> waiting;    // by ImageId: in no subset yet
  std::vector<bool> may_start;  // by ImageId: no pass without a subset began with it
};

/// Grows one model and judges the images that wait.
class Pass {
 public:
  Pass(const Case& segment_case, SegmentModel& model, const std::vector<size_t>& images)
      : case_(segment_case), model_(model), images_(images) {
    for (const ImageId image : model.RegisteredImages()) {
      judgements_[image.index()] = {.image = image, .verdict = ImageVerdict::kInitial};
    }
  }

  void Run() {
    while (!case_.context.Stopped()) {
      const std::optional<ImageId> next = Next();
      if (!next) break;
      Judge(*next);
    }
    for (const size_t i : images_) {
      if (judgements_.count(i)) continue;
      const Counts& counts = CountsOf(ImageId(i));
      judgements_[i] = {.image = ImageId(i),
                        .primary_points = counts.primary,
                        .auxiliary_points = counts.auxiliary};
    }
  }

  /// By image.
  const std::map<size_t, Judgement>& judgements() const { return judgements_; }

 private:
  struct Counts {
    size_t primary = 0;
    size_t auxiliary = 0;
  };

  const CorrectionOptions& options() const { return case_.scene.options; }

  const Counts& CountsOf(ImageId image) {
    const auto known = counts_.find(image.index());
    if (known != counts_.end()) return known->second;
    return counts_[image.index()] = {model_.SupportOf(image, PointKind::kPrimary).size(),
                                     model_.SupportOf(image, PointKind::kAuxiliary).size()};
  }

  /// Sees enough, and enough more than when it could not be judged.
  bool Eligible(ImageId image) {
    const Counts& now = CountsOf(image);
    if (now.primary < options().min_primary_inliers) return false;
    const auto before = judgements_.find(image.index());
    if (before == judgements_.end()) return true;
    const Judgement& last = before->second;
    const auto grown = [](size_t count, size_t earlier) {
      return static_cast<double>(count) > kRetryGrowth * static_cast<double>(earlier);
    };
    switch (last.verdict) {
      case ImageVerdict::kUnplaced:
        return grown(now.primary, last.primary_points);
      case ImageVerdict::kUndecided:
        if (AsksBesides() && grown(model_.RegisteredImages().size(), last.images)) return true;
        return now.auxiliary >= options().min_auxiliary_inliers &&
               grown(now.auxiliary, last.auxiliary_points);
      case ImageVerdict::kRefused:
        return grown(now.primary + now.auxiliary, last.primary_points + last.auxiliary_points);
      default:
        return false;
    }
  }

  double LinkToModel(ImageId image) const {
    double heaviest = 0;
    for (const SegmentNeighbour& n : case_.model_input.neighbours[image.index()]) {
      if (model_.IsRegistered(n.image)) heaviest = std::max(heaviest, n.weight);
    }
    return heaviest;
  }

  std::optional<ImageId> Next() {
    std::optional<ImageId> best;
    double best_rank = 0;
    for (const size_t i : images_) {
      const ImageId image(i);
      if (model_.IsRegistered(image)) continue;
      const double rank = options().next == NextImage::kStrongestLink
                              ? LinkToModel(image)
                              : static_cast<double>(CountsOf(image).primary);
      if (rank > best_rank && Eligible(image)) best = image, best_rank = rank;
    }
    return best;
  }

  void Judge(ImageId image) {
    Judgement& judgement = judgements_[image.index()];
    Rigid3 pose;
    judgement = Judged(image, pose);
    counts_[image.index()] = {judgement.primary_points, judgement.auxiliary_points};
    if (judgement.verdict != ImageVerdict::kConsistent) return;
    if (options().missing_observations) {
      const ExpectedPoints expected = model_.ExpectedAt(image, pose);
      if (expected.all >= kMinExpectedPoints) met_shares_.push_back(Share(expected));
    }
    model_.Register(image, model_.RefinedPose(image, pose));
    for (const SegmentNeighbour& n : case_.model_input.neighbours[image.index()]) {
      counts_.erase(n.image.index());
    }
  }

  Judgement Judged(ImageId image, Rigid3& cam_from_model) const {
    const Support primary = model_.SupportOf(image, PointKind::kPrimary);
    const Support auxiliary = model_.SupportOf(image, PointKind::kAuxiliary);
    Judgement judgement = {.image = image,
                           .verdict = ImageVerdict::kUndecided,
                           .primary_points = primary.size(),
                           .auxiliary_points = auxiliary.size(),
                           .images = model_.RegisteredImages().size()};
    const bool enough = auxiliary.size() >= options().min_auxiliary_inliers;
    if (!enough && !AsksBesides() && !options().undecided_is_consistent) return judgement;
    const uint64_t seed = DeriveSeed(case_.context.seed, image.index());
    const auto by_primary = model_.EstimatePose(primary, options().min_primary_inliers, seed);
    if (!by_primary) {
      judgement.verdict = ImageVerdict::kUnplaced;
      return judgement;
    }
    cam_from_model = by_primary->cam_from_model;
    judgement.primary_inliers = by_primary->inliers.size();
    if (enough) JudgeByAuxiliary(*by_primary, primary, auxiliary, seed, judgement);
    JudgeBesides(image, cam_from_model, judgement);
    if (judgement.verdict == ImageVerdict::kUndecided && options().undecided_is_consistent) {
      judgement.verdict = ImageVerdict::kConsistent;
    }
    return judgement;
  }

  void JudgeByAuxiliary(const AbsolutePose& by_primary, const Support& primary,
                        const Support& auxiliary, uint64_t seed, Judgement& judgement) const {
    const auto by_auxiliary = model_.EstimatePose(auxiliary, options().min_auxiliary_inliers, seed);
    if (!by_auxiliary) return;
    judgement.auxiliary_inliers = by_auxiliary->inliers.size();
    ComparePoses(by_primary, primary.matches, *by_auxiliary, auxiliary.matches,
                 options().place_distance, judgement);
    if (WellKnown(judgement)) judgement.verdict = Verdict(judgement);
  }

  bool AsksBesides() const {
    return options().missing_observations || options().graph_support || options().rotation_loops;
  }

  /// What the auxiliary points leave open, by the first further evidence that tells.
  void JudgeBesides(ImageId image, const Rigid3& cam_from_model, Judgement& judgement) const {
    const auto decide = [&](bool agrees) {
      judgement.verdict = agrees ? ImageVerdict::kConsistent : ImageVerdict::kRefused;
    };
    if (judgement.verdict != ImageVerdict::kUndecided) return;
    if (options().missing_observations) {
      judgement.expected = model_.ExpectedAt(image, cam_from_model);
      if (judgement.expected.all >= kMinExpectedPoints && !met_shares_.empty()) {
        return decide(Share(judgement.expected) >= options().min_met_ratio * Median(met_shares_));
      }
    }
    if (options().graph_support) {
      judgement.graph_share =
          PairShare(image, [](const SegmentNeighbour& n) { return !n.contradicts_graph; });
      if (judgement.graph_share) return decide(*judgement.graph_share >= 0.5);
    }
    if (options().rotation_loops) {
      judgement.loop_share = PairShare(image, [&](const SegmentNeighbour& n) {
        const Eigen::Quaterniond by_pair = n.own_from_neighbour * model_.PoseOf(n.image).rotation;
        return RotationAngle_rad(by_pair, cam_from_model.rotation) <= kLoopAgrees_rad;
      });
      if (judgement.loop_share) decide(*judgement.loop_share >= 0.5);
    }
  }

  static double Share(const ExpectedPoints& expected) {
    return static_cast<double>(expected.met) / static_cast<double>(expected.all);
  }

  /// Weight of the pairs with registered images that agree, over that of all; nullopt: too few.
  template <typename Agrees>
  std::optional<double> PairShare(ImageId image, const Agrees& agrees) const {
    double agreeing = 0, all = 0;
    size_t pairs = 0;
    for (const SegmentNeighbour& n : case_.model_input.neighbours[image.index()]) {
      if (!model_.IsRegistered(n.image)) continue;
      all += n.weight;
      if (agrees(n)) agreeing += n.weight;
      ++pairs;
    }
    return pairs >= kMinPairs ? std::optional(agreeing / all) : std::nullopt;
  }

  bool WellKnown(const Judgement& judgement) const {
    const double share = options().max_sigma_share;
    if (std::isinf(share)) return true;
    return judgement.rotation_sigma_rad < share * options().max_rotation_rad &&
           judgement.place_sigma_rad < share * options().max_place_rad;
  }

  ImageVerdict Verdict(const Judgement& judgement) const {
    const bool apart = *judgement.rotation_rad > options().max_rotation_rad ||
                       *judgement.place_rad > options().max_place_rad;
    return apart ? ImageVerdict::kInconsistent : ImageVerdict::kConsistent;
  }

  const Case& case_;
  SegmentModel& model_;
  const std::vector<size_t>& images_;       // that wait, ascending
  std::map<size_t, Judgement> judgements_;  // by image
  std::map<size_t, Counts> counts_;         // by image, where they still hold
  std::vector<double> met_shares_;          // of the images registered so far
};

size_t PrimaryMatches(const Case& c, const ImagePair& pair) {
  for (const SegmentNeighbour& n : c.model_input.neighbours[pair.first.index()]) {
    if (n.image != pair.second) continue;
    return static_cast<size_t>(
        std::count_if(n.matches.begin(), n.matches.end(),
                      [](const SegmentMatch& m) { return m.kind == PointKind::kPrimary; }));
  }
  return 0;
}

/// Pairs that a pass may begin with, in the order of trial: heaviest first, those with the full
/// angle before the others.
std::vector<std::pair<const TwoView*, double>> InitialPairs(const Case& c) {
  std::vector<std::pair<const TwoView*, double>> pairs;  // and the angle asked for
  const IncrementalInput& input = c.scene.input;
  const std::vector<size_t> order = EdgesByWeight(input.view_graph);
  double above_rad = std::numeric_limits<double>::infinity();
  for (int level = 0; level < kInitialRelaxations; ++level) {
    const double angle_rad = std::pow(0.5, level) * c.scene.options.min_initial_angle_rad;
    for (const size_t place : order) {
      const ViewGraphEdge& edge = input.view_graph.edges[place];
      const auto [a, b] = std::pair(edge.pair.first.index(), edge.pair.second.index());
      const TwoView& view = input.two_views.pairs[edge.two_view];
      if (!c.waiting[a] || !c.waiting[b] || !(c.may_start[a] || c.may_start[b])) continue;
      if (view.median_angle_rad < angle_rad || view.median_angle_rad >= above_rad) continue;
      if (PrimaryMatches(c, edge.pair) < c.scene.options.min_initial_points) continue;
      pairs.emplace_back(&view, angle_rad);
    }
    above_rad = angle_rad;
  }
  pairs.resize(std::min(pairs.size(), kMaxInitialPairs));
  return pairs;
}

/// Whether the image was compared with the pass, or could not be for want of auxiliary points.
bool Tells(const Judgement& judgement) {
  return judgement.verdict == ImageVerdict::kInconsistent ||
         judgement.verdict == ImageVerdict::kUndecided ||
         judgement.verdict == ImageVerdict::kRefused;
}

/// Runs one pass on the images that wait; false when no pair begins it. `unsettled`: the last
/// telling judgements, else the first, of passes that gave no subset, by image.
bool RunPass(Case& c, SegmentCorrection& result, std::map<size_t, Judgement>& unsettled) {
  const CorrectionOptions& options = c.scene.options;
  std::vector<size_t> images;
  for (size_t i = 0; i < c.waiting.size(); ++i) {
    if (c.waiting[i]) images.push_back(i);
  }
  for (const auto& [pair, angle_rad] : InitialPairs(c)) {
    SegmentModel model(c.model_input, options.model, c.context);
    // Adjustment may take some of the angle away.
    if (!model.Initialize(*pair, options.min_initial_points, 0.5 * angle_rad).ok()) continue;
    Pass pass(c, model, images);
    pass.Run();
    std::vector<ImageId> subset = model.RegisteredImages();
    if (subset.size() < options.min_subset_images) {
      for (const ImageId image : subset) c.may_start[image.index()] = false;
      for (const auto& [image, judgement] : pass.judgements()) {
        if (Tells(judgement)) unsettled[image] = judgement;
        unsettled.emplace(image, judgement);
      }
      return true;
    }
    for (auto [image, judgement] : pass.judgements()) {
      judgement.pass = result.subsets.size();
      result.judgements.push_back(judgement);
    }
    std::sort(subset.begin(), subset.end());
    for (const ImageId image : subset) c.waiting[image.index()] = false;
    result.subsets.push_back(std::move(subset));
    return true;
  }
  return false;
}

SegmentCorrection CorrectSegment(const Scene& scene, uint32_t segment, const RunContext& outer) {
  RunContext context{outer.threads, outer.stop, nullptr, DeriveSeed(outer.seed, segment)};
  const size_t images = scene.input.features.images.size();
  Case c = {scene,
            context,
            segment,
            ModelInput(scene, segment),
            std::vector<bool>(images, false),
            std::vector<bool>(images, true)};
  const std::vector<ImageId>& related = scene.segments.segments[segment].images;
  for (const ImageId image : related) c.waiting[image.index()] = true;
  SegmentCorrection result;
  result.segment = segment;
  std::map<size_t, Judgement> unsettled;
  while (!context.Stopped() && RunPass(c, result, unsettled)) {
  }
  for (const ImageId image : related) {
    if (!c.waiting[image.index()]) continue;
    result.left_out.push_back(image);
    const auto last = unsettled.find(image.index());
    if (last == unsettled.end()) continue;
    last->second.pass = result.subsets.size();
    result.judgements.push_back(last->second);
  }
  return result;
}

/// Parts of all segments, and the part of every keypoint.
void NameParts(const Scene& scene, Correction& result) {
  const size_t images = scene.labels.size();
  // By segment and image; of distinct segments one part for all images.
  std::vector<std::vector<Label>> part_of(scene.segments.segments.size(),
                                          std::vector<Label>(images));
  size_t corrected = 0;
  for (uint32_t s = 0; s < part_of.size(); ++s) {
    const Segment& segment = scene.segments.segments[s];
    if (!segment.ambiguous) {
      part_of[s].assign(images, static_cast<uint32_t>(result.parts.size()));
      result.parts.push_back({s, segment.images});
      continue;
    }
    for (const std::vector<ImageId>& subset : result.segments[corrected++].subsets) {
      for (const ImageId image : subset) {
        part_of[s][image.index()] = static_cast<uint32_t>(result.parts.size());
      }
      result.parts.push_back({s, subset});
    }
  }
  result.part_of_keypoint.resize(images);
  for (size_t i = 0; i < images; ++i) {
    for (const Label& label : scene.labels[i]) {
      result.part_of_keypoint[i].push_back(label ? part_of[*label][i] : std::nullopt);
    }
  }
}

double AngleBetween_rad(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

}  // namespace

Status CorrectionOptions::Validate() const {
  const auto above_zero = [](const char* field, double value) -> Status {
    if (value > 0) return {};
    return Error{ErrorCode::kInvalidArgument, std::to_string(value) + " found, expected > 0",
                 field};
  };
  const auto at_least = [](const char* field, size_t value, size_t least) -> Status {
    if (value >= least) return {};
    return Error{ErrorCode::kInvalidArgument,
                 std::to_string(value) + " found, expected >= " + std::to_string(least), field};
  };
  ROTUNDA_RETURN_IF_ERROR(above_zero("max_rotation_rad", max_rotation_rad));
  ROTUNDA_RETURN_IF_ERROR(above_zero("max_place_rad", max_place_rad));
  ROTUNDA_RETURN_IF_ERROR(above_zero("max_sigma_share", max_sigma_share));
  ROTUNDA_RETURN_IF_ERROR(above_zero("min_met_ratio", min_met_ratio));
  ROTUNDA_RETURN_IF_ERROR(above_zero("max_expected_angle_rad", model.max_expected_angle_rad));
  ROTUNDA_RETURN_IF_ERROR(above_zero("min_initial_angle_rad", min_initial_angle_rad));
  ROTUNDA_RETURN_IF_ERROR(above_zero("max_reprojection_px", model.max_reprojection_px));
  ROTUNDA_RETURN_IF_ERROR(above_zero("max_pnp_error_px", model.max_pnp_error_px));
  ROTUNDA_RETURN_IF_ERROR(
      above_zero("min_triangulation_angle_rad", model.min_triangulation_angle_rad));
  // Four points give a pose of three and one that confirms it.
  ROTUNDA_RETURN_IF_ERROR(at_least("min_auxiliary_inliers", min_auxiliary_inliers, 4));
  ROTUNDA_RETURN_IF_ERROR(at_least("min_primary_inliers", min_primary_inliers, 4));
  ROTUNDA_RETURN_IF_ERROR(at_least("min_initial_points", min_initial_points, 4));
  ROTUNDA_RETURN_IF_ERROR(at_least("min_subset_images", min_subset_images, 3));
  if (model.min_pnp_inlier_ratio >= 0 && model.min_pnp_inlier_ratio <= 1) return {};
  return Error{ErrorCode::kInvalidArgument,
               std::to_string(model.min_pnp_inlier_ratio) + " found, expected 0 to 1",
               "min_pnp_inlier_ratio"};
}

double CenterAngle_rad(const Rigid3& a, const Rigid3& b, const Eigen::Vector3d& from) {
  return AngleBetween_rad(a.OriginInSource() - from, b.OriginInSource() - from);
}

double TranslationAngle_rad(const Rigid3& a, const Rigid3& b) {
  return AngleBetween_rad(a.translation, b.translation);
}

Result<Correction> BuildCorrection(const IncrementalInput& input, const Segments& segments,
                                   const CorrectionOptions& options, RunContext& context,
                                   const std::set<ImagePair>& rejected) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  const Scene scene = {input,
                       segments,
                       options,
                       SegmentLabels(input.tracks, segments, options.labels_by_track),
                       NormalizedKeypoints(input, context),
                       rejected};
  std::vector<uint32_t> ambiguous;
  for (uint32_t s = 0; s < segments.segments.size(); ++s) {
    if (segments.segments[s].ambiguous) ambiguous.push_back(s);
  }
  Correction result;
  result.segments.resize(ambiguous.size());
  std::atomic<size_t> done = 0;
  context.threads.ParallelFor(
      ambiguous.size(),
      [&](size_t i) {
        result.segments[i] = CorrectSegment(scene, ambiguous[i], context);
        context.Report(kStage, ++done, ambiguous.size());
      },
      context.stop);
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "cancelled", kStage};
  NameParts(scene, result);
  return result;
}

}  // namespace rotunda::sfm
