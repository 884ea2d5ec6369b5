#include "sfm/image_io.h"

#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

#include "sfm/exif.h"

namespace rotunda::sfm {
namespace {

namespace fs = std::filesystem;

class Pictures : public testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        fs::temp_directory_path() / ("rotunda_image_io_" + std::to_string(::getpid()) + "_" +
                                     testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  fs::path Write(const std::string& name, const std::string& bytes) {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
    return folder_ / name;
  }
  fs::path Encode(const std::string& name, const cv::Mat& picture) {
    cv::imwrite((folder_ / name).string(), picture);
    return folder_ / name;
  }
  static std::string Bytes(const fs::path& file) {
    std::ifstream stream(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }

  fs::path folder_;
};

/// Every pixel another colour.
cv::Mat Gradient(int width, int height) {
  cv::Mat bgr(height, width, CV_8UC3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      bgr.at<cv::Vec3b>(y, x) = {static_cast<uint8_t>(x * 3), static_cast<uint8_t>(y * 5),
                                 static_cast<uint8_t>(x + y)};
    }
  }
  return bgr;
}

bool Equal(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) == 0;
}

TEST_F(Pictures, PngOfEveryKindBecomesBgr) {
  const cv::Mat bgr = Gradient(40, 30);
  cv::Mat grey, grey_bgr, bgra, wide, wide_grey;
  cv::cvtColor(bgr, grey, cv::COLOR_BGR2GRAY);
  cv::cvtColor(grey, grey_bgr, cv::COLOR_GRAY2BGR);
  cv::cvtColor(bgr, bgra, cv::COLOR_BGR2BGRA);
  bgr.convertTo(wide, CV_16UC3, 257);
  grey.convertTo(wide_grey, CV_16UC1, 256, 200);
  EXPECT_TRUE(Equal(*ReadPicture(Encode("rgb8.png", bgr), "RGB8"), bgr));
  EXPECT_TRUE(Equal(*ReadPicture(Encode("rgba8.png", bgra), ""), bgr));
  EXPECT_TRUE(Equal(*ReadPicture(Encode("rgb16.png", wide), ""), bgr));
  EXPECT_TRUE(Equal(*ReadPicture(Encode("grey8.png", grey), "Mono8"), grey_bgr));
  EXPECT_TRUE(Equal(*ReadPicture(Encode("grey16.png", wide_grey), ""), grey_bgr));
  EXPECT_TRUE(Equal(*ReadPicture(Encode("picture.bmp", bgr), ""), bgr));
  EXPECT_TRUE(Equal(*ReadPicture(Encode("picture.tif", bgr), ""), bgr));
}

TEST_F(Pictures, PngCutShortAnywhereIsRefused) {
  const std::string whole = Bytes(Encode("whole.png", Gradient(64, 64)));
  for (size_t size :
       {size_t{0}, size_t{4}, size_t{20}, whole.size() / 2, whole.size() - 13, whole.size() - 1}) {
    const fs::path file = Write("cut.png", whole.substr(0, size));
    const auto picture = ReadPicture(file, "");
    ASSERT_FALSE(picture.ok()) << size;
    EXPECT_EQ(picture.error().code, ErrorCode::kBadInput) << size;
    EXPECT_NE(picture.error().context.find("cut.png"), std::string::npos);
  }
}

TEST_F(Pictures, PngWithABadChecksumIsRefused) {
  std::string bytes = Bytes(Encode("whole.png", Gradient(64, 64)));
  bytes[bytes.size() / 2] ^= 0x10;
  EXPECT_FALSE(ReadPicture(Write("damaged.png", bytes), "").ok());
}

TEST_F(Pictures, JpegCutShortIsRefused) {
  const std::string whole = Bytes(Encode("whole.jpg", Gradient(200, 200)));
  ASSERT_TRUE(ReadPicture(folder_ / "whole.jpg", "").ok());
  for (size_t size : {size_t{2}, size_t{30}, whole.size() / 2, whole.size() - 1}) {
    const auto picture = ReadPicture(Write("cut.jpg", whole.substr(0, size)), "");
    ASSERT_FALSE(picture.ok()) << size;
    EXPECT_EQ(picture.error().code, ErrorCode::kBadInput);
  }
  // What follows the end (a second picture, a maker's data) does no harm.
  EXPECT_TRUE(ReadPicture(Write("tail.jpg", whole + "trailing bytes"), "").ok());
}

TEST_F(Pictures, OtherFilesAreRefused) {
  const auto text = ReadPicture(Write("text.png", "this is not a picture"), "");
  ASSERT_FALSE(text.ok());
  EXPECT_EQ(text.error().code, ErrorCode::kBadInput);
  EXPECT_FALSE(ReadPicture(Write("empty.png", ""), "").ok());
  const auto missing = ReadPicture(folder_ / "missing.png", "");
  ASSERT_FALSE(missing.ok());
  EXPECT_EQ(missing.error().code, ErrorCode::kNotFound);
}

/// What a sensor with this first 2x2 block ("RG" = red, green / green, blue) makes of `bgr`.
cv::Mat Mosaic(const cv::Mat& bgr, const std::string& first_row) {
  const std::string second_row = {first_row == "RG"   ? std::string("GB")
                                  : first_row == "BG" ? std::string("GR")
                                  : first_row == "GR" ? std::string("BG")
                                                      : std::string("RG")};
  cv::Mat mosaic(bgr.size(), CV_8UC1);
  for (int y = 0; y < bgr.rows; ++y) {
    for (int x = 0; x < bgr.cols; ++x) {
      const char filter = (y % 2 == 0 ? first_row : second_row)[static_cast<size_t>(x % 2)];
      mosaic.at<uint8_t>(y, x) = bgr.at<cv::Vec3b>(y, x)[filter == 'B' ? 0 : filter == 'G' ? 1 : 2];
    }
  }
  return mosaic;
}

TEST_F(Pictures, BayerFormatsGiveBackTheColours) {
  // A smooth picture with three different channels, so that interpolation is nearly exact.
  cv::Mat bgr(32, 48, CV_8UC3);
  for (int y = 0; y < bgr.rows; ++y) {
    for (int x = 0; x < bgr.cols; ++x) {
      bgr.at<cv::Vec3b>(y, x) = {static_cast<uint8_t>(30 + x), static_cast<uint8_t>(120 + y),
                                 static_cast<uint8_t>(220 - x)};
    }
  }
  for (const std::string pattern : {"RG", "GR", "GB", "BG"}) {
    const fs::path file = Encode(pattern + ".png", Mosaic(bgr, pattern));
    const auto picture = ReadPicture(file, "Bayer" + pattern + "8");
    ASSERT_TRUE(picture.ok()) << pattern;
    const cv::Rect inside(2, 2, bgr.cols - 4, bgr.rows - 4);
    EXPECT_LE(cv::norm((*picture)(inside), bgr(inside), cv::NORM_INF), 2) << pattern;
  }
  EXPECT_FALSE(ReadPicture(folder_ / "RG.png", "BayerXY8").ok());
  EXPECT_FALSE(ReadPicture(Encode("colour.png", bgr), "BayerRG8").ok());
}

/// A TIFF block in either byte order, written entry by entry.
class ExifWriter {
 public:
  explicit ExifWriter(bool big_endian) : big_endian_(big_endian) {}

