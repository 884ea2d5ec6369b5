#include "sfm/consistent_view_graph.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/look_alike_world.h"

namespace rotunda::sfm {
namespace {

using test::IsCrossed;
using test::LookAlikeOptions;
using test::LookAlikeWorld;
using test::MakeLookAlikeWorld;

/// Cameras that turn about one axis, and edges that are right or off by an angle about it.
struct HandMadeGraph {
  explicit HandMadeGraph(size_t images) : graph{images, {}} {}

  static Eigen::Quaterniond Truth(size_t image) {
    return Eigen::AngleAxisd(0.2 * static_cast<double>(image), Eigen::Vector3d::UnitY()) *
           Eigen::Quaterniond(Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitX()));
  }
  /// `off_deg`: in the frame that the cameras share, so that edges off alike agree.
  HandMadeGraph& Add(size_t i, size_t j, double weight, double off_deg = 0) {
    TwoView view;
    view.pair = {ImageId(i), ImageId(j)};
    const Eigen::Quaterniond off(
        Eigen::AngleAxisd(RadFromDeg(off_deg), Eigen::Vector3d(1, 2, 2) / 3.0));
    view.second_from_first.rotation = Truth(j) * off * Truth(i).conjugate();
    view.second_from_first.translation = Eigen::Vector3d::UnitX();
    graph.edges.push_back({two_views.pairs.size(), view.pair, weight});
    two_views.pairs.push_back(view);
    return *this;
  }
  HandMadeGraph& AddPanoramic(size_t i, size_t j, double weight, double off_deg) {
    Add(i, j, weight, off_deg);
    two_views.pairs.back().kind = TwoViewKind::kPanoramic;
    two_views.pairs.back().second_from_first.translation.setZero();
    return *this;
  }
  ConsistentViewGraph Judge(const ConsistencyOptions& options = {}) const {
    const auto consistent = BuildConsistentViewGraph(graph, two_views, options);
    EXPECT_TRUE(consistent);
    return *consistent;
  }

