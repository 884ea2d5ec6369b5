#include "sfm/segments.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace rotunda::sfm {
namespace {

/// A star: node 0 in community 0 and neighbours in the given communities.
double IndexOfStar(const std::vector<uint32_t>& neighbours) {
  TrackGraph graph;
  Communities communities;
  graph.graph.neighbours.resize(1);
  communities.of_node = {0};
  for (uint32_t community : neighbours) {
    graph.graph.neighbours[0].push_back({static_cast<uint32_t>(communities.of_node.size()), 5.0});
    communities.of_node.push_back(community);
  }
  return DiversityIndex(graph, communities, 0);
}

TEST(DiversityIndex, HandCases) {
  EXPECT_NEAR(IndexOfStar({1, 1, 2, 2, 2, 3, 3}), 0.653, 0.0005);  // the paper's example
  EXPECT_EQ(IndexOfStar({}), 0);
  EXPECT_EQ(IndexOfStar({0, 0, 0}), 0);     // no foreign neighbour
  EXPECT_EQ(IndexOfStar({0, 0, 7, 7}), 0);  // one foreign community
  for (size_t each = 1; each < 50; ++each) {
    std::vector<uint32_t> two(each, 1);
    two.insert(two.end(), each, 2);
    EXPECT_EQ(IndexOfStar(two), 0.5) << each;
  }
  EXPECT_LT(IndexOfStar({1, 1, 2}), 0.5);
}

/// Patches in a row, 10 pixels wide; keypoint k of every picture lies in patch k / 10.
constexpr size_t kPatches = 6, kKeypoints = 60;

struct Scene {
  explicit Scene(size_t images) {
    Superpixels row{kPatches, 1, 0.1, {}, std::vector<std::vector<uint16_t>>(kPatches)};
    for (uint16_t i = 0; i < kPatches; ++i) row.labels.push_back(i);
    superpixels.assign(images, row);
    features.images.resize(images);
    for (ImageFeatures& image : features.images) {
      for (size_t k = 0; k < kKeypoints; ++k) {
        image.keypoints.push_back({static_cast<float>(k) + 0.5F, 5, 1, 0});
      }
    }
    view_graph.images = images;
  }

  /// A track that has the same keypoint in the pictures first .. last; sampled if it has a
  /// community.
  void Add(size_t keypoint, size_t first, size_t last, std::optional<uint32_t> community = {}) {
    Track track;
    for (size_t i = first; i <= last; ++i) {
      track.observations.push_back({ImageId(i), KeypointId(keypoint)});
    }
    tracks.tracks.push_back(track);
    if (!community) return;
    graph.tracks.push_back(TrackId(tracks.tracks.size() - 1));
    graph.graph.neighbours.emplace_back();
    communities.of_node.push_back(*community);
    communities.count = std::max<size_t>(communities.count, *community + 1);
  }
  void AddPair(size_t first, size_t second, EdgeVerdict verdict,
               const std::vector<std::pair<size_t, size_t>>& matches) {
    TwoView view;
    view.pair = {ImageId(first), ImageId(second)};
    for (const auto& [a, b] : matches) view.inliers.push_back({KeypointId(a), KeypointId(b)});
    view_graph.edges.push_back({two_views.pairs.size(), view.pair, 0.1});
    two_views.pairs.push_back(view);
    verdicts.push_back(verdict);
  }
  Segments Build(const SegmentOptions& options = {}) const {
    return BuildSegments(
        {features, two_views, view_graph, verdicts, tracks, superpixels, graph, communities},
        options);
  }