  std::string U(uint32_t value, size_t size) const {
    std::string bytes;
    for (size_t i = 0; i < size; ++i) {
      const size_t shift = 8 * (big_endian_ ? size - 1 - i : i);
      bytes.push_back(static_cast<char>(value >> shift & 0xFF));
    }
    return bytes;
  }
  std::string Entry(uint32_t tag, uint32_t type, uint32_t count, const std::string& value) const {
    return U(tag, 2) + U(type, 2) + U(count, 4) + (value + std::string(4, '\0')).substr(0, 4);
  }
  /// Make "ACME", focal length 50 mm, plane resolution 2000 px per cm, 4000 x 3000 pixels, and
  /// FocalLengthIn35mmFilm when it is not 0.
  std::string Block(uint32_t focal_35mm) const {
    const uint32_t ifd0_size = 2 + 2 * 12 + 4, exif_at = 8 + ifd0_size;
    const uint32_t entries = focal_35mm > 0 ? 6 : 5;
    const uint32_t data_at = exif_at + 2 + entries * 12 + 4;
    std::string exif = U(entries, 2) + Entry(0x920A, 5, 1, U(data_at, 4)) +
                       Entry(0xA002, 4, 1, U(4000, 4)) + Entry(0xA003, 3, 1, U(3000, 2)) +
                       Entry(0xA20E, 5, 1, U(data_at + 8, 4)) + Entry(0xA210, 3, 1, U(3, 2));
    if (focal_35mm > 0) exif += Entry(0xA405, 3, 1, U(focal_35mm, 2));
    return std::string(big_endian_ ? "MM" : "II") + U(42, 2) + U(8, 4) + U(2, 2) +
           Entry(0x010F, 2, 4, "ACME") + Entry(0x8769, 4, 1, U(exif_at, 4)) + U(0, 4) + exif +
           U(0, 4) + U(500, 4) + U(10, 4) + U(2000, 4) + U(1, 4);
  }

