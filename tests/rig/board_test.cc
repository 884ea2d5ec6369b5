#include "rig/board.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <opencv2/aruco.hpp>
#include <opencv2/aruco/charuco.hpp>
#include <set>

#include "rig/board_drawing.h"

namespace rotunda::rig {
namespace {

BoardFace MakeFace(int columns, int rows, bool legacy) {
  BoardFace face;
  face.name = "a";
  face.columns = columns;
  face.rows = rows;
  face.square_m = 0.02;
  face.marker_m = 0.015;
  face.margin_m = 0.01;
  face.dictionary = "5X5_250";
  face.first_id = 7;
  face.legacy_pattern = legacy;
  return face;
}

TEST(BoardFace, MarkersStandInWhiteSquaresRowByRow) {
  for (bool legacy : {false, true}) {
    for (auto [columns, rows] : {std::pair(7, 5), {6, 5}, {7, 4}, {6, 4}, {2, 2}, {3, 3}}) {
      const BoardFace face = MakeFace(columns, rows, legacy);
      int id = face.first_id;
      for (int row = 0; row < rows; ++row) {
        for (int column = 0; column < columns; ++column) {
          if (face.IsBlack(column, row)) continue;
          ASSERT_TRUE(face.HasMarker(id)) << columns << "x" << rows << " legacy " << legacy;
          EXPECT_EQ(face.SquareOfMarker(id), Eigen::Vector2i(column, row));
          ++id;
        }
      }
      EXPECT_FALSE(face.HasMarker(id));
    }
  }
}

TEST(BoardFace, IsOpenCvsBoard) {
  // OpenCV 4.6 draws the pattern that is not legacy, its own even rows too.
  const BoardFace face = MakeFace(6, 5, false);
  const auto dictionary = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_5X5_250);
  const auto board = cv::aruco::CharucoBoard::create(6, 5, 0.02f, 0.015f, dictionary);
  ASSERT_EQ(static_cast<int>(board->ids.size()), face.MarkerCount());
  for (int i = 0; i < face.MarkerCount(); ++i) {
    const auto corners = face.MarkerInFace(face.first_id + i);
    for (int k = 0; k < 4; ++k) {
      EXPECT_NEAR(corners[k].x(), board->objPoints[i][k].x, 1e-6);
      EXPECT_NEAR(corners[k].y(), board->objPoints[i][k].y, 1e-6);
    }
  }
}

TEST(Board, CuboidsFacesMeetAtTheEdgesAndIdsAreDisjoint) {
  const Board board = CuboidBoard({});
  ASSERT_TRUE(board.Validate()) << board.Validate().error().ToString();
  std::set<int> ids;
  for (const BoardFace& face : board.faces) {
    for (int i = 0; i < face.MarkerCount(); ++i) EXPECT_TRUE(ids.insert(face.first_id + i).second);
  }
  EXPECT_LE(*ids.rbegin(), 586);
  const auto at = [&](int f, double right, double down) {  // shares of the face with its margin
    const BoardFace& face = board.faces[f];
    return face.board_from_face *
           Eigen::Vector3d(-face.margin_m + right * (face.Width_m() + 2 * face.margin_m),
                           -face.margin_m + down * (face.Height_m() + 2 * face.margin_m), 0);
  };
  for (int f = 0; f < 4; ++f) {
    EXPECT_LT((at(f, 1, 0) - at((f + 1) % 4, 0, 0)).norm(), 1e-12) << f;
    EXPECT_LT((at(f, 1, 1) - at((f + 1) % 4, 0, 1)).norm(), 1e-12) << f;
    EXPECT_NEAR(at(f, 0.5, 1).z(), 0, 1e-12);
    const Eigen::Vector3d into = board.faces[f].board_from_face.rotation * Eigen::Vector3d::UnitZ();
    EXPECT_LT(into.dot(at(f, 0.5, 0.5) - Eigen::Vector3d(0, 0, 0.77)), -0.2);
  }
  EXPECT_LT((at(4, 0, 1) - at(0, 0, 0)).norm(), 1e-12);
  EXPECT_GT(at(0, 0.5, 0.5).x(), 0.2);
}

TEST(Board, BowStandsOutTowardsTheReaderAndLeavesTheOuterCorners) {
  const Board board = CuboidBoard({});
  const BoardFace& face = board.faces[1];
  CalibratedFace real = DrawnFaces(board)[1];
  real.bow_m = {0.3e-3, 0.2e-3};
  const Eigen::Vector3d outward = face.board_from_face.rotation * -Eigen::Vector3d::UnitZ();
  const auto height = [&](double x, double y) {
    const Eigen::Vector3d at(x * face.Width_m(), y * face.Height_m(), 0);
    return outward.dot(PointOnBoard(face, real, at) - face.board_from_face * at);
  };
  EXPECT_NEAR(height(0.5, 0.5), 0.5e-3, 1e-12);
  EXPECT_NEAR(height(0, 0), 0, 1e-12);
  EXPECT_NEAR(height(0.5, 1), 0.3e-3, 1e-12);
  EXPECT_NEAR(height(0, 0.5), 0.2e-3, 1e-12);
}

/// Ink as sampled from rectangles: black or white at the middle of every cell of a marker's grid.
bool IsInk(const std::vector<InkRectangle>& ink, double x_m, double y_m) {
  for (const InkRectangle& r : ink) {
    if (x_m >= r.left_m && x_m < r.right_m && y_m >= r.top_m && y_m < r.bottom_m) return true;
  }
  return false;
}

/// The rectangles of a drawing's text, in metres in the face's frame.
std::vector<InkRectangle> FromSvg(const std::string& svg, const BoardFace& face) {
  std::vector<InkRectangle> ink;
  double x0, y0, x1, y1, back;
  for (size_t at = svg.find("\nM"); at != std::string::npos; at = svg.find("\nM", at + 1)) {
    if (std::sscanf(svg.c_str() + at, "\nM%lf %lfH%lfV%lfH%lfZ", &x0, &y0, &x1, &y1, &back) != 5) {
      continue;
    }
    EXPECT_EQ(back, x0);
    ink.push_back({1e-3 * x0 - face.margin_m, 1e-3 * y0 - face.margin_m, 1e-3 * x1 - face.margin_m,
                   1e-3 * y1 - face.margin_m});
  }
  return ink;
}

std::vector<InkRectangle> FromPdf(const std::string& pdf, const BoardFace& face) {
  constexpr double kPoint_m = 25.4e-3 / 72;
  double width = 0, height = 0;
  const size_t box = pdf.find("/MediaBox [0 0 ");
  EXPECT_EQ(std::sscanf(pdf.c_str() + box, "/MediaBox [0 0 %lf %lf]", &width, &height), 2);
  EXPECT_NEAR(width * kPoint_m, face.Width_m() + 2 * face.margin_m, 1e-8);
  std::vector<InkRectangle> ink;
  for (size_t at = pdf.find("0 g\n") + 3; pdf.compare(at, 3, "\nf\n") != 0;
       at = pdf.find('\n', at + 1)) {
    double x, y, w, h;
    if (std::sscanf(pdf.c_str() + at, "\n%lf %lf %lf %lf re", &x, &y, &w, &h) != 4) {
      ADD_FAILURE() << pdf.substr(at, 60);
      break;
    }
    const double top = height - y - h;
    ink.push_back({x * kPoint_m - face.margin_m, top * kPoint_m - face.margin_m,
                   (x + w) * kPoint_m - face.margin_m, (top + h) * kPoint_m - face.margin_m});
  }
  return ink;
}

TEST(BoardDrawing, SvgAndPdfShowOpenCvsMarkersAtTrueSize) {
  const BoardFace face = MakeFace(5, 4, false);
  const auto dictionary = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_5X5_250);
  const auto svg = FaceSvg(face, "test"), pdf = FacePdf(face, "test");
  ASSERT_TRUE(svg && pdf);
  EXPECT_NE(svg->find("width=\"120.00000mm\" height=\"114.00000mm\""), std::string::npos);
  for (const auto& ink : {FromSvg(*svg, face), FromPdf(*pdf, face)}) {
    ASSERT_GT(ink.size(), 10u);
    for (int row = 0; row < face.rows; ++row) {
      for (int column = 0; column < face.columns; ++column) {
        for (double inset : {0.02, 0.98}) {  // white ones are white up to their edges, too
          EXPECT_EQ(IsInk(ink, (column + inset) * face.square_m, (row + inset) * face.square_m),
                    face.IsBlack(column, row));
        }
      }
    }
    for (int id = face.first_id; id < face.first_id + face.MarkerCount(); ++id) {
      cv::Mat tag;
      cv::aruco::drawMarker(dictionary, id, 7, tag, 1);
      const Eigen::Vector3d corner = face.MarkerInFace(id)[0];
      for (int y = 0; y < 7; ++y) {
        for (int x = 0; x < 7; ++x) {
          EXPECT_EQ(IsInk(ink, corner.x() + (x + 0.5) * face.marker_m / 7,
                          corner.y() + (y + 0.5) * face.marker_m / 7),
                    tag.at<uint8_t>(y, x) < 128);
        }
      }
    }
  }
}

