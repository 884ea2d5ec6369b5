#include "tests/support/picture_set.h"

#include <opencv2/imgcodecs.hpp>

namespace rotunda::test {

void PictureSet::Add(const cv::Mat& picture, const std::string& status) {
  Frame frame;
  frame.camera = "c" + std::to_string(set.frames.size());
  frame.file = frame.camera + ".png";
  frame.width_px = picture.cols;
  frame.height_px = picture.rows;
  frame.pixel_format = picture.channels() == 1 ? "Mono8" : "RGB8";
  frame.status = status;
  cv::imwrite((set.folder / frame.file).string(), picture);
  set.frames.push_back(frame);
}

}  // namespace rotunda::test
