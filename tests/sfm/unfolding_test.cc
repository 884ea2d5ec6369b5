#include "sfm/unfolding.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

using test::NormalRandom;

constexpr double kInfinite = std::numeric_limits<double>::infinity();

/// Images in a chain.
ViewGraph Chain(size_t images) {
  ViewGraph graph{images, {}};
  for (size_t i = 0; i + 1 < images; ++i) {
    graph.edges.push_back({i, {ImageId(i), ImageId(i + 1)}, 0.3});
  }
  return graph;
}

/// The first `size` images are 0, the next 1 and so on.
std::vector<int> Consecutive(const std::vector<size_t>& sizes) {
  std::vector<int> groups;
  for (size_t g = 0; g < sizes.size(); ++g)
    groups.insert(groups.end(), sizes[g], static_cast<int>(g));
  return groups;
}

/// A region that every pair of images expects `expected` points of; met are `within` of them within
/// groups, and `across` of them across.
RegionCovisibility Region(const std::vector<int>& groups, uint32_t expected, uint32_t within,
                          uint32_t across) {
  RegionCovisibility region;
  region.independence = 0.25;
  for (size_t i = 0; i < groups.size(); ++i) {
    for (size_t j = i + 1; j < groups.size(); ++j) {
      const bool same = groups[i] == groups[j];
      region.pairs.push_back({{ImageId(i), ImageId(j)}, expected, same ? within : across});
    }
  }
  return region;
}

/// `telling` regions that are met within the groups alone among `regions`.
Covisibility Folded(const std::vector<int>& groups, size_t regions, size_t telling) {
  Covisibility covisibility{groups.size(), {}};
  for (size_t r = 0; r < regions; ++r) {
    covisibility.regions.push_back(Region(groups, 10, 7, r < telling ? 0 : 7));
  }
  return covisibility;
}

TEST(LookAlikeGroups, AFewRegionsTellTwoGroupsApart) {
  const std::vector<int> truth = Consecutive({12, 8});
  const LookAlikeGroups groups = FindLookAlikeGroups(Folded(truth, 30, 3), Chain(20));
  EXPECT_EQ(groups.count, 2u);
  EXPECT_EQ(groups.of_image, truth);
  EXPECT_GT(groups.gain, 100);
  for (size_t i = 0; i < 20; ++i) EXPECT_GT(groups.certainty[i], 10) << "image " << i;
}

TEST(LookAlikeGroups, TheLargestGroupIsTheFirstWhereverItsImagesAre) {
  std::vector<int> truth;
  for (size_t i = 0; i < 20; ++i) truth.push_back(i % 3 == 0 ? 1 : 0);
  const LookAlikeGroups groups = FindLookAlikeGroups(Folded(truth, 30, 3), Chain(20));
  EXPECT_EQ(groups.of_image, truth);
  const std::vector<int> three = Consecutive({9, 8, 7});
  const LookAlikeGroups of_three = FindLookAlikeGroups(Folded(three, 30, 4), Chain(24));
  EXPECT_EQ(of_three.count, 3u);
  EXPECT_EQ(of_three.of_image, three);
}

/// Log-likelihood of `met` of `all` at their own rate.
double LogLikelihood(double met, double all) {
  const double rate = std::clamp(met / all, 0.005, 0.995);
  return met * std::log(rate) + (all - met) * std::log(1 - rate);
}

TEST(LookAlikeGroups, TheGainIsLessTheDescriptionOfTheGroups) {
  const std::vector<int> truth = Consecutive({4, 4});
  const LookAlikeGroups groups = FindLookAlikeGroups(Folded(truth, 2, 1), Chain(8));
  ASSERT_EQ(groups.of_image, truth);
  // 12 pairs within, 16 across, of 10 points at an independence of 1/4. Eight images in one of two
  // groups of equal size, two regions one of which tells.
  const double within = 12 * 2.5, across = 16 * 2.5, met = 0.7 * within;
  EXPECT_NEAR(groups.gain,
              LogLikelihood(met, within) + LogLikelihood(0, across) -
                  LogLikelihood(met, within + across) - (8 + 2) * std::log(2.0),
              1e-9);
}

TEST(LookAlikeGroups, NothingTellsInAModelThatIsNotFolded) {
  const LookAlikeGroups groups =
      FindLookAlikeGroups(Folded(Consecutive({12, 8}), 30, 0), Chain(20));
  EXPECT_EQ(groups.count, 1u);
  EXPECT_EQ(groups.gain, 0);
  EXPECT_EQ(groups.of_image, std::vector<int>(20, 0));
  EXPECT_EQ(groups.certainty, std::vector<double>(20, kInfinite));
}

