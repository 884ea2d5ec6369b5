#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "sfm/core/calibration.h"
#include "sfm/core/result.h"
#include "sfm/core/rigid3.h"

namespace rotunda::rig {

/// One flat ChArUco board. Its frame, in metres: origin at the outer corner of the top-left square
/// as seen from where the print is read, x right, y down, z into the board (away from the reader).
/// Squares alternate; the top-left one is black, except with `legacy_pattern` and an even number of
/// rows, where it is white. The white ones carry markers, numbered row by row from `first_id`.
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

  bool IsBlack(int column, int row) const;
  double Width_m() const { return columns * square_m; }  // of the squares, without the margin
  double Height_m() const { return rows * square_m; }

  int MarkerCount() const;
  bool HasMarker(int id) const { return id >= first_id && id < first_id + MarkerCount(); }
  /// Square that a marker stands in: (column, row). `id` is one of this face's.
  Eigen::Vector2i SquareOfMarker(int id) const;
  /// Corners of a marker in the face's frame: top-left, top-right, bottom-right, bottom-left as
  /// printed.
  std::vector<Eigen::Vector3d> MarkerInFace(int id) const;

  /// Inner corners, where four squares meet: (columns - 1) * (rows - 1), row by row.
  int CornerCount() const { return (columns - 1) * (rows - 1); }
  Eigen::Vector3d CornerInFace(int corner) const;
};

/// Where the rig frame is: which shot it hangs on, and how the target stands in it then.
struct RigFrameSetting {
  std::string shot;  // id; empty: the first one given
  /// The origin of the board frame in the rig frame: x and y from the rig's axis, z above the
  /// floor.
  Eigen::Vector3d board_origin_m = Eigen::Vector3d::Zero();
  double front_rad = 0;  // from the rig's front (x axis) to the board's, about the axis, upwards
};

/// A rigid target of one or more ChArUco boards: a single board, a cuboid, a cube, several boards
/// screwed together. How far the real one may be from the drawing (one standard deviation) is what
/// calibration takes as prior; infinite where the drawing says nothing.
struct Board {
  std::string name = "board";
  std::vector<BoardFace> faces;
  double face_position_sigma_m = 1e-3;
  double face_rotation_sigma_rad = RadFromDeg(0.2);
  RigFrameSetting rig_frame;
  double bow_sigma_m = 0.5e-3;  // of both parts of CalibratedFace::bow_m; 0: the boards are flat

  /// All that is wrong, kInvalidArgument each; the context is the key of the board file:
  /// "face[1].rows" (counted from 0).
  std::vector<Error> Problems() const;
  /// The first of them.
  Status Validate() const;
};

/// The bow of a face. A face with bow (b_x, b_y) = CalibratedFace::bow_m stands out towards its
/// reader by
///     height(x, y) = b_x (1 - u^2) + b_y (1 - v^2),  u = 2 x / width - 1,  v = 2 y / height - 1,
/// width and height those of its squares: b_x bends it about the vertical, b_y about the horizontal
/// axis; the outer corners of the squares stay where they are and the middle stands out by
/// b_x + b_y. (mrcal's "calobject_warp".) The point (x, y, 0) of the drawing so is at
/// (x, y, -height). BowShape gives (1 - u^2, 1 - v^2): height = BowShape . bow_m.
Eigen::Vector2d BowShape(const BoardFace& face, double x_m, double y_m);

/// A point of the drawing on the face as it is: bowed and placed, in the board's frame.
Eigen::Vector3d PointOnBoard(const BoardFace& face, const CalibratedFace& real,
                             const Eigen::Vector3d& in_face);

/// The faces exactly as drawn, flat.
std::vector<CalibratedFace> DrawnFaces(const Board& board);

FacePrint PrintOf(const BoardFace& face);

/// kBadInput unless `board` is the target that a calibration, `name` in messages, was made with:
/// the error's context is the key and face that differ. Where its faces stand may differ, since
/// that is found. Of a calibration that does not say what was printed, the faces' names are
/// compared.
Status CheckSameTarget(const Board& board, const Calibration& calibration, const std::string& name);

/// What the prints of two calibrations' targets differ in first, for the operator ("rows of face
/// 'front': 25 before, 23 after"); empty when they are the same or do not say.
std::string TargetChange(const Calibration& before, const Calibration& after);

/// Four tall sides and perhaps a top: the shipped target. Ids run on from face to face in the order
/// front, left, back, right, top, from 0. Board frame: origin in the middle of the
/// bottom, z up, the front face towards +x.
struct CuboidDrawing {
  int columns = 7;  // squares across each side, and both ways on the top; odd
  int rows = 25;    // squares down each side; odd
  double square_m = 0.060;
  double marker_m = 0.045;
  double margin_m = 0.020;
  bool top = true;
  std::string dictionary = "APRILTAG_36h11";
};
Board CuboidBoard(const CuboidDrawing& drawing);

/// OpenCV's number of a dictionary. kInvalidArgument when there is none of that name (the message
/// lists all).
Result<int> OpenCvDictionary(const std::string& name);

/// The markers of a dictionary, by OpenCV: the one source of their bits. Errors as
/// OpenCvDictionary.
class MarkerDictionary {
 public:
  static Result<MarkerDictionary> Named(const std::string& name);
  int Count() const { return count_; }
  int CellsAcross() const { return cells_; }  // with the black border, one cell wide
  /// CellsAcross() * CellsAcross() cells row by row from the top-left one, true where black.
  const std::vector<bool>& Cells(int id) const { return markers_[static_cast<size_t>(id)]; }

 private:
  int count_ = 0;
  int cells_ = 0;
  std::vector<std::vector<bool>> markers_;
};

/// A black rectangle of the print, metres in the face's frame.
struct InkRectangle {
  double left_m, top_m, right_m, bottom_m;
};
/// Everything black on a face, for the printer and for the simulator: squares, and the cells of
/// markers (runs of black cells in a row are one rectangle).
Result<std::vector<InkRectangle>> FaceInk(const BoardFace& face);

}  // namespace rotunda::rig
