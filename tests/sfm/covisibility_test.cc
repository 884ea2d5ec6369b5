#include "sfm/covisibility.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

using test::MakeSyntheticWorld;
using test::SyntheticOptions;
using test::SyntheticWorld;
using test::TrueReconstruction;

constexpr int kSide_px = 1000;
constexpr double kDistance_m = 2.0;

/// A camera on a circle about the z axis that looks at the origin.
Rigid3 PoseAt(double azimuth_deg) {
  const double azimuth = RadFromDeg(azimuth_deg);
  const Eigen::Vector3d out(std::cos(azimuth), std::sin(azimuth), 0);
  Eigen::Matrix3d cam_from_world;
  cam_from_world << Eigen::Vector3d::UnitZ().cross(-out).transpose(), Eigen::RowVector3d(0, 0, -1),
      -out.transpose();
  cam_from_world.row(0) = cam_from_world.row(1).cross(cam_from_world.row(2));
  const Eigen::Quaterniond rotation(cam_from_world);
  return {rotation, -(rotation * (kDistance_m * out))};
}

/// Cameras, points and matches by hand; all pairs have their edge.
struct HandMade {
  Reconstruction model;
  Features features;
  TwoViews two_views;

  explicit HandMade(const std::vector<double>& azimuths_deg) {
    for (const double azimuth_deg : azimuths_deg) {
      model.cam_from_model.push_back(PoseAt(azimuth_deg));
      model.intrinsics.lens_of_image.push_back(model.intrinsics.lenses.size());
      model.intrinsics.lenses.push_back({CameraModel::kSimplePinhole,
                                         kSide_px,
                                         kSide_px,
                                         {1000.0, 0.5 * kSide_px, 0.5 * kSide_px}});
      features.images.push_back({kSide_px, kSide_px, {}, {}, {}});
    }
  }
  KeypointId AddKeypoint(size_t image) {
    features.images[image].keypoints.push_back({0, 0, 1, 0});
    return KeypointId(features.images[image].keypoints.size() - 1);
  }
  void AddPoint(const Eigen::Vector3d& position, const std::vector<size_t>& observers) {
    Point3 point;
    point.position = position;
    for (const size_t image : observers) {
      point.observations.push_back({ImageId(image), AddKeypoint(image)});
    }
    model.points.push_back(point);
  }
  /// Joins the keypoint of the point's observation k with a keypoint of `image` (the one that
  /// observes the point, if it does).
  void Join(size_t point, size_t k, size_t image) {
    const Observation from = model.points[point].observations[k];
    Observation to{ImageId(image), {}};
    for (const Observation& o : model.points[point].observations) {
      if (o.image == to.image) to = o;
    }
    if (to.keypoint == KeypointId()) to.keypoint = AddKeypoint(image);
    TwoView view;
    view.pair = {std::min(from.image, to.image), std::max(from.image, to.image)};
    view.inliers = {from.image < to.image ? Match{from.keypoint, to.keypoint}
                                          : Match{to.keypoint, from.keypoint}};
    two_views.pairs.push_back(view);
  }
  ViewGraph Graph() const { return BuildViewGraph(features, two_views); }
};

/// One region of everything.
CovisibilityOptions OneRegion() { return {.min_points_per_region = 1000000}; }

struct Counted {
  std::vector<std::array<size_t, 4>> pairs;  // first, second, expected, met
  double independence = 1;
};
bool operator==(const Counted& a, const Counted& b) {
  return a.pairs == b.pairs && a.independence == b.independence;
}
void PrintTo(const Counted& counted, std::ostream* out) {
  for (const auto& [i, j, expected, met] : counted.pairs) {
    *out << i << "-" << j << ": " << met << " of " << expected << ", ";
  }
  *out << "independence " << counted.independence;
}

