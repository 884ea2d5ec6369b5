#pragma once

#include <optional>
#include <vector>

#include "sfm/absolute_pose.h"
#include "sfm/incremental.h"

namespace rotunda::sfm {

/// Where an image not yet registered stands.
struct ImageEstimate {
  Rigid3 cam_from_model;
  /// Mean focal length the pose holds for, where the lens is still open. Absolute, so that it means
  /// the same after another image has set the lens they share.
  std::optional<double> focal_px;
};

/// An image taken out of the model, and how many observations it still had.
struct WeakImage {
  ImageId image;
  size_t observations = 0;
};

/// One model while it grows: poses, points, and which track became which point. The steps of
/// incremental reconstruction as functions; their order is incremental.cc's business.
class ModelBuilder {
 public:
  /// `active` (by TrackId): the tracks it may use for now. All arguments are borrowed.
  ModelBuilder(const IncrementalInput& input, const IncrementalOptions& options,
               const std::vector<bool>& active, RunContext& context);

  /// Puts the first image at the origin and the second at the pair's relative pose, triangulates
  /// what both see and adjusts. kFailed when too little of it holds: fewer than `min_points`
  /// points, less than half of the pair's tracks, or a median angle below `min_angle_rad`.
  Status Initialize(const TwoView& pair, size_t min_points, double min_angle_rad);

  /// Takes over poses and lenses of a model, but none of its points. The builder must be empty.
  void Adopt(const Reconstruction& model);

  /// Points of the model that have a keypoint in `image`.
  size_t VisiblePoints(ImageId image) const { return visible_[image.index()]; }
  size_t Registered() const { return registered_.size(); }
  const std::vector<ImageId>& RegisteredImages() const { return registered_; }
  bool IsRegistered(ImageId image) const { return model_.Registered(image); }
  size_t PointCount() const { return live_points_; }
  size_t ObservationCount() const;
  /// Standard deviation of the weighted residuals from their median, per axis, in units of
  /// KeypointSigma_px; at least 0.01, which only exact keypoints are below.
  double RobustSigma() const;

  /// Pose of an unregistered image; kFailed says what was lacking. Safe to call side by side.
  Result<ImageEstimate> EstimatePose(ImageId image, size_t min_inliers) const;
  /// Adds the image; its lens takes the estimate's focal length, if it has one.
  void Register(ImageId image, const ImageEstimate& estimate);
  /// Takes out images with fewer than `min_observations`, their observations and the points that
  /// these leave undetermined, until every image left has enough.
  std::vector<WeakImage> UnregisterWeak(size_t min_observations);

  /// For tracks seen in `images`: adds fitting observations to points and triangulates new ones.
  void TriangulateFor(const std::vector<ImageId>& images);
  /// The same for all registered images; points that only a minority of their track's registered
  /// keypoints agree with are triangulated afresh.
  void TriangulateAll();
  /// From now on all tracks may be used.
  void UseAllTracks();

  /// Adjusts `images`, the registered images that share most points with them, and what they see.
  Status AdjustLocally(const std::vector<ImageId>& images);
  Status AdjustGlobally(const BundleAdjustmentOptions& options);

  /// Takes out observations whose error is above `max_error_px` or above `max_sigmas` robust
  /// standard deviations, then points with too small an angle. Returns how many observations went.
  size_t Filter(double max_error_px, double max_sigmas);

  /// The model; the builder is empty afterwards.
  Reconstruction Take();

 private:
  struct ImageTrack {
    TrackId track;
    KeypointId keypoint;
  };

  double FocalOf(ImageId image) const;
  bool LensIsOpen(ImageId image) const;
  void NormalizeKeypoints(ImageId image);
  void AddRegistered(ImageId image, const Rigid3& cam_from_model);
  std::vector<Observation> UsableObservations(TrackId track) const;
  std::optional<Point3> TriangulateTrack(TrackId track) const;
  std::optional<Point3> ExtendedPoint(TrackId track, const Point3& point) const;
  double ObservationError_px(const Observation& observation, const Eigen::Vector3d& position) const;
  void TriangulateTracks(const std::vector<TrackId>& tracks, bool afresh);
  bool Determined(const Point3& point) const;
  std::vector<WeakImage> WeakImages(size_t min_observations) const;
  void Unregister(ImageId image);
  void SetFocal(size_t lens, double focal_px);
  void SetPoint(TrackId track, Point3 point);
  void RemovePoint(size_t point);
  void Compact();
  void NormalizeRefinedLenses();
  std::vector<ImageId> LocalImages(const std::vector<ImageId>& images) const;
  std::vector<double> FocalFactors(ImageId image) const;

  const IncrementalInput& input_;
  const IncrementalOptions& options_;
  RunContext& context_;
  std::vector<bool> active_;                              // by TrackId
  std::vector<std::vector<ImageTrack>> tracks_of_image_;  // by ImageId, all tracks
  std::vector<std::vector<Eigen::Vector2d>> normalized_;  // by ImageId and KeypointId; NaN: none
  Reconstruction model_;
  std::vector<TrackId> track_of_point_;  // parallel to model_.points
  std::vector<size_t> point_of_track_;   // by TrackId; kNoPoint
  std::vector<size_t> visible_;          // by ImageId
  std::vector<ImageId> registered_;      // in order of registration
  std::vector<bool> lens_refined_;       // by lens
  size_t live_points_ = 0;
};

}  // namespace rotunda::sfm
