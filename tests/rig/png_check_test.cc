#include "rig/png_check.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <vector>

namespace rotunda::rig {
namespace {

std::string MakePng() {
  std::vector<unsigned char> bytes;
  cv::imencode(".png", cv::Mat(40, 30, CV_8UC1, cv::Scalar(7)), bytes);
  return {bytes.begin(), bytes.end()};
}

TEST(PngProblem, SaysWhetherAFileIsWhole) {
  const std::string png = MakePng();
  EXPECT_EQ(PngProblem(png), "");
  for (size_t size = 8; size < png.size(); ++size) {
    EXPECT_NE(PngProblem(png.substr(0, size)).find("cut short"), std::string::npos) << size;
  }
  EXPECT_EQ(PngProblem("no picture at all"), "");
  EXPECT_EQ(PngProblem(""), "");
}

TEST(PngProblem, SaysWhereAChecksumIsWrong) {
  std::string png = MakePng();
  png[8 + 8] ^= 1;  // the picture's width
  EXPECT_EQ(PngProblem(png), "the PNG is damaged: a checksum is wrong at byte 8");
}

}  // namespace
}  // namespace rotunda::rig