Counted Count(const HandMade& scene, const CovisibilityOptions& options = OneRegion()) {
  ThreadPool threads(1);
  RunContext context{threads};
  const CovisibilityCounter counter(scene.model, scene.features, scene.two_views, scene.Graph(),
                                    options);
  const Covisibility covisibility = counter.CountAll(context);
  EXPECT_EQ(covisibility.images, scene.features.images.size());
  EXPECT_EQ(covisibility.regions.size(), 1u);
  Counted counted{{}, covisibility.regions[0].independence};
  for (const PairCount& pair : covisibility.regions[0].pairs) {
    counted.pairs.push_back(
        {pair.pair.first.index(), pair.pair.second.index(), pair.expected, pair.met});
  }
  return counted;
}

const Counted kNothing{{}, 1};
const Counted kMissed{{{0, 1, 1, 0}, {1, 2, 1, 0}}, 0.5};
const Counted kMet{{{0, 1, 1, 1}, {1, 2, 1, 1}}, 0.5};

/// The origin is observed from -10, +10 and +45 degrees; image 1 stands between the first two, and
/// none of them between two others that are near.
HandMade Enclosed() {
  HandMade scene({-10, 0, 10, 45});
  scene.AddPoint({0, 0, 0}, {0, 2, 3});
  return scene;
}

TEST(Covisibility, AnEnclosedImageIsExpectedToMeetThePoint) {
  EXPECT_EQ(Count(Enclosed()), kMissed);
  HandMade joined = Enclosed();
  joined.Join(0, 1, 1);
  EXPECT_EQ(Count(joined), kMet);
  HandMade afar = Enclosed();
  afar.Join(0, 2, 1);  // with the keypoint of the observer at 45 degrees
  EXPECT_EQ(Count(afar), kMissed);
  HandMade elsewhere = Enclosed();
  elsewhere.Join(0, 0, 2);  // of other images
  EXPECT_EQ(Count(elsewhere), kMissed);
}

TEST(Covisibility, OnlyMatchesOfTheGraphsEdgesCount) {
  HandMade scene = Enclosed();
  scene.Join(0, 1, 1);
  const ViewGraph none{4, {}};
  ThreadPool threads(1);
  RunContext context{threads};
  const CovisibilityCounter counter(scene.model, scene.features, scene.two_views, none,
                                    OneRegion());
  const Covisibility covisibility = counter.CountAll(context);
  ASSERT_EQ(covisibility.regions.at(0).pairs.size(), 2u);
  for (const PairCount& pair : covisibility.regions[0].pairs) {
    EXPECT_EQ(pair.expected, 1u);
    EXPECT_EQ(pair.met, 0u);
  }
}

TEST(Covisibility, AnImageBesideTheObserversIsNotExpectedToMeetThePoint) {
  HandMade beside({-10, 20, 10, 60});
  beside.AddPoint({0, 0, 0}, {0, 2, 3});
  EXPECT_EQ(Count(beside), kNothing);
  HandMade far_between({-35, 0, 35, 90});  // enclosed, but by observers more than 30 degrees away
  far_between.AddPoint({0, 0, 0}, {0, 2, 3});
  EXPECT_EQ(Count(far_between), kNothing);
}

TEST(Covisibility, APointOfTwoObserversSaysNothing) {
  HandMade scene({-10, 0, 10});
  scene.AddPoint({0, 0, 0}, {0, 2});
  ThreadPool threads(1);
  RunContext context{threads};
  const CovisibilityCounter counter(scene.model, scene.features, scene.two_views, scene.Graph(),
                                    OneRegion());
  EXPECT_TRUE(counter.CountAll(context).regions.empty());
}

TEST(Covisibility, WhatProjectsToTheBorderOrOutsideIsNotExpected) {
  const auto at_px = [](double x_px) {
    HandMade scene = Enclosed();
    scene.model.intrinsics.lenses[1].params[1] = x_px;
    return Count(scene);
  };
  EXPECT_EQ(at_px(21), kMissed);  // 2 % of 1000 px
  EXPECT_EQ(at_px(19), kNothing);
  EXPECT_EQ(at_px(979), kMissed);
  EXPECT_EQ(at_px(981), kNothing);
  EXPECT_EQ(at_px(-200), kNothing);
  HandMade behind = Enclosed();
  const Rigid3 turned{Eigen::Quaterniond(Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitY())),
                      Eigen::Vector3d::Zero()};
  behind.model.cam_from_model[1] = turned * *behind.model.cam_from_model[1];
  EXPECT_EQ(Count(behind), kNothing);
}

