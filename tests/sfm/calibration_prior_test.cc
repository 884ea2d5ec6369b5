#include "sfm/calibration_prior.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

namespace rotunda::sfm {
namespace {

Rigid3 Turned(double yaw_deg) {
  return {Eigen::Quaterniond(Eigen::AngleAxisd(RadFromDeg(yaw_deg), Eigen::Vector3d::UnitZ())),
          Eigen::Vector3d::Zero()};
}

/// Six cameras, every one 20 degrees on from the one before; each pair is a two-view geometry.
struct Ring {
  static constexpr size_t kCameras = 6;
  CalibratedPoses calibrated;
  TwoViews two_views;
  ViewGraph graph{kCameras, {}};

  Ring() {
    for (size_t i = 0; i < kCameras; ++i) calibrated.emplace_back(Turned(Yaw_deg(i)));
    for (size_t i = 0; i < kCameras; ++i) {
      for (size_t j = i + 1; j < kCameras; ++j) Add(i, j, Yaw_deg(j) - Yaw_deg(i), 0.3);
    }
  }
  static double Yaw_deg(size_t camera) { return 20.0 * static_cast<double>(camera); }
  void Add(size_t i, size_t j, double yaw_deg, double weight) {
    TwoView view;
    view.pair = {ImageId(i), ImageId(j)};
    view.second_from_first = Turned(yaw_deg);
    graph.edges.push_back({two_views.pairs.size(), view.pair, weight});
    two_views.pairs.push_back(view);
  }
  size_t EdgeOf(size_t i, size_t j) const {
    for (size_t e = 0; e < graph.edges.size(); ++e) {
      if (graph.edges[e].pair == ImagePair{ImageId(i), ImageId(j)}) return e;
    }
    ADD_FAILURE() << i << "-" << j;
    return 0;
  }
  void Turn(size_t i, size_t j, double by_deg) {
    two_views.pairs[EdgeOf(i, j)].second_from_first = Turned(Yaw_deg(j) - Yaw_deg(i) + by_deg);
  }
  Result<CalibrationPrior> Prior() const {
    return BuildCalibrationPrior(graph, two_views, calibrated, {});
  }
};

size_t Refuted(const CalibrationPrior& prior) {
  return static_cast<size_t>(std::count(prior.refuted.begin(), prior.refuted.end(), true));
}

TEST(CalibrationPrior, RefutesWhatIsTurnedOffTheCalibration) {
  Ring ring;
  ring.Turn(0, 3, 180);
  ring.Turn(1, 2, -11);
  ring.Turn(4, 5, 9);
  const auto prior = ring.Prior();
  ASSERT_TRUE(prior) << prior.error().ToString();
  EXPECT_EQ(Refuted(*prior), 2u);
  EXPECT_TRUE(prior->refuted[ring.EdgeOf(0, 3)]);
  EXPECT_TRUE(prior->refuted[ring.EdgeOf(1, 2)]);
  EXPECT_EQ(prior->placed, std::vector<bool>(Ring::kCameras, true));
  EXPECT_TRUE(prior->contradicted.empty());
}

TEST(CalibrationPrior, SaysNothingOfACameraThatWasMovedOrIsNotCalibrated) {
  Ring ring;
  ring.calibrated[2] = Turned(Ring::Yaw_deg(2) + 30);
  ring.calibrated[4].reset();
  ring.Turn(3, 4, 180);
  const auto prior = ring.Prior();
  ASSERT_TRUE(prior) << prior.error().ToString();
  EXPECT_EQ(Refuted(*prior), 0u);
  EXPECT_EQ(prior->placed, (std::vector<bool>{true, true, false, true, false, true}));
  EXPECT_EQ(prior->contradicted, std::vector<ImageId>{ImageId(2)});
}

TEST(CalibrationPrior, RefusesTheCalibrationOfAnotherRig) {
  Ring ring;
  for (size_t i = 0; i < Ring::kCameras; ++i) ring.calibrated[i] = Turned(3 * Ring::Yaw_deg(i));
  const auto prior = ring.Prior();
  ASSERT_FALSE(prior);
  EXPECT_EQ(prior.error().code, ErrorCode::kBadInput);
  EXPECT_EQ(prior.error().context, "calibration");
  EXPECT_NE(prior.error().message.find("6 of 6"), std::string::npos) << prior.error().message;
}

TEST(CalibrationPrior, RefusesOptionsOutOfRange) {
  Ring ring;
  CalibrationPriorOptions options;
  options.max_rotation_rad = 0;
  EXPECT_EQ(options.Validate().error().context, "max_rotation_rad");
  options = {};
  options.min_agreeing_share = 1.5;
  EXPECT_EQ(options.Validate().error().context, "min_agreeing_share");
}

}  // namespace
}  // namespace rotunda::sfm
