#pragma once

#include <map>
#include <string>

namespace rotunda::rig {

/// The lens parameters that calibration finds; the models but the first are stored as FULL_OPENCV.
enum class LensModel {
  kOpencv,      // fx fy cx cy k1 k2 p1 p2
  kOpencv5,     // and k3
  kFullOpencv,  // and k4 k5 k6
};

/// As an operator and a request name them: "opencv", "opencv5", "full-opencv".
const std::map<std::string, LensModel>& LensModelsByName();

}  // namespace rotunda::rig
