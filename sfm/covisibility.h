#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "sfm/core/ids.h"
#include "sfm/core/result.h"
#include "sfm/core/rigid3.h"
#include "sfm/core/run_context.h"
#include "sfm/features.h"
#include "sfm/reconstruction.h"
#include "sfm/two_view.h"
#include "sfm/view_graph.h"

namespace rotunda::sfm {

/// How often what one image sees of a region is found in another image that must see it too.
struct PairCount {
  ImagePair pair;
  uint32_t expected = 0;
  uint32_t met = 0;
};

/// Points of a model that lie together.
struct RegionCovisibility {
  std::vector<PairCount> pairs;  // sorted by pair
  /// Independent trials / sum of `expected`: a point that an image should see is counted once for
  /// each of the point's observers near by.
  double independence = 1;
};

struct Covisibility {
  size_t images = 0;
  std::vector<RegionCovisibility> regions;
};

/// Share of the points that an image must meet that it does meet, of what it really sees (measured
/// 0.70 to 0.83 over all regions of rendered captures; across a fold 0.00 to 0.10 of what is not
/// alike), and the ratio to it below which a region counts as missed.
inline constexpr double kMetShare = 0.7;
inline constexpr double kMissedRatio = 0.25;
/// Share met of what an image does not see: chance matches.
inline constexpr double kMetByChance = 0.04;

struct CovisibilityOptions {
  size_t min_points_per_region = 15;
  size_t max_regions = 1024;
  /// Observers and an image that see a point from directions farther apart say nothing.
  double max_view_angle_rad = RadFromDeg(30.0);
  /// An image is enclosed by two observers of a point when the angles from it to them sum up to at
  /// most this many times the angle between them.
  double enclosure = 1.15;
  /// Of the larger side: points that project nearer to the border may be out of the picture.
  double border_share = 0.02;
  bool obstacles = true;  // points may hide others
  /// A point is hidden when another, nearer by this share of the depth, projects within about one
  /// cell (a share of the larger side) of it.
  double obstacle_cell_share = 0.02;
  double obstacle_depth_share = 0.06;
  Status Validate() const;
};

/// Of the points that an image should meet, how many it does.
struct MeetingCount {
  uint32_t expected = 0;
  uint32_t met = 0;
  uint32_t in_place = 0;  // of those met, by a keypoint that lies where the pose has the point
};

/// What one model and the verified matches say of its images, region by region. An image is
/// expected to meet a point when the point projects into it and two observers of the point enclose
/// the image, so that it is not turned away, and no other point hides it. It is met when a verified
/// match joins the image with an observer's keypoint of the point. In a right model about
/// kMetShare are met in every region, whatever the garment; where a model lays look-alike things
/// over each other, what tells them apart is met by the images of one and by almost none of the
/// other.
class CovisibilityCounter {
 public:
  /// Borrows all but `options`. `graph`: the edges of `two_views` whose matches count.
  CovisibilityCounter(const Reconstruction& model, const Features& features,
                      const TwoViews& two_views, const ViewGraph& graph,
                      const CovisibilityOptions& options);
  ~CovisibilityCounter();

  /// Every pair of images of the model.
  Covisibility CountAll(RunContext& context) const;
  /// By region: what `image` would meet if it stood elsewhere; its own observations do not count.
  /// In place: at most `max_error_px` off.
  std::vector<MeetingCount> CountAt(ImageId image, const Rigid3& cam_from_model,
                                    double max_error_px) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace rotunda::sfm
