#pragma once

#include <cstdint>
#include <vector>

#include "sfm/core/run_context.h"
#include "sfm/incremental.h"

namespace rotunda::test {

/// A body of points inside a ring of cameras that look at it, projected straight to features.
struct SyntheticOptions {
  size_t columns = 12;  // cameras around the body
  size_t rows = 2;      // cameras above each other
  size_t points = 600;  // on the body's surface
  double radius_m = 1.7;
  double focal_px = 1840.0;
  CameraModel model = CameraModel::kOpencv;
  bool shared_lens = false;  // one lens for all cameras, else one each
  double noise_px = 0.5;  // standard deviation of a keypoint of scale kKeypointScale_px, per axis
  double wrong_match_share = 0.0;    // of each pair's matches, to a random other keypoint
  double max_view_angle_deg = 70.0;  // between the surface normal and the ray, to be seen
  double detection_share = 0.8;      // of the visible points, found in a picture
  uint64_t seed = 1;
};

inline constexpr float kKeypointScale_px = 1.0f;  // as most of a capture are

/// Truth, and what the front end would have made of it. All cameras have 1200 x 1600 pixels and
/// the noise of keypoints is in the ratio of KeypointSigma_px.
struct SyntheticWorld {
  std::vector<Rigid3> cam_from_world;                  // metres
  std::vector<Eigen::Vector3d> points;                 // metres
  std::vector<std::vector<size_t>> point_of_keypoint;  // by image and keypoint
  sfm::Features features;                              // positions only
  sfm::Intrinsics intrinsics;                          // true
  sfm::TwoViews two_views;  // true relative poses, matches with mismatches
  sfm::ViewGraph view_graph;
  sfm::Tracks tracks;

  sfm::IncrementalInput Input() const {
    return {features, intrinsics, two_views, view_graph, tracks};
  }
};

SyntheticWorld MakeSyntheticWorld(const SyntheticOptions& options);

/// Takes all matches between images of `first` and the others out, and builds the view graph and
/// the tracks anew.
void Disconnect(SyntheticWorld& world, const std::vector<ImageId>& first);

/// The truth as a reconstruction: every point seen twice or more with all its observations.
sfm::Reconstruction TrueReconstruction(const SyntheticWorld& world);

/// Normal deviates by Box-Muller: the same on every standard library.
class NormalRandom {
 public:
  explicit NormalRandom(uint64_t seed) : state_(seed) {}
  double Uniform();  // [0, 1)
  double Normal();   // mean 0, standard deviation 1
  size_t Index(size_t count) { return static_cast<size_t>(Uniform() * static_cast<double>(count)); }

 private:
  uint64_t state_;
  uint64_t draws_ = 0;
};

}  // namespace rotunda::test