  TwoViews two_views;
  ViewGraph graph;
};

using enum EdgeVerdict;

TEST(ConsistentViewGraph, AHeavyWrongEdgeIsOutvotedBySeveralNearlyAsHeavy) {
  // Between {0, 1} and {2, 3}: 0.5^4 = 0.063 against 3 * 0.45^4 = 0.123.
  const HandMadeGraph graph = HandMadeGraph(4)
                                  .Add(0, 1, 0.9)
                                  .Add(2, 3, 0.8)
                                  .Add(1, 2, 0.5, 180)
                                  .Add(0, 2, 0.45)
                                  .Add(0, 3, 0.45)
                                  .Add(1, 3, 0.45);
  EXPECT_EQ(graph.Judge().verdicts,
            (std::vector<EdgeVerdict>{kAgrees, kAgrees, kRejected, kAgrees, kAgrees, kAgrees}));
  EXPECT_EQ(graph.Judge({.piece_consensus = false}).verdicts,
            (std::vector<EdgeVerdict>{kAgrees, kAgrees, kAgrees, kRejected, kRejected, kRejected}))
      << "the tree of the heaviest edges folds";
}

TEST(ConsistentViewGraph, TheMarginIsOfTheTreeOverWhatContradictsIt) {
  HandMadeGraph graph =
      HandMadeGraph(4).Add(0, 1, 0.9).Add(1, 2, 0.6).Add(0, 2, 0.7).Add(2, 3, 0.5);
  EXPECT_EQ(graph.Judge().lightest_joining, 0.5);
  EXPECT_EQ(graph.Judge().Margin(), std::nullopt) << "nothing contradicts it";
  graph.Add(0, 3, 0.4, 20);
  EXPECT_EQ(graph.Judge().Margin(), std::nullopt) << "20 deg are no contradiction";
  graph.Add(1, 3, 0.2, 180)
      .Add(1, 3, 0.25, 90)
      .AddPanoramic(0, 3, 0.8, 180)
      .AddPanoramic(1, 3, 0.8, 0);
  EXPECT_EQ(graph.Judge().heaviest_off, 0.25);
  EXPECT_EQ(graph.Judge().Margin(), 2.0);
}

TEST(ConsistentViewGraph, ManyLightEdgesAreNotHeard) {
  // 0.5^4 = 0.063 against 3 * 0.3^4 = 0.024, although 0.5 < 3 * 0.3.
  const ConsistentViewGraph consistent = HandMadeGraph(4)
                                             .Add(0, 1, 0.9)
                                             .Add(2, 3, 0.8)
                                             .Add(1, 2, 0.5)
                                             .Add(0, 2, 0.3, 180)
                                             .Add(0, 3, 0.3, 180)
                                             .Add(1, 3, 0.3, 180)
                                             .Judge();
  EXPECT_EQ(consistent.verdicts,
            (std::vector<EdgeVerdict>{kAgrees, kAgrees, kAgrees, kRejected, kRejected, kRejected}));
}

TEST(ConsistentViewGraph, WhatAgreesIsKeptHoweverLight) {
  const HandMadeGraph graph = HandMadeGraph(5)
                                  .Add(0, 1, 0.9)
                                  .Add(1, 2, 0.8)
                                  .Add(0, 2, 0.10)  // lighter than the contradiction
                                  .Add(2, 3, 0.7)
                                  .Add(0, 3, 0.12, 90)
                                  .Add(1, 3, 0.13)
                                  .Add(3, 4, 0.06);
  const ConsistentViewGraph consistent = graph.Judge();
  EXPECT_EQ(consistent.verdicts, (std::vector<EdgeVerdict>{kAgrees, kAgrees, kAgrees, kAgrees,
                                                           kRejected, kAgrees, kAgrees}));
  std::vector<size_t> kept;
  for (const ViewGraphEdge& edge : EdgesThatAgree(graph.graph, consistent).edges) {
    kept.push_back(edge.two_view);
  }
  EXPECT_EQ(kept, (std::vector<size_t>{0, 1, 2, 3, 5, 6}));
}

TEST(ConsistentViewGraph, PanoramicEdgesHaveNoPart) {
  const HandMadeGraph without =
      HandMadeGraph(4).Add(0, 1, 0.5).Add(1, 2, 0.4).Add(0, 2, 0.3).Add(0, 3, 0.2);
  HandMadeGraph with = without;
  with.graph.images = 5;
  with.AddPanoramic(2, 3, 0.9, 120).AddPanoramic(1, 3, 0.9, 120).AddPanoramic(3, 4, 0.9, 0);
  EXPECT_EQ(with.Judge().verdicts, (std::vector<EdgeVerdict>{kAgrees, kAgrees, kAgrees, kAgrees,
                                                             kRejected, kRejected, kRejected}));
  EXPECT_EQ(without.Judge().verdicts, std::vector<EdgeVerdict>(4, kAgrees));
}

TEST(ConsistentViewGraph, AveragingBearsAnEdgeThatIsALittleOff) {
  // All 15 edges of six images; one is off by a little more or less than agree_rad = 8 degrees. The
  // L1/2 norm does not move at all; L1.5 would by a ninth of the error, least squares by a third,
  // and either would take what is off by 8.05 degrees for one that agrees.
  for (const double off_deg : {7.95, 8.05}) {
    HandMadeGraph graph(6);
    for (size_t i = 0; i < 6; ++i) {
      for (size_t j = i + 1; j < 6; ++j) graph.Add(i, j, 0.4, i == 1 && j == 4 ? off_deg : 0.0);
    }
    const ConsistentViewGraph consistent = graph.Judge();
    for (size_t e = 0; e < graph.graph.edges.size(); ++e) {
      const ImagePair& pair = graph.graph.edges[e].pair;
      const bool off = pair.first == ImageId(1) && pair.second == ImageId(4);
      EXPECT_EQ(consistent.verdicts[e], off && off_deg > 8 ? kRejected : kAgrees)
          << off_deg << " deg, edge " << e;
    }
  }
}

TEST(ConsistentViewGraph, EveryComponentIsJudgedByItsOwnEdges) {
  // Image 3 has no edge; 4, 5 and 6 contradict each other.
  const ConsistentViewGraph consistent = HandMadeGraph(7)
                                             .Add(0, 1, 0.5)
                                             .Add(0, 2, 0.4)
                                             .Add(4, 5, 0.3)
                                             .Add(5, 6, 0.3)
                                             .Add(4, 6, 0.1, 60)
                                             .Judge();
  EXPECT_EQ(consistent.verdicts,
            (std::vector<EdgeVerdict>{kAgrees, kAgrees, kAgrees, kAgrees, kRejected}));
  EXPECT_TRUE(HandMadeGraph(2).Judge().verdicts.empty());
}

/// Share of the crossed pairs, and of the true ones, that agree.
std::pair<double, double> AgreeingShares(const LookAlikeWorld& look_alike,
                                         const ConsistentViewGraph& consistent) {
  std::array<double, 2> agree = {0, 0}, all = {0, 0};
  for (size_t e = 0; e < consistent.verdicts.size(); ++e) {
    const ViewGraphEdge& edge = look_alike.world.view_graph.edges[e];
    const bool crossed =
        IsCrossed(look_alike.world, look_alike.world.two_views.pairs[edge.two_view]);
    ++all[crossed];
    agree[crossed] += consistent.verdicts[e] != kRejected;
  }
  return {agree[1] / all[1], agree[0] / all[0]};
}

TEST(ConsistentViewGraph, LightCrossedPairsAreRejectedHoweverMany) {
  LookAlikeOptions options;
  options.crossed_share = 0.3;
  options.print_half_width_deg = 90;
  const LookAlikeWorld look_alike = MakeLookAlikeWorld(options);
  ASSERT_GT(look_alike.crossed_pairs, look_alike.world.two_views.pairs.size() / 3);
  const auto consistent =
      BuildConsistentViewGraph(look_alike.world.view_graph, look_alike.world.two_views, {});
  ASSERT_TRUE(consistent);
  EXPECT_EQ(AgreeingShares(look_alike, *consistent), std::pair(0.0, 1.0));
}

TEST(ConsistentViewGraph, RefusesOptionsOutOfRange) {
  const auto field_of = [](const ConsistencyOptions& options) {
    const auto refused = BuildConsistentViewGraph({}, {}, options);
    if (refused) return std::string("accepted");
    EXPECT_EQ(refused.error().code, ErrorCode::kInvalidArgument);
    return refused.error().context;
  };
  EXPECT_EQ(field_of({}), "accepted");
  EXPECT_EQ(field_of({.agree_rad = 0}), "agree_rad");
  EXPECT_EQ(field_of({.off_rad = 0.1, .agree_rad = 0.2}), "off_rad");
  EXPECT_EQ(field_of({.far_rad = 0.1, .off_rad = 0.2, .agree_rad = 0.1}), "far_rad");
  EXPECT_EQ(field_of({.far_rad = std::nan("")}), "far_rad");
}

}  // namespace
}  // namespace rotunda::sfm