TEST(Covisibility, ANearerPointHides) {
  // The obstacle is seen by cameras on the other side, none of them between two.
  const auto with_obstacle = [](const Eigen::Vector3d& position) {
    HandMade scene({-10, 0, 10, 45, 120, 180, 240});
    scene.AddPoint({0, 0, 0}, {0, 2, 3});
    scene.AddPoint(position, {4, 5, 6});
    return scene;
  };
  const HandMade hidden = with_obstacle({0.3, 0, 0});  // on image 1's ray, nearer by 15 %
  EXPECT_EQ(Count(hidden), kNothing);
  CovisibilityOptions no_obstacles = OneRegion();
  no_obstacles.obstacles = false;
  EXPECT_EQ(Count(hidden, no_obstacles), kMissed);
  EXPECT_EQ(Count(with_obstacle({0.1, 0, 0})), kMissed) << "nearer by 5 %, less than 6 %";
  EXPECT_EQ(Count(with_obstacle({-0.3, 0, 0})), kMissed) << "behind";
  EXPECT_EQ(Count(with_obstacle({0.3, 0, 0.1})), kMissed) << "59 px aside";
  EXPECT_EQ(Count(with_obstacle({0.3, 0, 0.025})), kNothing) << "15 px aside, one cell is 20 px";
}

TEST(Covisibility, IndependenceCountsAPointOnceForAllItsObservers) {
  // Every trial of image 1 is counted with the image at -20 and with the one at +20 degrees.
  HandMade scene({-20, 0, 20});
  scene.AddPoint({0, 0, 0}, {0, 1, 2});
  scene.Join(0, 0, 1);
  const Counted counted = Count(scene);
  EXPECT_EQ(counted, kMet);
  HandMade two = scene;
  two.AddPoint({0, 0, 0.1}, {0, 1, 2});
  EXPECT_EQ(Count(two), (Counted{{{0, 1, 2, 1}, {1, 2, 2, 1}}, 0.5}));
}

TEST(Covisibility, CountAtIgnoresTheImagesOwnObservations) {
  // Image 1 stands at 90 degrees and observes both points.
  HandMade scene({-10, 90, 10, 60});
  scene.AddPoint({0, 0, 0}, {0, 1, 2});
  scene.AddPoint({0, 0, 0.1}, {1, 2, 3});
  const auto at = [&](double azimuth_deg) {
    const CovisibilityCounter counter(scene.model, scene.features, scene.two_views, scene.Graph(),
                                      OneRegion());
    return counter.CountAt(ImageId(1), PoseAt(azimuth_deg), 12).at(0);
  };
  EXPECT_EQ(at(0).expected, 1u) << "enclosed by 0 and 2 for the first point alone";
  EXPECT_EQ(at(0).met, 0u);
  EXPECT_EQ(at(35).expected, 1u) << "enclosed by 2 and 3 for the second point alone";
  EXPECT_EQ(at(90).expected, 0u) << "its own observations there are nothing to be met";
  scene.Join(0, 2, 1);
  EXPECT_EQ(at(0).met, 1u);
  EXPECT_EQ(at(35).met, 0u);
}

TEST(Covisibility, WhatIsMetElsewhereInThePictureIsNotInPlace) {
  // Image 1 stands at 0 degrees, where the point projects to the middle of its picture.
  HandMade scene({-10, 0, 10, 60});
  scene.AddPoint({0, 0, 0}, {0, 2, 3});
  scene.Join(0, 1, 1);
  const auto met_at = [&](float x_px) {
    scene.features.images[1].keypoints[0] = {x_px, 0.5f * kSide_px, 1, 0};
    const CovisibilityCounter counter(scene.model, scene.features, scene.two_views, scene.Graph(),
                                      OneRegion());
    return counter.CountAt(ImageId(1), PoseAt(0), 12).at(0);
  };
  for (const float x_px : {489.0f, 500.0f, 511.0f}) {
    EXPECT_EQ(met_at(x_px).met, 1u) << x_px;
    EXPECT_EQ(met_at(x_px).in_place, 1u) << x_px;
  }
  for (const float x_px : {10.0f, 487.0f, 513.0f}) {
    EXPECT_EQ(met_at(x_px).met, 1u) << x_px;
    EXPECT_EQ(met_at(x_px).in_place, 0u) << x_px;
  }
}

