#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <span>
#include <vector>

#include "sfm/absolute_pose.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"
#include "sfm/incremental.h"
#include "sfm/reconstruction.h"

namespace rotunda::sfm {

/// Points of the segment in question, and points of distinct segments that it is checked against.
enum class PointKind : uint8_t { kPrimary, kAuxiliary };

struct SegmentMatch {
  KeypointId own;
  KeypointId other;
  PointKind kind = PointKind::kPrimary;
};

/// What an image has in common with another one.
struct SegmentNeighbour {
  ImageId image;
  double weight = 0;                                                       // in the view graph
  Eigen::Quaterniond own_from_neighbour = Eigen::Quaterniond::Identity();  // by the pair alone
  bool contradicts_graph = false;                                          // EdgeVerdict::kRejected
  std::vector<SegmentMatch> matches;
};

/// What the models of one segment are built from; borrowed.
struct SegmentModelInput {
  const IncrementalInput& input;
  /// By ImageId and KeypointId: x/z, y/z without distortion; NaN where the lens gives none.
  const std::vector<std::vector<Eigen::Vector2d>>& normalized;
  std::vector<std::vector<SegmentNeighbour>> neighbours;  // by ImageId
};

struct SegmentModelOptions {
  double max_reprojection_px = 4.0;
  double min_triangulation_angle_rad = RadFromDeg(1.5);
  double max_pnp_error_px = 12.0;
  double min_pnp_inlier_ratio = 0.25;
  /// Points that so many images see, one of them from within this angle, must be seen again.
  double max_expected_angle_rad = RadFromDeg(30.0);
  size_t min_expected_images = 3;
};

/// Points of one kind that an image sees according to its matches with registered images.
struct Support {
  AbsolutePoseInput matches;
  std::vector<KeypointId> keypoints;  // parallel to matches.points
  std::vector<size_t> points;         // likewise: places in the model
  size_t size() const { return points.size(); }
};

/// Points of both kinds that an image must see where a pose has it, and those of them that its
/// matches with registered images name.
struct ExpectedPoints {
  size_t all = 0;
  size_t met = 0;
};

/// A small model that images are added to one by one, each by a pose that the caller has judged.
/// Keypoints find points through the matches with registered images alone, never through images
/// that have not been judged yet, as tracks would.
class SegmentModel {
 public:
  /// All arguments are borrowed.
  SegmentModel(const SegmentModelInput& input, const SegmentModelOptions& options,
               RunContext& context);

  /// The first image at the origin, the second at the pair's relative pose. kFailed: fewer than
  /// `min_points` points or a median angle below `min_angle_rad` hold after adjustment.
  Status Initialize(const TwoView& pair, size_t min_points, double min_angle_rad);

  /// Of several points that the matches of a keypoint name, the one named most often.
  Support SupportOf(ImageId image, PointKind kind) const;
  /// kFailed: fewer than `min_inliers`, or than the share that is asked for, fit one pose.
  Result<AbsolutePose> EstimatePose(const Support& support, size_t min_inliers,
                                    uint64_t seed) const;
  ExpectedPoints ExpectedAt(ImageId image, const Rigid3& cam_from_model) const;
  /// The pose refined on all points near it, of both kinds.
  Rigid3 RefinedPose(ImageId image, const Rigid3& cam_from_model) const;

  /// Adds the image, its observations that fit and new points; adjusts all when the model has
  /// outgrown the last adjustment.
  void Register(ImageId image, const Rigid3& cam_from_model);

  const Rigid3& PoseOf(ImageId registered) const {
    return *model_.cam_from_model[registered.index()];
  }
  bool IsRegistered(ImageId image) const { return model_.Registered(image); }
  const std::vector<ImageId>& RegisteredImages() const { return registered_; }  // in order

 private:
  struct Sight {
    KeypointId own;
    Observation other;
    PointKind kind;
    auto operator<=>(const Sight&) const = default;
  };

  uint32_t& PointOf(const Observation& o) { return point_of_[o.image.index()][o.keypoint.index()]; }
  uint32_t PointOf(const Observation& o) const {
    return point_of_[o.image.index()][o.keypoint.index()];
  }
  double FocalOf(ImageId image) const { return model_.intrinsics.of(image).MeanFocal_px(); }
  const Eigen::Vector2d& RayOf(const Observation& o) const {
    return input_.normalized[o.image.index()][o.keypoint.index()];
  }
  double Error_px(const Observation& o, const Eigen::Vector3d& position) const;
  double Angle_rad(const Point3& point) const;
  bool MustBeSeen(const Point3& point, ImageId image, const Rigid3& cam_from_model) const;
  void Add(ImageId image, const Rigid3& cam_from_model);
  void Extend(ImageId image, PointKind kind);
  std::vector<Sight> FreeSights(ImageId image) const;
  void TriangulateNew(ImageId image);
  void TriangulatePoint(ImageId image, std::span<const Sight> sights);
  Status Adjust(const std::vector<ImageId>& free_images);
  void Filter();

  const SegmentModelInput& input_;
  const SegmentModelOptions& options_;
  RunContext& context_;
  Reconstruction model_;                         // a point that was taken out has no observations
  std::vector<std::vector<uint32_t>> point_of_;  // by ImageId and KeypointId
  std::vector<ImageId> registered_;
  size_t images_at_adjustment_ = 0;
};

}  // namespace rotunda::sfm
