#pragma once

#include <Eigen/Core>
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
  double sigma_px = 0;    // one standard deviation of each coordinate, from contrast and noise
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
  std::string unusable;  // why the whole picture was refused ("blurred: ..."); empty when usable
};

struct BoardDetectionOptions {
  /// Wrong bits of an AprilTag that are put right. Its codes differ in 11, so 2 invents nothing;
  /// OpenCV's dictionaries differ in fewer and are read as OpenCV reads them.
  int max_wrong_bits = 2;
  /// A marker's corners may be this far from where its neighbours put them, as a share of its side.
  double max_misplaced = 0.15;
  /// A corner may be this far from where its own neighbours put it, as a share of a square's side.
  double max_bent = 0.06;
  /// Widest edge (10 to 90 %) that is still a sharp picture, as a share of a square's side.
  double max_edge_width = 0.35;
  /// Squares smaller than this give corners whose neighbours blur into them.
  double min_square_px = 8;
};

/// Finds the board's markers (AprilTag families through libapriltag, the others through OpenCV) and
/// the ChArUco corners between them. `grey` is CV_8UC1; no lens has to be known. A picture without
/// the board is a detection with no corners; errors (kInvalidArgument) are a wrong kind of picture
/// and a board that is not valid. Runs on one thread and gives the same for the same picture.
Result<BoardDetection> DetectBoard(const cv::Mat& grey, const Board& board,
                                   const BoardDetectionOptions& options);

}  // namespace rotunda::rig
