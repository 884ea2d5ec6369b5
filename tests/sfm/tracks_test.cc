#include "sfm/tracks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

namespace rotunda::sfm {
namespace {

Features WithKeypoints(size_t images, size_t keypoints) {
  Features features;
  features.images.resize(images);
  for (ImageFeatures& image : features.images) image.keypoints.resize(keypoints);
  return features;
}

TwoView View(size_t first, size_t second, const std::vector<std::pair<size_t, size_t>>& inliers) {
  TwoView view;
  view.pair = {ImageId(first), ImageId(second)};
  for (const auto& [a, b] : inliers) view.inliers.push_back({KeypointId(a), KeypointId(b)});
  return view;
}

ViewGraph GraphOf(const TwoViews& views, const std::vector<double>& weights, size_t images) {
  ViewGraph graph;
  graph.images = images;
  for (size_t i = 0; i < views.pairs.size(); ++i) {
    graph.edges.push_back({i, views.pairs[i].pair, weights[i]});
  }
  return graph;
}

Observation At(size_t image, size_t keypoint) { return {ImageId(image), KeypointId(keypoint)}; }

TEST(BuildTracks, ChainsMatchesAndSortsByLength) {
  const TwoViews views{{View(0, 1, {{4, 5}, {1, 2}}), View(1, 2, {{5, 6}})}};
  const Tracks tracks = BuildTracks(WithKeypoints(3, 10), views, GraphOf(views, {1.0, 1.0}, 3));
  ASSERT_EQ(tracks.tracks.size(), 2U);
  EXPECT_EQ(tracks.tracks[0].observations, (std::vector{At(0, 4), At(1, 5), At(2, 6)}));
  EXPECT_EQ(tracks.tracks[1].observations, (std::vector{At(0, 1), At(1, 2)}));
}

TEST(BuildTracks, RefusesTwoKeypointsOfOnePictureAndTheStrongerPairWins) {
  // Keypoint 0 of picture 0 reaches keypoints 0 and 1 of picture 2, directly and over picture 1.
  const TwoViews views{{View(0, 1, {{0, 0}}), View(0, 2, {{0, 0}}), View(1, 2, {{0, 1}})}};
  const Tracks direct = BuildTracks(WithKeypoints(3, 2), views, GraphOf(views, {1.0, 0.9, 0.1}, 3));
  ASSERT_EQ(direct.tracks.size(), 1U);
  EXPECT_EQ(direct.tracks[0].observations, (std::vector{At(0, 0), At(1, 0), At(2, 0)}));
  const Tracks around = BuildTracks(WithKeypoints(3, 2), views, GraphOf(views, {1.0, 0.1, 0.9}, 3));
  ASSERT_EQ(around.tracks.size(), 1U);
  EXPECT_EQ(around.tracks[0].observations, (std::vector{At(0, 0), At(1, 0), At(2, 1)}));
}

TEST(BuildTracks, LeavesOutPanoramicPairs) {
  TwoViews views{{View(0, 1, {{0, 0}}), View(1, 2, {{0, 0}})}};
  views.pairs[0].kind = TwoViewKind::kPanoramic;
  const Tracks tracks = BuildTracks(WithKeypoints(3, 1), views, GraphOf(views, {1.0, 0.5}, 3));
  ASSERT_EQ(tracks.tracks.size(), 1U);
  EXPECT_EQ(tracks.tracks[0].observations, (std::vector{At(1, 0), At(2, 0)}));
}

TEST(BuildTracks, NothingFromNothing) {
  EXPECT_TRUE(BuildTracks(WithKeypoints(2, 3), {}, GraphOf({}, {}, 2)).tracks.empty());
}

TEST(BuildTracks, RandomMatchesGiveDisjointTracksWithOneKeypointAPicture) {
  std::mt19937_64 random(8);
  constexpr size_t kImages = 8, kKeypoints = 40;
  TwoViews views;
  std::vector<double> weights;
  for (size_t i = 0; i < kImages; ++i) {
    for (size_t j = i + 1; j < kImages; ++j) {
      std::vector<std::pair<size_t, size_t>> inliers;
      // Mostly the same keypoint, sometimes any other.
      for (size_t k = 0; k < kKeypoints; ++k) {
        if (random() % 2 == 0)
          inliers.emplace_back(k, random() % 5 == 0 ? random() % kKeypoints : k);
      }
      views.pairs.push_back(View(i, j, inliers));
      weights.push_back(static_cast<double>(random() % 4));
    }
  }
  const Tracks tracks =
      BuildTracks(WithKeypoints(kImages, kKeypoints), views, GraphOf(views, weights, kImages));
  std::set<Observation> seen;
  size_t last = kImages;
  for (const Track& track : tracks.tracks) {
    EXPECT_GE(track.observations.size(), 2U);
    EXPECT_LE(track.observations.size(), last);
    last = track.observations.size();
    for (size_t i = 0; i < track.observations.size(); ++i) {
      EXPECT_TRUE(seen.insert(track.observations[i]).second);
      if (i == 0) continue;
      EXPECT_LT(track.observations[i - 1].image, track.observations[i].image);
    }
  }
  // Every match lies inside one track or joins two that share a picture.
  const auto track_of = [&](const Observation& o) {
    for (size_t t = 0; t < tracks.tracks.size(); ++t) {
      const auto& all = tracks.tracks[t].observations;
      if (std::find(all.begin(), all.end(), o) != all.end()) return t;
    }
    return tracks.tracks.size();
  };
  for (const TwoView& view : views.pairs) {
    for (const Match& match : view.inliers) {
      const Observation a{view.pair.first, match.first}, b{view.pair.second, match.second};
      const size_t ta = track_of(a), tb = track_of(b);
      if (ta == tb && ta < tracks.tracks.size()) continue;
      std::set<ImageId> images;
      size_t total = 0;
      for (const auto& [t, o] : {std::pair{ta, a}, std::pair{tb, b}}) {
        const std::vector<Observation> observations =
            t < tracks.tracks.size() ? tracks.tracks[t].observations : std::vector{o};
        for (const Observation& x : observations) images.insert(x.image);
        total += observations.size();
      }
      EXPECT_LT(images.size(), total);
    }
  }
}

}  // namespace
}  // namespace rotunda::sfm