 private:
  bool big_endian_;
};

/// A JPEG with an Exif segment after SOI.
std::string WithExif(const std::string& jpeg, const std::string& block) {
  const std::string payload = std::string("Exif\0\0", 6) + block;
  const size_t length = payload.size() + 2;
  return jpeg.substr(0, 2) + "\xFF\xE1" + static_cast<char>(length >> 8) +
         static_cast<char>(length & 0xFF) + payload + jpeg.substr(2);
}

TEST_F(Pictures, ExifFocalLengthInBothByteOrders) {
  const std::string jpeg = Bytes(Encode("plain.jpg", Gradient(400, 300)));
  EXPECT_FALSE(ReadExifFocal(folder_ / "plain.jpg", 400, 300).has_value());
  for (bool big_endian : {false, true}) {
    const ExifWriter writer(big_endian);
    const fs::path film = Write("film.jpg", WithExif(jpeg, writer.Block(28)));
    const auto by_film = ReadExifFocal(film, 400, 300);
    ASSERT_TRUE(by_film.has_value());
    EXPECT_DOUBLE_EQ(by_film->focal_px, 28.0 * 400 / 36);
    EXPECT_EQ(by_film->lens_key.substr(0, 5), "ACME/");
    // 50 mm at 200 px/mm are 10000 px of 4000; the picture was resized to 400.
    const auto by_plane =
        ReadExifFocal(Write("plane.jpg", WithExif(jpeg, writer.Block(0))), 400, 300);
    ASSERT_TRUE(by_plane.has_value());
    EXPECT_DOUBLE_EQ(by_plane->focal_px, 1000.0);
    EXPECT_NE(by_plane->lens_key, by_film->lens_key);
    EXPECT_TRUE(ReadPicture(film, "").ok());
  }
}

// Whatever the bytes, the parsers return; under the sanitizers this finds reads out of bounds.
TEST_F(Pictures, DamagedExifIsSurvived) {
  const std::string jpeg = Bytes(Encode("plain.jpg", Gradient(40, 30)));
  const std::string block = ExifWriter(true).Block(28);
  for (size_t size = 0; size < block.size(); ++size) {
    ParseExif(std::string_view(block).substr(0, size));
  }
  std::mt19937_64 random(20);
  const std::string whole = WithExif(jpeg, block);
  size_t parsed = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    std::string damaged = whole;
    for (int i = 0; i < 4; ++i) damaged[random() % 200] = static_cast<char>(random());
    damaged.resize(1 + random() % damaged.size());
    const auto structure = ScanJpeg(damaged);
    if (structure) parsed += ParseExif(structure->exif).has_value();
  }
  EXPECT_GT(parsed, 1000U);  // the damage did not stop short of the EXIF parser
}

}  // namespace
}  // namespace rotunda::sfm