  Features features;
  TwoViews two_views;
  ViewGraph view_graph;
  std::vector<EdgeVerdict> verdicts;
  Tracks tracks;
  std::vector<Superpixels> superpixels;
  TrackGraph graph;
  Communities communities;
};

TEST(BuildSegments, KeypointsTakeTheCommunityOfTheirPatch) {
  Scene scene(3);
  for (size_t k : {0, 1, 12}) scene.Add(k, 0, 2, 1);
  for (size_t k : {2, 13, 20}) scene.Add(k, 0, 2, 0);
  scene.superpixels[2] = {};  // a frame without picture
  const Segments segments = scene.Build();
  for (size_t image : {0, 1}) {
    const auto& labels = segments.of_keypoint[image];
    EXPECT_EQ(labels[0], 1U);
    EXPECT_EQ(labels[2], 0U);   // sampled: its own
    EXPECT_EQ(labels[7], 1U);   // two of community 1, one of 0
    EXPECT_EQ(labels[17], 0U);  // one of each: the smaller
    EXPECT_EQ(labels[29], 0U);
    EXPECT_EQ(labels[35], std::nullopt);
  }
  EXPECT_EQ(segments.of_keypoint[2][0], 1U);
  EXPECT_EQ(segments.of_keypoint[2][7], std::nullopt);
}

TEST(BuildSegments, TracksTakeTheCommunityOfMostKeypoints) {
  Scene scene(5);
  scene.Add(0, 0, 2, 0);
  scene.Add(1, 3, 4, 1);  // patch 0: community 0 in pictures 0 to 2, 1 in 3 and 4
  scene.Add(5, 0, 4);     // three against two
  scene.Add(6, 2, 4);     // one against two
  scene.Add(7, 2, 3);     // one each
  scene.Add(30, 0, 4);    // nobody near
  const Segments segments = scene.Build({.min_image_tracks = 3});
  using Label = std::optional<uint32_t>;
  EXPECT_EQ(segments.of_track, (std::vector<Label>{0U, 1U, 0U, 1U, 0U, std::nullopt}));
  ASSERT_EQ(segments.segments.size(), 2U);
  EXPECT_EQ(segments.segments[0].tracks, 3U);
  EXPECT_EQ(segments.segments[1].tracks, 2U);
  // Tracks 0, 2 and 4 are together in picture 2 alone.
  EXPECT_EQ(segments.segments[0].images, std::vector{ImageId(2)});
  EXPECT_TRUE(segments.segments[1].images.empty());
  EXPECT_EQ(scene.Build({.min_image_tracks = 2}).segments[1].images,
            (std::vector{ImageId(3), ImageId(4)}));
}

/// Two segments of ten tracks each, seen by pictures 0 to 3 and 4 to 7, and a third one.
Scene FrontAndBack() {
  Scene scene(9);
  for (size_t k = 0; k < 10; ++k) scene.Add(k, 0, 3, 0);
  for (size_t k = 0; k < 10; ++k) scene.Add(k, 4, 7, 1);
  for (size_t k = 20; k < 30; ++k) scene.Add(k, 0, 7, 2);
  return scene;
}

TEST(BuildSegments, TracksThatRejectedPairsJoinAgainAndAgainAreSuspicious) {
  Scene scene = FrontAndBack();
  // Three tracks of either side twice; two more once; one with the third segment twice.
  scene.AddPair(0, 4, EdgeVerdict::kRejected, {{0, 0}, {1, 1}, {2, 2}, {3, 3}});
  scene.AddPair(1, 5, EdgeVerdict::kRejected, {{0, 0}, {1, 1}, {2, 2}, {4, 4}, {5, 25}});
  scene.AddPair(1, 6, EdgeVerdict::kRejected, {{5, 25}, {50, 51}});
  const Segments segments = scene.Build();
  EXPECT_EQ(segments.segments[0].sampled_tracks, 10U);
  EXPECT_EQ(segments.segments[0].suspicious_tracks, 4U);
  EXPECT_EQ(segments.segments[1].suspicious_tracks, 3U);
  EXPECT_EQ(segments.segments[2].suspicious_tracks, 1U);
  EXPECT_TRUE(segments.segments[0].ambiguous);
  EXPECT_TRUE(segments.segments[1].ambiguous);
  EXPECT_FALSE(segments.segments[2].ambiguous);
  EXPECT_EQ(segments.segments[0].look_alikes, (std::vector<uint32_t>{1, 2}));
  EXPECT_EQ(segments.segments[1].look_alikes, (std::vector<uint32_t>{0}));
  EXPECT_EQ(segments.segments[2].look_alikes, (std::vector<uint32_t>{0}));

  const Segments single = scene.Build({.min_link_matches = 1});
  EXPECT_EQ(single.segments[0].suspicious_tracks, 6U);
  EXPECT_EQ(single.segments[1].suspicious_tracks, 5U);
  // A share of exactly xi is not above it.
  EXPECT_TRUE(scene.Build({.max_suspicious_share = 0.29}).segments[1].ambiguous);
  EXPECT_FALSE(scene.Build({.max_suspicious_share = 0.3}).segments[1].ambiguous);
}

TEST(BuildSegments, ASegmentCanBeItsOwnLookAlike) {
  Scene scene = FrontAndBack();
  for (size_t image : {1, 2}) {
    scene.AddPair(0, image, EdgeVerdict::kRejected, {{0, 3}, {1, 4}, {2, 5}});
  }
  const Segments segments = scene.Build();
  EXPECT_EQ(segments.segments[0].suspicious_tracks, 6U);
  EXPECT_EQ(segments.segments[0].look_alikes, (std::vector<uint32_t>{0}));
}

TEST(BuildSegments, PairsThatSayNothingOfLookAlikes) {
  const std::vector<std::pair<size_t, size_t>> matches = {{0, 0}, {1, 1}, {2, 2}, {3, 3}};
  const auto suspicious = [](const Scene& scene) {
    return scene.Build().segments[0].suspicious_tracks;
  };
  Scene agreed = FrontAndBack();
  for (size_t image : {5, 6}) agreed.AddPair(0, image, EdgeVerdict::kAgrees, matches);
  EXPECT_EQ(suspicious(agreed), 0U);
  Scene panoramic = FrontAndBack();
  for (size_t image : {5, 6}) panoramic.AddPair(0, image, EdgeVerdict::kRejected, matches);
  EXPECT_EQ(suspicious(panoramic), 4U);
  for (TwoView& view : panoramic.two_views.pairs) view.kind = TwoViewKind::kPanoramic;
  EXPECT_EQ(suspicious(panoramic), 0U);

  // One match in five lies within a track of the third segment.
  Scene agreeing = FrontAndBack();
  for (size_t image : {5, 6}) {
    auto more = matches;
    more.emplace_back(20, 20);
    agreeing.AddPair(0, image, EdgeVerdict::kRejected, more);
  }
  EXPECT_EQ(suspicious(agreeing), 0U);
  EXPECT_EQ(agreeing.Build({.max_agreeing_share = 0.2}).segments[0].suspicious_tracks, 4U);
}

TEST(BuildSegments, DiversityIsThePapersSign) {
  Scene scene(2);
  for (uint32_t community : {0, 1, 2, 3}) scene.Add(10 * community, 0, 1, community);
  const auto join = [&](uint32_t a, uint32_t b) {
    scene.graph.graph.neighbours[a].push_back({b, 1});
    scene.graph.graph.neighbours[b].push_back({a, 1});
  };
  join(0, 1);
  join(0, 2);
  join(0, 3);
  join(1, 2);
  // Foreign communities of 0: three; of 1 and 2: two, equal; of 3: one.
  const auto ambiguous = [&](const SegmentOptions& options) {
    std::vector<bool> out;
    for (const Segment& segment : scene.Build(options).segments) out.push_back(segment.ambiguous);
    return out;
  };
  SegmentOptions options{.sign = AmbiguitySign::kDiversity};
  EXPECT_EQ(ambiguous(options), (std::vector{true, false, false, false}));
  options.diversity_inclusive = true;
  EXPECT_EQ(ambiguous(options), (std::vector{true, true, true, false}));
  options.min_diversity = 0.7;
  EXPECT_EQ(ambiguous(options), (std::vector{false, false, false, false}));
}

TEST(SegmentOptions, Validate) {
  EXPECT_TRUE(SegmentOptions{}.Validate().ok());
  for (const SegmentOptions& bad :
       {SegmentOptions{.min_link_matches = 0}, SegmentOptions{.max_agreeing_share = -0.1},
        SegmentOptions{.min_diversity = 1.5}, SegmentOptions{.max_suspicious_share = 2}}) {
    EXPECT_EQ(bad.Validate().error().code, ErrorCode::kInvalidArgument);
  }
}

}  // namespace
}  // namespace rotunda::sfm
