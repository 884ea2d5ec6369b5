#include "sfm/features.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <numeric>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

#include "tests/support/picture_set.h"

namespace rotunda::sfm {
namespace {

namespace fs = std::filesystem;

class FeaturesTest : public testing::Test {
 protected:
  Result<Features> Build(const FeatureOptions& options = {}, int threads = 1) const {
    ThreadPool pool(threads);
    RunContext context{pool};
    return BuildFeatures(pictures_.set, options, context);
  }

  test::PictureSet pictures_;
};

/// A Gaussian blob on grey; pixel (0, 0) has its centre at (0.5, 0.5).
cv::Mat Blob(double x_px, double y_px, double sigma_px, double height) {
  const int size = static_cast<int>(40 * sigma_px) + 33;
  cv::Mat picture(size, size, CV_8UC1);
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      const double dx = x + 0.5 - x_px, dy = y + 0.5 - y_px;
      const double value =
          128 + height * std::exp(-(dx * dx + dy * dy) / (2 * sigma_px * sigma_px));
      picture.at<uint8_t>(y, x) = cv::saturate_cast<uint8_t>(value);
    }
  }
  return picture;
}

const Keypoint& Nearest(const ImageFeatures& image, double x_px, double y_px) {
  const auto distance = [&](const Keypoint& k) { return std::hypot(k.x_px - x_px, k.y_px - y_px); };
  return *std::min_element(
      image.keypoints.begin(), image.keypoints.end(),
      [&](const Keypoint& a, const Keypoint& b) { return distance(a) < distance(b); });
}

// The half pixel between OpenCV's and our coordinates and the quarter of the doubled picture: a
// keypoint must sit on the blob, at every octave. A blob is an extremum of the difference of
// Gaussians when its sigma is the geometric mean of the two; the keypoint names the smaller one.
TEST_F(FeaturesTest, KeypointsSitOnTheBlobAtEveryOctave) {
  std::mt19937_64 random(4);
  struct Truth {
    double x_px, y_px, sigma_px;
  };
  std::vector<Truth> truth;
  for (double sigma_px : {1.2, 2.0, 4.0, 8.0, 12.0}) {
    for (int i = 0; i < 8; ++i) {
      const double middle = 20 * sigma_px + 16;
      truth.push_back({middle + static_cast<double>(random() % 1000) / 500,
                       middle - static_cast<double>(random() % 1000) / 500, sigma_px});
      pictures_.Add(Blob(truth.back().x_px, truth.back().y_px, sigma_px, i % 2 == 0 ? 100 : -100));
    }
  }
  const auto features = Build({.contrast_threshold = 0.02});
  ASSERT_TRUE(features.ok());
  for (size_t begin = 0; begin < truth.size(); begin += 8) {
    const double sigma_px = truth[begin].sigma_px;
    double mean_x = 0, mean_y = 0;
    for (size_t i = begin; i < begin + 8; ++i) {
      const Keypoint& k = Nearest(features->images[i], truth[i].x_px, truth[i].y_px);
      // Each is off by what interpolation between samples of its octave leaves.
      EXPECT_NEAR(k.x_px, truth[i].x_px, 0.01 + 0.01 * sigma_px);
      EXPECT_NEAR(k.y_px, truth[i].y_px, 0.01 + 0.01 * sigma_px);
      EXPECT_NEAR(k.scale_px, sigma_px * std::exp2(-1.0 / 6), 0.03 * sigma_px);
      mean_x += (k.x_px - truth[i].x_px) / 8;
      mean_y += (k.y_px - truth[i].y_px) / 8;
    }
    EXPECT_NEAR(mean_x, 0, 0.01 + 0.005 * sigma_px) << "sigma " << sigma_px;
    EXPECT_NEAR(mean_y, 0, 0.01 + 0.005 * sigma_px) << "sigma " << sigma_px;
  }
}