/// As a calibration from this board has it: every face, a little off its drawing.
Calibration MadeWith(const Board& board) {
  Calibration calibration;
  calibration.board = DrawnFaces(board);
  for (size_t f = 0; f < board.faces.size(); ++f) {
    calibration.board[f].print = PrintOf(board.faces[f]);
    calibration.board[f].board_from_face.translation.x() += 0.1;
  }
  return calibration;
}

TEST(SameTarget, WhereTheFacesStandMayDiffer) {
  const Board board = CuboidBoard({});
  EXPECT_TRUE(CheckSameTarget(board, MadeWith(board), "monday.json").ok());
  EXPECT_EQ(TargetChange(MadeWith(board), MadeWith(board)), "");
  EXPECT_TRUE(CheckSameTarget(board, Calibration(), "monday.json").ok()) << "it does not say";
  Calibration unsaid = MadeWith(board);
  for (CalibratedFace& face : unsaid.board) face.print.reset();
  EXPECT_TRUE(CheckSameTarget(CuboidBoard({.rows = 23}), unsaid, "monday.json").ok());
}

/// Another target than the shipped one is refused, with its difference.
void ExpectRefused(const Board& board, const std::string& context, const std::string& says) {
  const Status same = CheckSameTarget(board, MadeWith(CuboidBoard({})), "monday.json");
  ASSERT_FALSE(same.ok()) << context;
  EXPECT_EQ(same.error().code, ErrorCode::kBadInput);
  EXPECT_EQ(same.error().context, context);
  EXPECT_NE(same.error().message.find(says), std::string::npos) << same.error().message;
}

