#pragma once

#include <Eigen/Core>
#include <array>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "rig/board.h"
#include "sfm/core/result.h"

namespace rotunda::rig {

/// A ChArUco corner found in a picture.
struct BoardCorner {
  int face = 0;           // place in Board::faces
  int corner = 0;         // as in BoardFace::CornerInFace
  Eigen::Vector2d pixel;  // (0.5, 0.5) is the centre of the top-left pixel
  double sigma_px = 0;    // one standard deviation of each coordinate, from contrast and blur
};

struct RejectedMarker {
  std::string dictionary;
  int id = -1;
  Eigen::Vector2d centre_px;
  std::string reason;  // for the operator: "id 530 is on no face of the board", "mirrored", ...
};

/// What one picture shows of a board; corners sorted by face and corner.
struct BoardDetection {
  std::vector<BoardCorner> corners;
  std::vector<RejectedMarker> rejected;
  int markers_found = 0;     // of the board, after rejection
  double edge_width_px = 0;  // of the squares' edges, 10 to 90 %; large when blurred
  std::string unusable;      // why the whole picture was refused ("blurred: ..."); empty when usable
};

}  // namespace rotunda::rig