/// Blurred noise: keypoints everywhere.
cv::Mat Texture(uint64_t seed, int width, int height) {
  std::mt19937_64 random(seed);
  cv::Mat picture(height, width, CV_8UC3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      picture.at<cv::Vec3b>(y, x) = {static_cast<uint8_t>(random()), static_cast<uint8_t>(random()),
                                     static_cast<uint8_t>(random())};
    }
  }
  cv::GaussianBlur(picture, picture, {}, 1.5);
  cv::normalize(picture, picture, 0, 255, cv::NORM_MINMAX);
  return picture;
}

// A faint picture is searched again, down to the faint threshold, for as many as are enough; one
// that has enough at once is left as it is.
TEST_F(FeaturesTest, FaintPicturesAreSearchedAgain) {
  cv::Mat faint;
  Texture(7, 320, 240).convertTo(faint, CV_8UC3, 0.12, 110);
  pictures_.Add(Texture(7, 320, 240));
  pictures_.Add(faint);
  const auto once = Build({.enough_keypoints = 0});
  const auto again = Build({.enough_keypoints = 150});
  ASSERT_TRUE(once.ok() && again.ok());
  ASSERT_GT(once->images[0].keypoints.size(), 150u);
  EXPECT_EQ(again->images[0].keypoints.size(), once->images[0].keypoints.size());
  ASSERT_LT(once->images[1].keypoints.size(), 100u);
  EXPECT_GT(again->images[1].keypoints.size(), once->images[1].keypoints.size() + 50);
  EXPECT_LE(again->images[1].keypoints.size(), 160u) << "those of equal strength may come along";
}

TEST_F(FeaturesTest, DescriptorsAreRootSiftAndTurnWithThePicture) {
  const cv::Mat texture = Texture(1, 200, 160);
  cv::Mat turned;
  cv::rotate(texture, turned, cv::ROTATE_90_CLOCKWISE);
  pictures_.Add(texture);
  pictures_.Add(turned);
  const auto features = Build();
  ASSERT_TRUE(features.ok());
  const ImageFeatures &a = features->images[0], &b = features->images[1];
  ASSERT_GT(a.keypoints.size(), 100U);
  EXPECT_EQ(a.descriptors.size(), a.keypoints.size() * kDescriptorSize);
  EXPECT_EQ(a.colors_rgb.size(), a.keypoints.size());
  size_t found = 0;
  for (size_t i = 0; i < a.keypoints.size(); ++i) {
    const uint8_t* descriptor = &a.descriptors[i * kDescriptorSize];
    const double norm2 =
        std::inner_product(descriptor, descriptor + kDescriptorSize, descriptor, 0.0);
    EXPECT_NEAR(std::sqrt(norm2), 512, 10);
    // Clockwise: (x, y) comes to (height - y, x), orientations grow by a right angle (x to y).
    const Keypoint& k = a.keypoints[i];
    for (const Keypoint& other : b.keypoints) {
      const double distance = std::hypot(other.x_px - (160 - k.y_px), other.y_px - k.x_px);
      const double turn =
          std::remainder(other.orientation_rad - k.orientation_rad - M_PI / 2, 2 * M_PI);
      if (distance < 0.3 && std::abs(turn) < 0.1) {
        ++found;
        break;
      }
    }
  }
  EXPECT_GT(found, a.keypoints.size() * 7 / 10);
}

TEST_F(FeaturesTest, KeepsTheStrongestAndAtMostTwoOrientations) {
  pictures_.Add(Texture(2, 300, 300));
  const auto all = Build(), few = Build({.max_keypoints = 100});
  ASSERT_TRUE(all.ok() && few.ok());
  const std::vector<Keypoint>&strong = few->images[0].keypoints, &every = all->images[0].keypoints;
  EXPECT_LE(strong.size(), 100U);
  EXPECT_GE(strong.size(), 80U);  // places with three orientations lose one or two
  ASSERT_GT(every.size(), 200U);
  for (size_t i = 0; i < strong.size(); ++i) {
    EXPECT_EQ(strong[i].x_px, every[i].x_px);
    EXPECT_EQ(strong[i].y_px, every[i].y_px);
  }
  for (const Keypoint& k : every) {
    const auto same = std::count_if(every.begin(), every.end(), [&](const Keypoint& other) {
      return other.x_px == k.x_px && other.y_px == k.y_px && other.scale_px == k.scale_px;
    });
    EXPECT_LE(same, 2);
  }
}

