#include "sfm/matching.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>

#include "sfm/matching_kernel.h"

namespace rotunda::sfm {
namespace {

using Descriptors = std::vector<uint8_t>;

enum class Filling { kRootSift, kAnyByte, kFewValues, kLargest };

/// kFewValues makes ties common; kLargest makes the largest inner product there is.
Descriptors RandomDescriptors(size_t count, Filling filling, uint64_t seed) {
  std::mt19937_64 random(seed);
  Descriptors bytes;
  for (size_t i = 0; i < count; ++i) {
    std::array<double, kDescriptorSize> values;
    double sum = 0;
    for (double& value : values) {
      value = static_cast<double>(random() % 1000) * static_cast<double>(random() % 1000);
      sum += value;
    }
    for (double value : values) {
      uint8_t byte = 0;
      if (filling == Filling::kRootSift) {
        byte = static_cast<uint8_t>(std::min(255.0, std::round(512 * std::sqrt(value / sum))));
      } else if (filling == Filling::kAnyByte) {
        byte = static_cast<uint8_t>(random());
      } else if (filling == Filling::kFewValues) {
        byte = random() % 64 == 0 ? 1 : 0;
      } else {
        byte = 255;
      }
      bytes.push_back(byte);
    }
  }
  return bytes;
}

uint32_t Dot(const uint8_t* a, const uint8_t* b) {
  uint32_t dot = 0;
  for (size_t i = 0; i < kDescriptorSize; ++i) dot += uint32_t{a[i]} * b[i];
  return dot;
}

/// Straight from the definition: all products of one descriptor, the largest with the smallest
/// index, the largest of the others.
std::vector<NearestTwo> Reference(const Descriptors& from, const Descriptors& to) {
  std::vector<NearestTwo> nearest(from.size() / kDescriptorSize);
  const size_t candidates = to.size() / kDescriptorSize;
  for (size_t i = 0; i < nearest.size(); ++i) {
    std::vector<uint32_t> dots;
    for (size_t j = 0; j < candidates; ++j) {
      dots.push_back(Dot(&from[i * kDescriptorSize], &to[j * kDescriptorSize]));
    }
    if (dots.empty()) continue;
    const auto best = std::max_element(dots.begin(), dots.end());  // the first of equals
    nearest[i].best = static_cast<uint32_t>(best - dots.begin());
    nearest[i].best_dot = *best;
    *best = 0;
    nearest[i].second_dot = *std::max_element(dots.begin(), dots.end());
  }
  return nearest;
}

DescriptorView View(const Descriptors& bytes) {
  return {bytes.data(), bytes.size() / kDescriptorSize};
}

struct Case {
  size_t first, second;
  Filling filling;
};
class Kernels : public testing::TestWithParam<Case> {};

TEST_P(Kernels, AllGiveWhatTheDefinitionSays) {
  const Case& c = GetParam();
  const Descriptors first = RandomDescriptors(c.first, c.filling, 1);
  const Descriptors second = RandomDescriptors(c.second, c.filling, 2);
  const std::vector<NearestTwo> of_first = Reference(first, second);
  const std::vector<NearestTwo> of_second = Reference(second, first);
  for (const MatchKernel& kernel : MatchKernels()) {
    const NearestInPair nearest = FindNearest(kernel, View(first), View(second));
    EXPECT_TRUE(nearest.of_first == of_first) << kernel.name;
    EXPECT_TRUE(nearest.of_second == of_second) << kernel.name;
  }
}

// Blocks are 4 or 8 rows and 16 or 32 columns, tiles 512 rows and 4096 columns.
INSTANTIATE_TEST_SUITE_P(
    Sizes, Kernels,
    testing::Values(Case{0, 0, Filling::kRootSift}, Case{0, 5, Filling::kRootSift},
                    Case{5, 0, Filling::kRootSift}, Case{1, 1, Filling::kRootSift},
                    Case{1, 2, Filling::kRootSift}, Case{2, 1, Filling::kRootSift},
                    Case{8, 32, Filling::kRootSift}, Case{9, 33, Filling::kRootSift},
                    Case{7, 31, Filling::kAnyByte}, Case{100, 75, Filling::kRootSift},
                    Case{511, 65, Filling::kAnyByte}, Case{513, 64, Filling::kAnyByte},
                    Case{1030, 129, Filling::kRootSift}, Case{12, 4096, Filling::kAnyByte},
                    Case{20, 4099, Filling::kAnyByte}, Case{4100, 20, Filling::kRootSift},
                    Case{30, 9000, Filling::kFewValues}, Case{700, 40, Filling::kFewValues},
                    Case{60, 60, Filling::kFewValues}, Case{600, 4200, Filling::kLargest}));

TEST(Kernels, PortableOneIsAlwaysThere) {
  EXPECT_STREQ(MatchKernels().back().name, "generic");
  EXPECT_STREQ(MatchKernels().front().name, MatchKernelName());
}

/// A picture whose descriptors are these; keypoints do not matter for matching.
ImageFeatures Picture(const Descriptors& descriptors) {
  ImageFeatures image;
  image.keypoints.resize(descriptors.size() / kDescriptorSize);
  image.descriptors = descriptors;
  return image;
}

Matches Build(const Features& features, const MatchOptions& options, int threads = 1) {
  ThreadPool pool(threads);
  RunContext context{pool};
  std::vector<ImagePair> pairs;
  for (size_t i = 0; i < features.images.size(); ++i) {
    for (size_t j = i + 1; j < features.images.size(); ++j) {
      pairs.push_back({ImageId(i), ImageId(j)});
    }
  }
  auto matches = BuildMatches(features, pairs, options, context);
  EXPECT_TRUE(matches.ok());
  return std::move(matches).value();
}

/// Of norm 510, orthogonal to all others.
Descriptors Axis(size_t axis) {
  Descriptors bytes(kDescriptorSize, 0);
  std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(4 * axis), 4, 255);
  return bytes;
}
Descriptors operator+(Descriptors a, const Descriptors& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

TEST(BuildMatches, PermutedPictureIsMatchedOneToOne) {
  constexpr size_t kCount = 700;
  const Descriptors first = RandomDescriptors(kCount, Filling::kRootSift, 3);
  Descriptors second;
  for (size_t i = 0; i < kCount; ++i) {
    const size_t from = (i * 211 + 5) % kCount;  // 211 and 700 have no common divisor
    second.insert(second.end(), &first[from * kDescriptorSize],
                  &first[from * kDescriptorSize] + kDescriptorSize);
  }
  const Matches matches = Build({{Picture(first), Picture(second)}}, {});
  ASSERT_EQ(matches.pairs.size(), 1U);
  ASSERT_EQ(matches.pairs[0].matches.size(), kCount);
  for (const Match& match : matches.pairs[0].matches) {
    EXPECT_EQ((match.second.index() * 211 + 5) % kCount, match.first.index());
  }
  EXPECT_TRUE(std::is_sorted(matches.pairs[0].matches.begin(), matches.pairs[0].matches.end()));
}

TEST(BuildMatches, TwinsInEitherPictureAreNoMatch) {
  const MatchOptions any{.min_matches = 0};
  const Descriptors one = Axis(0) + Axis(1);
  // Axis 0 twice in the second picture: the ratio is one seen from the first.
  const Matches forward = Build({{Picture(one), Picture(Axis(0) + Axis(1) + Axis(0))}}, any);
  ASSERT_EQ(forward.pairs.at(0).matches.size(), 1U);
  EXPECT_EQ(forward.pairs[0].matches[0], (Match{KeypointId(1), KeypointId(1)}));
  const Matches backward = Build({{Picture(Axis(0) + Axis(1) + Axis(0)), Picture(one)}}, any);
  ASSERT_EQ(backward.pairs.at(0).matches.size(), 1U);
  EXPECT_EQ(backward.pairs[0].matches[0], (Match{KeypointId(1), KeypointId(1)}));
}

TEST(BuildMatches, RatioAndDistanceAreAngles) {
  const auto at_angle = [](double angle_rad) {
    Descriptors bytes(kDescriptorSize, 0);
    for (size_t i = 0; i < 16; ++i) {
      bytes[i] = static_cast<uint8_t>(std::lround(128 * std::cos(angle_rad)));
      bytes[16 + i] = static_cast<uint8_t>(std::lround(128 * std::sin(angle_rad)));
    }
    return bytes;
  };
  const Features features{{Picture(at_angle(0)), Picture(at_angle(0.5) + at_angle(0.7))}};
  const auto found = [&](double max_ratio, double max_distance_rad) {
    return !Build(features, {max_ratio, max_distance_rad, 0}).pairs.empty();
  };
  EXPECT_TRUE(found(0.75, 0.6));  // 0.5 / 0.7 = 0.714
  EXPECT_FALSE(found(0.70, 0.6));
  EXPECT_FALSE(found(0.75, 0.45));
}

TEST(BuildMatches, FewMatchesAndEmptyPicturesAreLeftOut) {
  const Descriptors ten = RandomDescriptors(10, Filling::kRootSift, 4);
  const Features features{{Picture(ten), Picture({}), Picture(ten)}};
  EXPECT_EQ(Build(features, {.min_matches = 10}).pairs.size(), 1U);
  EXPECT_TRUE(Build(features, {.min_matches = 11}).pairs.empty());
  EXPECT_TRUE(Build({}, {}).pairs.empty());
}

TEST(BuildMatches, SameOnAnyNumberOfThreads) {
  Features features;
  for (uint64_t i = 0; i < 6; ++i) {
    features.images.push_back(Picture(RandomDescriptors(150, Filling::kRootSift, i / 2)));
  }
  const Matches serial = Build(features, {.min_matches = 0}, 1);
  const Matches parallel = Build(features, {.min_matches = 0}, 4);
  ASSERT_EQ(serial.pairs.size(), parallel.pairs.size());
  for (size_t i = 0; i < serial.pairs.size(); ++i) {
    EXPECT_EQ(serial.pairs[i].pair, parallel.pairs[i].pair);
    EXPECT_EQ(serial.pairs[i].matches, parallel.pairs[i].matches);
  }
}

TEST(BuildMatches, RefusesWhatDoesNotFit) {
  ThreadPool pool(1);
  RunContext context{pool};
  Features features{{Picture(Axis(0)), Picture(Axis(1))}};
  const ImagePair backwards{ImageId(1), ImageId(0)}, beyond{ImageId(0), ImageId(2)};
  EXPECT_FALSE(BuildMatches(features, {backwards}, {}, context).ok());
  EXPECT_FALSE(BuildMatches(features, {beyond}, {}, context).ok());
  const auto bad_ratio = BuildMatches(features, {}, {.max_ratio = 1.5}, context);
  ASSERT_FALSE(bad_ratio.ok());
  EXPECT_NE(bad_ratio.error().message.find("max_ratio is 1.5"), std::string::npos);
  features.images[0].descriptors.pop_back();
  const auto cut = BuildMatches(features, {}, {}, context);
  ASSERT_FALSE(cut.ok());
  EXPECT_NE(cut.error().message.find("127"), std::string::npos);
}

}  // namespace
}  // namespace rotunda::sfm
