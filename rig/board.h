#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "sfm/core/result.h"
#include "sfm/core/rigid3.h"

namespace rotunda::rig {

/// One flat ChArUco board. Its frame, in metres: origin at the outer corner of the top-left square
/// as seen from where the print is read, x right, y down, z into the board (away from the reader).
/// Squares alternate, the top-left one is black (`legacy_pattern` false with odd rows; see below);
/// the white ones carry markers, numbered row by row from `first_id`.
struct BoardFace {
  std::string name;  // "front"; unique on the board
  int columns = 0;   // squares
  int rows = 0;
  double square_m = 0;
  double marker_m = 0;     // edge of a marker with its black border
  double margin_m = 0;     // white around the squares
  std::string dictionary;  // as OpenCV names it, without DICT_: "APRILTAG_36h11", "6X6_1000", ...
  int first_id = 0;
  /// How the squares of a board with an even number of rows alternate: true as OpenCV before 4.6
  /// prints them. Of no effect with odd rows.
  bool legacy_pattern = false;
  Rigid3 board_from_face;  // as drawn; where it really is, calibration finds

  int MarkerCount() const;
  /// Inner corners, where four squares meet: (columns - 1) * (rows - 1), row by row.
  int CornerCount() const { return (columns - 1) * (rows - 1); }
  Eigen::Vector3d CornerInFace(int corner) const;
  /// Corners of a marker in the face's frame: top-left, top-right, bottom-right, bottom-left as
  /// printed.
  std::vector<Eigen::Vector3d> MarkerInFace(int id) const;
};

/// A rigid target of one or more ChArUco boards: a single board, a cuboid, a cube, several boards
/// screwed together. How far the real one may be from the drawing (one standard deviation) is what
/// calibration takes as prior; infinite where the drawing says nothing.
struct Board {
  std::string name;
  std::vector<BoardFace> faces;
  double face_position_sigma_m = 1e-3;
  double face_rotation_sigma_rad = 0.0035;  // 0.2 deg
  double bow_sigma_m = 0.5e-3;              // height of a face's middle over its edges; 0: flat

  Status Validate() const;
};

}  // namespace rotunda::rig