/// Sums over regions and pairs, each trial once.
std::pair<double, double> TrialsAndMet(const Covisibility& covisibility) {
  double trials = 0, met = 0;
  for (const RegionCovisibility& region : covisibility.regions) {
    for (const PairCount& pair : region.pairs) {
      trials += region.independence * pair.expected;
      met += region.independence * pair.met;
    }
  }
  return {trials, met};
}

TEST(Covisibility, ARightModelMeetsWhatTheDetectorFinds) {
  SyntheticOptions options;
  options.columns = 20;
  options.noise_px = 0;
  const SyntheticWorld world = MakeSyntheticWorld(options);
  const Reconstruction truth = TrueReconstruction(world);
  ThreadPool one(1), two(2);
  RunContext alone{one}, context{two};
  const CovisibilityCounter counter(truth, world.features, world.two_views, world.view_graph, {});
  const Covisibility covisibility = counter.CountAll(context);
  const auto [trials, met] = TrialsAndMet(covisibility);
  ASSERT_GT(trials, 2000);
  // Every image finds a point by a coin of its own: four standard deviations of the binomial. Near
  // by an observer is missing only where the match list of a pair is too short.
  const double share = options.detection_share;
  EXPECT_NEAR(met / trials, share, 4 * std::sqrt(share * (1 - share) / trials));

  // Regions are cut so that each has at most 15 points: the total does not depend on it.
  EXPECT_GT(covisibility.regions.size(), truth.points.size() / 15);
  const CovisibilityCounter whole(truth, world.features, world.two_views, world.view_graph,
                                  OneRegion());
  const Covisibility uncut = whole.CountAll(context);
  ASSERT_EQ(uncut.regions.size(), 1u);
  EXPECT_NEAR(TrialsAndMet(uncut).first, trials, 1e-6 * trials);

  const Covisibility serial = counter.CountAll(alone);
  ASSERT_EQ(serial.regions.size(), covisibility.regions.size());
  for (size_t r = 0; r < serial.regions.size(); ++r) {
    const RegionCovisibility &a = serial.regions[r], &b = covisibility.regions[r];
    EXPECT_EQ(a.independence, b.independence);
    ASSERT_EQ(a.pairs.size(), b.pairs.size()) << "region " << r;
    for (size_t p = 0; p < a.pairs.size(); ++p) {
      EXPECT_EQ(a.pairs[p].pair, b.pairs[p].pair);
      EXPECT_EQ(a.pairs[p].expected, b.pairs[p].expected);
      EXPECT_EQ(a.pairs[p].met, b.pairs[p].met);
    }
  }
}

TEST(Covisibility, ImagesOutsideTheModelAreNotCounted) {
  HandMade scene = Enclosed();
  scene.model.cam_from_model[1].reset();
  EXPECT_EQ(Count(scene), kNothing);
}

TEST(CovisibilityOptions, NamesTheFieldThatIsOutOfRange) {
  const auto field_of = [](const CovisibilityOptions& options) {
    const Status status = options.Validate();
    return status.ok() ? std::string("accepted") : status.error().context;
  };
  EXPECT_EQ(field_of({}), "accepted");
  EXPECT_EQ(field_of({.min_points_per_region = 0}), "min_points_per_region");
  EXPECT_EQ(field_of({.max_regions = 0}), "max_regions");
  EXPECT_EQ(field_of({.max_view_angle_rad = 0}), "max_view_angle_rad");
  EXPECT_EQ(field_of({.enclosure = 0.9}), "enclosure");
  EXPECT_EQ(field_of({.border_share = -0.1}), "border_share");
  EXPECT_EQ(field_of({.obstacle_cell_share = 0}), "obstacle_cell_share");
  EXPECT_EQ(field_of({.obstacle_depth_share = 0}), "obstacle_depth_share");
}

}  // namespace
}  // namespace rotunda::sfm
