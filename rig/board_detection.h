#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "rig/board.h"
#include "rig/corner_fit.h"
#include "rig/marker_detection.h"
#include "sfm/core/result.h"

namespace cv {
class Mat;
}

namespace rotunda::rig {

/// A ChArUco corner found in a picture.
struct BoardCorner {
  int face = 0;           // place in Board::faces
  int corner = 0;         // as in BoardFace::CornerInFace
  Eigen::Vector2d pixel;  // (0.5, 0.5) is the centre of the top-left pixel
  double sigma_px = 0;    // one standard deviation of each coordinate, from contrast and noise
};

/// Kinds of reasons not to use a marker: what they are counted by.
enum class Rejection { kAlone, kMisplaced, kOnNoFace, kSeenTwice };

struct RejectionText {
  const char* name;    // "seen twice"
  const char* remedy;  // for the operator: what it means, and what to do
};
RejectionText TextOf(Rejection kind);
RejectionText TextOf(CornerRejection kind);

struct RejectedMarker {
  std::string dictionary;
  int id = -1;
  Eigen::Vector2d centre_px;
  Rejection kind = Rejection::kOnNoFace;
  std::string reason;  // for the operator: "id 530 is on no face of the board", ...
};

/// A corner that was looked for, as markers or corners around it put it in the picture, in vain.
struct RejectedCorner {
  int face = 0;  // as in BoardCorner
  int corner = 0;
  CornerRejection kind = CornerRejection::kUnclear;
};

/// What one picture shows of a board; corners sorted by face and corner.
struct BoardDetection {
  std::vector<BoardCorner> corners;
  std::vector<RejectedMarker> rejected;
  std::vector<RejectedCorner> rejected_corners;
  int markers_found = 0;     // of the board, after rejection
  double edge_width_px = 0;  // of the squares' edges, 10 to 90 %; large when blurred
  /// Why the whole picture was refused ("blurred: ...", "mirrored: ..."); empty when usable. It
  /// then has no corners, nor rejected ones.
  std::string unusable;
  /// Why hardly a marker could be read in a usable picture, and what to do ("small: its markers are
  /// 9 px wide, ..."); empty when enough were, or nobody knows.
  std::string few_markers;
};

struct BoardDetectionOptions {
  MarkerDetectionOptions markers;
  CornerFitOptions corners;
  /// Two markers of a face are compared when they are at most this many squares apart: over more,
  /// a wide-angle lens bends the face by more than `max_misplaced`.
  int neighbourhood_squares = 4;
  /// A marker's corners may be this far from where a neighbour puts them, as a share of its side.
  /// Detectors find them to 0.02 to 0.05 of it; a marker of another board is off by 0.3 and more.
  double max_misplaced = 0.15;
  /// A corner may be this far from where the corners around it put it, as a share of a square's
  /// side; lens and bow make 0.005. At the rim of a wide-angle lens it is up to 0.08: there it may
  /// be this far from the parabola that the corners around it make.
  double max_bent = 0.03;
  /// Squares narrower than this give corners whose neighbours blur into them.
  double min_square_px = 7;
  /// Widest edge (10 to 90 %) of a usable picture. Lenses in focus give 1.5 to 4 px; at 8 px
  /// something moved or is out of focus, and corners are off by what moved.
  double max_edge_width_px = 8;
};

/// Finds the board's markers (AprilTag families through libapriltag, the others through OpenCV) and
/// the ChArUco corners between them. `grey` is CV_8UC1; no lens has to be known. A picture without
/// the board is a detection with no corners; errors (kInvalidArgument) are a wrong kind of picture
/// and a board that is not valid. Runs on one thread and gives the same for the same picture.
Result<BoardDetection> DetectBoard(const cv::Mat& grey, const Board& board,
                                   const BoardDetectionOptions& options);

}  // namespace rotunda::rig