uint32_t Binomial(NormalRandom& random, uint32_t trials, double share) {
  uint32_t successes = 0;
  for (uint32_t t = 0; t < trials; ++t) successes += random.Uniform() < share;
  return successes;
}

/// Regions of all kinds, seen by runs of images of a ring, met by chance alone: some well, some
/// hardly ever, and images that find half of what others do.
Covisibility RandomMisses(size_t images, size_t regions, uint64_t seed) {
  NormalRandom random(seed);
  std::vector<double> sharpness;
  for (size_t i = 0; i < images; ++i) sharpness.push_back(random.Uniform() < 0.15 ? 0.7 : 1.0);
  Covisibility covisibility{images, {}};
  for (size_t r = 0; r < regions; ++r) {
    RegionCovisibility region;
    region.independence = 0.2 + 0.3 * random.Uniform();
    const double share = random.Uniform() < 0.2 ? 0.15 : 0.5 + 0.4 * random.Uniform();
    const size_t begin = random.Index(images), length = 4 + random.Index(images / 2);
    const auto expected = static_cast<uint32_t>(1 + random.Index(15));
    for (size_t a = 0; a < length; ++a) {
      for (size_t b = a + 1; b < length; ++b) {
        const size_t i = (begin + a) % images, j = (begin + b) % images;
        const uint32_t met = Binomial(random, expected, share * sharpness[i] * sharpness[j]);
        region.pairs.push_back({{ImageId(std::min(i, j)), ImageId(std::max(i, j))}, expected, met});
      }
    }
    std::sort(region.pairs.begin(), region.pairs.end(),
              [](const PairCount& a, const PairCount& b) { return a.pair < b.pair; });
    covisibility.regions.push_back(region);
  }
  return covisibility;
}

TEST(LookAlikeGroups, RandomMissesMakeNoGroups) {
  for (uint64_t seed = 1; seed <= 20; ++seed) {
    const LookAlikeGroups groups = FindLookAlikeGroups(RandomMisses(30, 80, seed), Chain(30));
    EXPECT_EQ(groups.count, 1u) << "seed " << seed << ", gain " << groups.gain;
    EXPECT_EQ(groups.gain, 0) << "seed " << seed;
  }
}

TEST(LookAlikeGroups, RandomMissesDoNotHideThem) {
  for (uint64_t seed = 1; seed <= 20; ++seed) {
    const std::vector<int> truth = Consecutive({17, 13});
    Covisibility covisibility = RandomMisses(30, 80, seed);
    NormalRandom random(DeriveSeed(seed, 1));
    for (size_t r = 0; r < 6; ++r) {
      RegionCovisibility region = Region(truth, 6, 0, 0);
      for (PairCount& pair : region.pairs) {
        const bool same = truth[pair.pair.first.index()] == truth[pair.pair.second.index()];
        pair.met = Binomial(random, pair.expected, same ? 0.7 : 0.04);
      }
      covisibility.regions.push_back(region);
    }
    const LookAlikeGroups groups = FindLookAlikeGroups(covisibility, Chain(30));
    EXPECT_EQ(groups.of_image, truth) << "seed " << seed;
    EXPECT_GT(groups.gain, 100) << "seed " << seed;
  }
}

TEST(LookAlikeGroups, ImagesThatNothingIsKnownOfGoWithTheirStrongestNeighbour) {
  const std::vector<int> truth = Consecutive({10, 8});
  Covisibility covisibility = Folded(truth, 20, 4);
  covisibility.images = 21;
  ViewGraph graph = Chain(18);
  graph.images = 21;
  // Image 18 is tied to both groups, image 19 to image 18 alone, image 20 to none.
  graph.edges.push_back({17, {ImageId(2), ImageId(18)}, 0.10});
  graph.edges.push_back({18, {ImageId(15), ImageId(18)}, 0.25});
  graph.edges.push_back({19, {ImageId(18), ImageId(19)}, 0.05});
  const LookAlikeGroups groups = FindLookAlikeGroups(covisibility, graph);
  ASSERT_EQ(groups.count, 2u);
  EXPECT_EQ(groups.of_image[18], 1);
  EXPECT_EQ(groups.of_image[19], 1);
  EXPECT_EQ(groups.of_image[20], kNoGroup);
  EXPECT_EQ(groups.certainty[20], 0);
  // The view graph decides, but is worth little beside what regions tell.
  EXPECT_GT(groups.certainty[18], 0);
  EXPECT_LT(groups.certainty[18], 0.1 * groups.certainty[15]);
}

}  // namespace
}  // namespace rotunda::sfm