TEST(SameTarget, WhatIsPrintedMayNot) {
  const std::string made = ", but monday.json was made with ";
  ExpectRefused(CuboidBoard({.rows = 23}), "rows of face 'front'", "is 23" + made + "25");
  ExpectRefused(CuboidBoard({.columns = 9}), "columns of face 'front'", "is 9" + made + "7");
  ExpectRefused(CuboidBoard({.square_m = 0.061}), "square_mm of face 'front'",
                "is 61" + made + "60");
  ExpectRefused(CuboidBoard({.marker_m = 0.044}), "marker_mm of face 'front'",
                "is 44" + made + "45");
  ExpectRefused(CuboidBoard({.dictionary = "APRILTAG_36h10"}), "dictionary of face 'front'",
                "is APRILTAG_36h10" + made + "APRILTAG_36h11");
  ExpectRefused(CuboidBoard({.top = false}), "face 'top'", "is not there, but monday.json");
  Board shifted = CuboidBoard({});
  for (BoardFace& face : shifted.faces) ++face.first_id;
  ExpectRefused(shifted, "first_id of face 'front'", "is 1" + made + "0");
  EXPECT_EQ(TargetChange(MadeWith(CuboidBoard({})), MadeWith(CuboidBoard({.rows = 23}))),
            "rows of face 'front': 25 before, 23 after");
}

TEST(SameTarget, LengthsAsAFileRoundsThemAreTheSame) {
  const Board board = CuboidBoard({.square_m = 1e-3 * 60.3});
  Calibration monday = MadeWith(board);
  monday.board[0].print->square_mm = 60.3;
  EXPECT_TRUE(CheckSameTarget(board, monday, "monday.json").ok());
}

}  // namespace
}  // namespace rotunda::rig
