#include "sfm/track_graph.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <random>
#include <set>

namespace rotunda::sfm {
namespace {

/// A row of patches, each 10 pixels wide; patch i touches i - 1 and i + 1.
Superpixels Row(uint16_t patches) {
  Superpixels map;
  map.width_px = patches;
  map.height_px = 1;
  map.map_from_picture = 0.1;
  for (uint16_t i = 0; i < patches; ++i) {
    map.labels.push_back(i);
    map.neighbours.emplace_back();
    if (i > 0) map.neighbours.back().push_back(static_cast<uint16_t>(i - 1));
    if (i + 1 < patches) map.neighbours.back().push_back(static_cast<uint16_t>(i + 1));
  }
  return map;
}

/// Pictures whose tracks are given by the patch in which each picture sees them (-1: does not).
struct Scene {
  explicit Scene(size_t images, uint16_t patches) : superpixels(images, Row(patches)) {
    features.images.resize(images);
  }
  void Add(const std::vector<int>& patches) {
    Track track;
    for (size_t image = 0; image < patches.size(); ++image) {
      if (patches[image] < 0) continue;
      auto& keypoints = features.images[image].keypoints;
      track.observations.push_back({ImageId(image), KeypointId(keypoints.size())});
      keypoints.push_back({static_cast<float>(10 * patches[image] + 4), 3, 1, 0});
    }
    tracks.tracks.push_back(track);
  }
  TrackGraph Build(const TrackGraphOptions& options = {}) const {
    return BuildTrackGraph(features, tracks, superpixels, options);
  }

  Features features;
  Tracks tracks;
  std::vector<Superpixels> superpixels;
};

std::vector<TrackId> Ids(const std::vector<size_t>& ids) {
  std::vector<TrackId> out;
  for (size_t id : ids) out.push_back(TrackId(id));
  return out;
}

double WeightBetween(const TrackGraph& graph, uint32_t a, uint32_t b) {
  for (const GraphNeighbour& neighbour : graph.graph.neighbours[a]) {
    if (neighbour.node == b) return neighbour.weight;
  }
  return 0;
}

TEST(BuildTrackGraph, SamplesATrackThatTouchesAnUncoveredPatch) {
  Scene scene(4, 9);
  scene.Add({0, 0, 0, 0});
  scene.Add({0, 0, 0, 3});    // new in the last picture alone
  scene.Add({0, 0, 0, 3});    // nothing new
  scene.Add({-1, 0, 0, 3});   // nothing new
  scene.Add({5, 5, 5, -1});   // new everywhere
  scene.Add({-1, -1, 7, 7});  // too short
  EXPECT_EQ(scene.Build().tracks, Ids({0, 1, 4}));
  EXPECT_EQ(scene.Build({.min_track_length = 2}).tracks, Ids({0, 1, 4, 5}));
}

TEST(BuildTrackGraph, WeighsByThePicturesInWhichTracksAreSideBySide) {
  Scene scene(4, 9);
  scene.Add({0, 0, 0, 0});
  scene.Add({0, 1, 2, 1});   // with 0: same patch, beside, one between, beside
  scene.Add({-1, 8, 8, 2});  // with 1: beside in the last
  scene.Add({8, -1, 3, 3});  // with 2: beside in the last; with 1: beside in the third
  const TrackGraph graph = scene.Build();
  ASSERT_EQ(graph.tracks, Ids({0, 1, 2, 3}));
  const double expected[4][4] = {{0, 3, 0, 0}, {3, 0, 1, 1}, {0, 1, 0, 1}, {0, 1, 1, 0}};
  for (uint32_t a = 0; a < 4; ++a) {
    for (uint32_t b = 0; b < 4; ++b) {
      EXPECT_EQ(WeightBetween(graph, a, b), expected[a][b]) << a << " " << b;
    }
  }
  EXPECT_EQ(WeightBetween(scene.Build({.weighted = false}), 0, 1), 1);
}

TEST(BuildTrackGraph, LeavesOutFramesWithoutPicture) {
  Scene scene(4, 9);
  scene.Add({0, 0, 0, 0});
  scene.Add({0, 0, 0, 8});  // new only where there is no picture
  scene.Add({1, 1, 1, 0});
  scene.superpixels[3] = {};
  const TrackGraph graph = scene.Build();
  EXPECT_EQ(graph.tracks, Ids({0, 2}));
  EXPECT_EQ(WeightBetween(graph, 0, 1), 3);
}

TEST(BuildTrackGraph, EmptyFromNothing) {
  EXPECT_TRUE(Scene(2, 3).Build().tracks.empty());
  EXPECT_TRUE(BuildTrackGraph({}, {}, {}, {}).graph.neighbours.empty());
}

// The definition, straight from the paper, on random tracks.
TEST(BuildTrackGraph, AgreesWithTheDefinitionOnRandomTracks) {
  constexpr size_t kImages = 12;
  constexpr int kPatches = 15;
  std::mt19937_64 random(21);
  std::vector<std::vector<int>> places;
  for (int t = 0; t < 150; ++t) {
    std::vector<int> patches(kImages, -1);
    for (int& patch : patches) {
      if (random() % 3 == 0) patch = static_cast<int>(random() % kPatches);
    }
    places.push_back(patches);
  }
  const auto length = [](const std::vector<int>& p) {
    return kImages - std::count(p.begin(), p.end(), -1);
  };
  std::stable_sort(places.begin(), places.end(),
                   [&](const auto& a, const auto& b) { return length(a) > length(b); });
  Scene scene(kImages, kPatches);
  for (const std::vector<int>& patches : places) scene.Add(patches);

  std::vector<size_t> sampled;
  std::set<std::pair<size_t, int>> covered;
  for (size_t t = 0; t < places.size(); ++t) {
    if (length(places[t]) < 3) continue;
    std::set<std::pair<size_t, int>> touched;
    for (size_t image = 0; image < kImages; ++image) {
      if (places[t][image] >= 0) touched.insert({image, places[t][image]});
    }
    if (std::includes(covered.begin(), covered.end(), touched.begin(), touched.end())) continue;
    sampled.push_back(t);
    covered.insert(touched.begin(), touched.end());
  }
  const TrackGraph graph = scene.Build();
  ASSERT_EQ(graph.tracks, Ids(sampled));
  ASSERT_LT(sampled.size(), places.size());
  for (uint32_t a = 0; a < sampled.size(); ++a) {
    for (uint32_t b = 0; b < sampled.size(); ++b) {
      int together = 0;
      for (size_t image = 0; image < kImages && a != b; ++image) {
        const int x = places[sampled[a]][image], y = places[sampled[b]][image];
        if (x >= 0 && y >= 0 && std::abs(x - y) <= 1) ++together;
      }
      EXPECT_EQ(WeightBetween(graph, a, b), together);
    }
    const auto& row = graph.graph.neighbours[a];
    EXPECT_TRUE(std::is_sorted(row.begin(), row.end(),
                               [](const auto& x, const auto& y) { return x.node < y.node; }));
  }
}

TEST(TrackGraphOptions, ATrackJoinsTwoPictures) {
  EXPECT_TRUE(TrackGraphOptions{}.Validate().ok());
  EXPECT_TRUE(TrackGraphOptions{.min_track_length = 2}.Validate().ok());
  EXPECT_EQ(TrackGraphOptions{.min_track_length = 1}.Validate().error().context,
            "min_track_length");
}

}  // namespace
}  // namespace rotunda::sfm
