#include "sfm/superpixels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <string>

#include "tests/support/picture_set.h"

namespace rotunda::sfm {
namespace {

namespace fs = std::filesystem;

class SuperpixelsTest : public testing::Test {
 protected:
  Result<std::vector<Superpixels>> Build(const SuperpixelOptions& options = {},
                                         int threads = 1) const {
    ThreadPool pool(threads);
    RunContext context{pool};
    return BuildSuperpixels(pictures_.set, options, context);
  }

  test::PictureSet pictures_;
};

/// Noise of a few grey values over a red, a green and a blue stripe that lean.
int StripeAt(int x, int y, int width) { return std::clamp(3 * (x + y / 4) / width, 0, 2); }
cv::Mat Stripes(int width, int height, uint64_t seed) {
  cv::RNG random(seed);
  cv::Mat picture(height, width, CV_8UC3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      cv::Vec3b color(60, 60, 60);
      color[StripeAt(x, y, width)] = 200;
      for (int c = 0; c < 3; ++c) color[c] = static_cast<uint8_t>(color[c] + random.uniform(0, 8));
      picture.at<cv::Vec3b>(y, x) = color;
    }
  }
  return picture;
}

/// Every label 0 .. count-1 is there and its pixels hang together by their sides; the neighbours
/// are those whose pixels touch by side or corner.
void ExpectWellFormed(const Superpixels& map) {
  const int width = map.width_px, height = map.height_px;
  ASSERT_EQ(map.labels.size(), static_cast<size_t>(width) * height);
  const auto label = [&](int x, int y) { return map.labels[static_cast<size_t>(y) * width + x]; };
  std::vector<std::set<uint16_t>> touching(map.neighbours.size());
  std::vector<int> pieces(map.neighbours.size(), 0);
  cv::Mat reached = cv::Mat::zeros(height, width, CV_8U);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      ASSERT_LT(label(x, y), map.neighbours.size());
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
          if (x + dx < 0 || x + dx >= width || y + dy < 0 || y + dy >= height) continue;
          if (label(x + dx, y + dy) != label(x, y))
            touching[label(x, y)].insert(label(x + dx, y + dy));
        }
      }
      if (reached.at<uint8_t>(y, x)) continue;
      ++pieces[label(x, y)];
      std::vector<cv::Point> open = {{x, y}};
      reached.at<uint8_t>(y, x) = 1;
      while (!open.empty()) {
        const cv::Point at = open.back();
        open.pop_back();
        for (const cv::Point& step : {cv::Point{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
          const cv::Point to = at + step;
          if (to.x < 0 || to.x >= width || to.y < 0 || to.y >= height) continue;
          if (reached.at<uint8_t>(to) || label(to.x, to.y) != label(x, y)) continue;
          reached.at<uint8_t>(to) = 1;
          open.push_back(to);
        }
      }
    }
  }
  for (size_t i = 0; i < touching.size(); ++i) {
    EXPECT_EQ(pieces[i], 1) << "label " << i;
    EXPECT_EQ(map.neighbours[i], std::vector(touching[i].begin(), touching[i].end()));
  }
}

TEST_F(SuperpixelsTest, PatchesFollowColourAndHangTogether) {
  constexpr int kWidth = 240, kHeight = 160, kCount = 150;
  pictures_.Add(Stripes(kWidth, kHeight, 3));
  const auto maps = Build({.picture_px = 1e6, .count = kCount});
  ASSERT_TRUE(maps.ok()) << maps.error().ToString();
  const Superpixels& map = (*maps)[0];
  EXPECT_EQ(map.map_from_picture, 1);
  EXPECT_EQ(map.width_px, kWidth);
  EXPECT_EQ(map.height_px, kHeight);
  ExpectWellFormed(map);
  EXPECT_NEAR(static_cast<double>(map.neighbours.size()), kCount, 0.2 * kCount);

  std::map<uint16_t, std::map<int, int>> stripes;  // by label: pixels of each stripe
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      ++stripes[map.labels[static_cast<size_t>(y) * kWidth + x]][StripeAt(x, y, kWidth)];
    }
  }
  int strangers = 0;
  for (const auto& [label, pixels] : stripes) {
    int all = 0, most = 0;
    for (const auto& [stripe, count] : pixels) all += count, most = std::max(most, count);
    strangers += all - most;
  }
  // A grid of the same count that does not look at colour leaves about a tenth of them.
  EXPECT_LT(strangers, kWidth * kHeight / 500);
}

