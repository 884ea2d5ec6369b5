#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <set>
#include <vector>

#include "sfm/core/ids.h"
#include "sfm/core/result.h"
#include "sfm/core/rigid3.h"
#include "sfm/core/run_context.h"
#include "sfm/incremental.h"
#include "sfm/segment_model.h"
#include "sfm/segments.h"

namespace rotunda::sfm {

/// Which image of an ambiguous segment is judged next.
enum class NextImage {
  kStrongestLink,      // the heaviest edge to an image of the pass (Prim's order)
  kMostPrimaryPoints,  // the paper
};

/// How two poses differ in place.
enum class PlaceDistance {
  kCenterAngle,       // between the camera centres, seen from the primary points
  kTranslationAngle,  // between the world-to-camera translations (the paper): near 0 for all
                      // cameras of a ring in a frame whose origin lies inside it
};

struct CorrectionOptions {
  NextImage next = NextImage::kStrongestLink;
  PlaceDistance place_distance = PlaceDistance::kCenterAngle;
  /// Images that auxiliary points cannot place are taken for consistent (the paper); else they are
  /// left out of the pass until more auxiliary points are there.
  bool undecided_is_consistent = false;
  /// Before that, they are judged by the points that their pose by primary points says they must
  /// see: those that meet a smaller share of them than `min_met_ratio` x the median of the images
  /// registered so far are refused until they see more (after Zach et al., CVPR 2008). That tells
  /// only once an image was registered besides the initial pair. The paper does not.
  bool missing_observations = false;
  double min_met_ratio = 0.55;
  /// Where that does not tell, by the consistent view graph: refused when more of the weight of
  /// their pairs with registered images is of rejected edges. The paper does not.
  bool graph_support = false;
  /// And where that does not, by rotation loops: refused when more of that weight contradicts the
  /// pose's rotation than agrees with it (after Zach et al., CVPR 2010). The paper does not.
  bool rotation_loops = false;
  /// Keypoints of a track have the track's label; false: their own (the paper), so that tracks are
  /// cut where segments meet.
  bool labels_by_track = true;
  double max_rotation_rad = 0.15;  // epsilon_r
  double max_place_rad = 0.35;     // epsilon_t
  size_t min_auxiliary_inliers = 12;
  /// Predicted standard deviation of a difference, as a share of its threshold, from which the
  /// points are too badly spread to decide; infinite: never (the paper).
  double max_sigma_share = 1.0 / 3.0;
  size_t min_primary_inliers = 15;
  size_t min_initial_points = 30;
  double min_initial_angle_rad = RadFromDeg(8.0);  // relaxed to the half when no pair has it
  size_t min_subset_images = 3;                    // fewer are no subset
  SegmentModelOptions model;
  Status Validate() const;
};

enum class ImageVerdict {
  kInitial,       // of the pair that the pass began with
  kConsistent,    // registered
  kInconsistent,  // its matches of this segment with images of the pass are wrong
  kUndecided,     // the auxiliary points do not tell, and neither does what is asked besides
  kRefused,       // undecided by the auxiliary points, and what is asked besides speaks against it
  kUnplaced,      // its primary points are too few or fit no pose
};

/// What one pass found of one image. Poses that were not estimated have 0 inliers.
struct Judgement {
  ImageId image;
  size_t pass = 0;  // place in SegmentCorrection::subsets; their count for passes without one
  ImageVerdict verdict = ImageVerdict::kUnplaced;
  size_t primary_points = 0;
  size_t primary_inliers = 0;
  size_t auxiliary_points = 0;
  size_t auxiliary_inliers = 0;
  size_t images = 0;  // registered in the pass when it was judged
  /// Between the pose by primary and the pose by auxiliary points, where there are both, and the
  /// predicted standard deviations of these angles.
  std::optional<double> rotation_rad = std::nullopt;
  std::optional<double> place_rad = std::nullopt;
  double rotation_sigma_rad = 0;
  double place_sigma_rad = 0;
  /// Where it was asked: points that the pose by primary points says must be seen, and those that
  /// are; share of the weight of its pairs with registered images that is of edges the consistent
  /// view graph keeps, and that agrees with the pose's rotation.
  ExpectedPoints expected = {};
  std::optional<double> graph_share = std::nullopt;
  std::optional<double> loop_share = std::nullopt;
};

/// An ambiguous segment taken apart.
struct SegmentCorrection {
  uint32_t segment = 0;
  std::vector<std::vector<ImageId>> subsets;  // that see one thing each; sorted, disjoint
  /// Of every pass with a subset, by pass and image; then, of images in no subset, what the last of
  /// the other passes found.
  std::vector<Judgement> judgements;
  std::vector<ImageId> left_out;  // related to the segment, in no subset; sorted
};

/// A segment, or what one consistent subset sees of it: one thing of the world.
struct ScenePart {
  uint32_t segment = 0;
  std::vector<ImageId> images;  // sorted
};

struct Correction {
  std::vector<SegmentCorrection> segments;  // the ambiguous ones, by segment
  std::vector<ScenePart> parts;             // by segment, then subset
  /// By ImageId and KeypointId. Keypoints of different parts, or of none, must not be joined:
  /// matches of an ambiguous segment count only within one of its subsets.
  std::vector<std::vector<std::optional<uint32_t>>> part_of_keypoint;
};

/// Angle between camera centres, seen from a point of the model.
double CenterAngle_rad(const Rigid3& a, const Rigid3& b, const Eigen::Vector3d& from);
/// Angle between the translations of two cam_from_model; 0 when one of them is 0.
double TranslationAngle_rad(const Rigid3& a, const Rigid3& b);

/// TC-SfM III-C. For every ambiguous segment a model is grown from its strongest pair. An image
/// joins it when its pose by points of this segment (primary) and its pose by points of distinct
/// segments (auxiliary) agree; the others begin the next pass, until none is left or no pair
/// starts. Only edges of `input.view_graph` count; `rejected`: pairs that contradict the consistent
/// view graph, for CorrectionOptions::graph_support. kCancelled is the only failure besides options
/// out of range.
Result<Correction> BuildCorrection(const IncrementalInput& input, const Segments& segments,
                                   const CorrectionOptions& options, RunContext& context,
                                   const std::set<ImagePair>& rejected = {});

}  // namespace rotunda::sfm