TEST_F(FeaturesTest, ColoursAreThePictures) {
  cv::Mat picture(100, 100, CV_8UC3, cv::Scalar(10, 20, 30));
  cv::circle(picture, {50, 50}, 8, cv::Scalar(200, 150, 100), cv::FILLED);
  pictures_.Add(picture);
  const auto features = Build();
  ASSERT_TRUE(features.ok());
  const ImageFeatures& image = features->images[0];
  const Keypoint& k = Nearest(image, 50.5, 50.5);
  const auto place = static_cast<size_t>(&k - image.keypoints.data());
  EXPECT_EQ(image.colors_rgb[place], (std::array<uint8_t, 3>{100, 150, 200}));
}

TEST_F(FeaturesTest, SameOnAnyNumberOfThreads) {
  for (uint64_t seed = 0; seed < 4; ++seed) pictures_.Add(Texture(seed, 160, 120));
  const auto serial = Build({}, 1), parallel = Build({}, 4);
  ASSERT_TRUE(serial.ok() && parallel.ok());
  for (size_t i = 0; i < 4; ++i) {
    const ImageFeatures &a = serial->images[i], &b = parallel->images[i];
    EXPECT_EQ(a.descriptors, b.descriptors);
    EXPECT_EQ(a.colors_rgb, b.colors_rgb);
    ASSERT_EQ(a.keypoints.size(), b.keypoints.size());
    for (size_t k = 0; k < a.keypoints.size(); ++k) {
      EXPECT_EQ(a.keypoints[k].x_px, b.keypoints[k].x_px);
      EXPECT_EQ(a.keypoints[k].y_px, b.keypoints[k].y_px);
      EXPECT_EQ(a.keypoints[k].orientation_rad, b.keypoints[k].orientation_rad);
    }
  }
}

TEST_F(FeaturesTest, MissingFramesAndBlankPicturesHaveNoKeypoints) {
  pictures_.Add(Texture(1, 80, 60), "missing");
  fs::remove(pictures_.set.folder / "c0.png");
  pictures_.Add(cv::Mat(60, 80, CV_8UC3, cv::Scalar(128, 128, 128)));
  const auto features = Build();
  ASSERT_TRUE(features.ok());
  ASSERT_EQ(features->images.size(), 2U);
  for (const ImageFeatures& image : features->images) {
    EXPECT_TRUE(image.keypoints.empty());
    EXPECT_EQ(image.width_px, 80);
    EXPECT_EQ(image.height_px, 60);
  }
}

TEST_F(FeaturesTest, BadPicturesAreNamed) {
  pictures_.Add(Texture(1, 80, 60));
  pictures_.Add(Texture(2, 80, 60));
  fs::resize_file(pictures_.set.folder / "c1.png",
                  fs::file_size(pictures_.set.folder / "c1.png") / 2);
  const auto cut = Build();
  ASSERT_FALSE(cut.ok());
  EXPECT_EQ(cut.error().code, ErrorCode::kBadInput);
  EXPECT_NE(cut.error().context.find("c1.png"), std::string::npos);

  pictures_.set.frames.pop_back();
  pictures_.set.frames[0].width_px = 81;
  const auto other_size = Build();
  ASSERT_FALSE(other_size.ok());
  EXPECT_NE(other_size.error().message.find("80x60"), std::string::npos);
  EXPECT_NE(other_size.error().message.find("81x60"), std::string::npos);
  EXPECT_NE(other_size.error().context.find("c0.png"), std::string::npos);

  const auto bad_option = Build({.max_keypoints = 0});
  ASSERT_FALSE(bad_option.ok());
  EXPECT_EQ(bad_option.error().code, ErrorCode::kInvalidArgument);
}

}  // namespace
}  // namespace rotunda::sfm