TEST_F(SuperpixelsTest, AReducedMapIsAskedInPicturePixels) {
  pictures_.Add(Stripes(800, 600, 4));
  const auto maps = Build({.picture_px = 30000, .count = 100});
  ASSERT_TRUE(maps.ok()) << maps.error().ToString();
  const Superpixels& map = (*maps)[0];
  EXPECT_EQ(map.width_px, 200);
  EXPECT_EQ(map.height_px, 150);
  EXPECT_DOUBLE_EQ(map.map_from_picture, 0.25);
  ExpectWellFormed(map);
  const auto label = [&](size_t x, size_t y) { return map.labels[y * 200 + x]; };
  // Picture pixels 4 x to 4 x + 3, whose centres lie half a pixel further, are map pixel x.
  for (size_t x = 0; x < 200; x += 7) {
    for (size_t y = 0; y < 150; y += 7) {
      const auto left = static_cast<float>(4 * x), top = static_cast<float>(4 * y);
      EXPECT_EQ(map.LabelAt(left + 0.5F, top + 0.5F), label(x, y));
      EXPECT_EQ(map.LabelAt(left + 3.5F, top + 3.5F), label(x, y));
    }
  }
  EXPECT_EQ(map.LabelAt(-3, -0.1F), label(0, 0));
  EXPECT_EQ(map.LabelAt(800, 1e6F), label(199, 149));
  constexpr float kInfinite = std::numeric_limits<float>::infinity();
  EXPECT_EQ(map.LabelAt(1e30F, kInfinite), label(199, 149));
  EXPECT_EQ(map.LabelAt(-kInfinite, -1e30F), label(0, 0));
  EXPECT_EQ(map.LabelAt(std::nanf(""), 1e30F), label(0, 149));
}

TEST_F(SuperpixelsTest, FramesWithoutPictureHaveNoLabels) {
  pictures_.Add(Stripes(60, 40, 1));
  pictures_.Add(Stripes(60, 40, 1), "missing");
  pictures_.Add(Stripes(60, 40, 1));
  fs::remove(pictures_.set.folder / pictures_.set.frames[1].file);
  const auto maps = Build();
  ASSERT_TRUE(maps.ok()) << maps.error().ToString();
  ASSERT_EQ(maps->size(), 3U);
  EXPECT_FALSE((*maps)[0].labels.empty());
  EXPECT_TRUE((*maps)[1].labels.empty());
  EXPECT_TRUE((*maps)[1].neighbours.empty());
  EXPECT_EQ((*maps)[2].labels, (*maps)[0].labels);
}

TEST_F(SuperpixelsTest, TheSmallestPicturesAreOnePatchOrMore) {
  for (const cv::Size& size :
       {cv::Size{1, 1}, {2, 1}, {1, 7}, {3, 3}, {5, 4}, {2, 300}, {6, 6}, {300, 6}, {7, 9}}) {
    pictures_.Add(Stripes(size.width, size.height, 2));
  }
  const auto maps = Build();
  ASSERT_TRUE(maps.ok()) << maps.error().ToString();
  for (const Superpixels& map : *maps) {
    EXPECT_GE(map.neighbours.size(), 1U);
    ExpectWellFormed(map);
  }
}

TEST_F(SuperpixelsTest, TheSameOnAnyNumberOfThreads) {
  for (uint64_t seed = 0; seed < 6; ++seed) pictures_.Add(Stripes(300, 200, seed));
  const auto one = Build({}, 1), three = Build({}, 3);
  ASSERT_TRUE(one.ok() && three.ok());
  for (size_t i = 0; i < one->size(); ++i) {
    EXPECT_EQ((*one)[i].labels, (*three)[i].labels);
    EXPECT_EQ((*one)[i].neighbours, (*three)[i].neighbours);
  }
}

TEST_F(SuperpixelsTest, BadPicturesAreNamed) {
  pictures_.Add(Stripes(60, 40, 1));
  std::ofstream(pictures_.set.folder / pictures_.set.frames[0].file) << "no picture";
  const auto broken = Build();
  ASSERT_FALSE(broken.ok());
  EXPECT_EQ(broken.error().code, ErrorCode::kBadInput);
  EXPECT_NE(broken.error().context.find("c0.png"), std::string::npos);

  cv::imwrite((pictures_.set.folder / pictures_.set.frames[0].file).string(), Stripes(61, 40, 1));
  const auto other_size = Build();
  ASSERT_FALSE(other_size.ok());
  EXPECT_EQ(other_size.error().code, ErrorCode::kBadInput);
  EXPECT_NE(other_size.error().message.find("61x40"), std::string::npos);
}

TEST_F(SuperpixelsTest, StopsWhenTold) {
  pictures_.Add(Stripes(60, 40, 1));
  ThreadPool pool(1);
  std::stop_source stop;
  stop.request_stop();
  RunContext context{pool, stop.get_token()};
  const auto maps = BuildSuperpixels(pictures_.set, {}, context);
  ASSERT_FALSE(maps.ok());
  EXPECT_EQ(maps.error().code, ErrorCode::kCancelled);
}

TEST_F(SuperpixelsTest, RefusesOptionsOutOfRange) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const SuperpixelOptions& bad :
       {SuperpixelOptions{.count = 0}, SuperpixelOptions{.picture_px = 1e6, .count = 50000},
        SuperpixelOptions{.picture_px = 100, .count = 1000},
        SuperpixelOptions{.picture_px = nan}}) {
    const auto maps = Build(bad);
    ASSERT_FALSE(maps.ok());
    EXPECT_EQ(maps.error().code, ErrorCode::kInvalidArgument);
  }
  EXPECT_TRUE(SuperpixelOptions{}.Validate().ok());
}

}  // namespace
}  // namespace rotunda::sfm
