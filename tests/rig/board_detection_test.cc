#include "rig/board_detection.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "config/board_config.h"
#include "rig/board_sightings.h"
#include "rig/mosaic_detection.h"
#include "rig/sim/board_object.h"
#include "rig/sim/simulate.h"

namespace rotunda::rig {
namespace {

constexpr int kSquare_px = 40;
constexpr int kBorder_px = 30;

Board FlatBoard(const std::string& dictionary) {
  Board board;
  BoardFace face;
  face.name = "flat";
  face.columns = 7;
  face.rows = 9;
  face.square_m = 0.04;
  face.marker_m = 0.03;
  face.dictionary = dictionary;
  board.faces = {face};
  return board;
}

/// The board as drawn, a square kSquare_px wide, its first corner at (kBorder_px, kBorder_px).
cv::Mat Draw(const BoardFace& face) {
  cv::Mat picture(face.rows * kSquare_px + 2 * kBorder_px,
                  face.columns * kSquare_px + 2 * kBorder_px, CV_8UC1, cv::Scalar(200));
  const double scale = kSquare_px / face.square_m;
  const std::vector<InkRectangle> ink = FaceInk(face).value();
  for (const InkRectangle& r : ink) {
    const auto px = [&](double m) { return kBorder_px + static_cast<int>(std::lround(m * scale)); };
    picture(cv::Range(px(r.top_m), px(r.bottom_m)), cv::Range(px(r.left_m), px(r.right_m))) = 30;
  }
  return picture;
}

BoardDetection Detect(const cv::Mat& picture, const Board& board) {
  const auto detection = DetectBoard(picture, board, {});
  EXPECT_TRUE(detection) << detection.error().ToString();
  return detection ? *detection : BoardDetection();
}

bool Rejected(const BoardDetection& detection, int id, const std::string& reason) {
  return std::any_of(detection.rejected.begin(), detection.rejected.end(), [&](const auto& r) {
    return r.id == id && r.reason.find(reason) != std::string::npos;
  });
}

class FlatPictures : public testing::TestWithParam<const char*> {};

TEST_P(FlatPictures, PixelEdgesAreWhereTheConventionHasThem) {
  const Board board = FlatBoard(GetParam());
  const BoardFace& face = board.faces[0];
  const cv::Mat picture = Draw(face);
  const auto expected = [&](const Eigen::Vector3d& in_face) -> Eigen::Vector2d {
    return Eigen::Vector2d::Constant(kBorder_px) + in_face.head<2>() * kSquare_px / face.square_m;
  };
  const BoardDetection detection = Detect(picture, board);
  EXPECT_EQ(detection.markers_found, face.MarkerCount());
  ASSERT_EQ(static_cast<int>(detection.corners.size()), face.CornerCount());
  for (const BoardCorner& corner : detection.corners) {
    EXPECT_LT((corner.pixel - expected(face.CornerInFace(corner.corner))).norm(), 0.005);
  }
  // The marker libraries' own corners, before anything is refined.
  const auto markers = DetectMarkers(picture, face.dictionary, {});
  ASSERT_TRUE(markers);
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const FoundMarker& marker : *markers) {
    for (int k = 0; k < 4; ++k) {
      const Eigen::Vector2d off = marker.corners_px[k] - expected(face.MarkerInFace(marker.id)[k]);
      EXPECT_LT(off.norm(), 1.0) << "id " << marker.id << " corner " << k;
      mean += off / (4.0 * static_cast<double>(markers->size()));
    }
  }
  // Libapriltag is off by 0.17 px on steps as sharp as these; a wrong convention by 0.7 px.
  EXPECT_LT(mean.norm(), 0.25) << mean.transpose();
}

TEST_P(FlatPictures, AMirroredPictureIsRefusedByName) {
  const Board board = FlatBoard(GetParam());
  cv::Mat mirrored;
  cv::flip(Draw(board.faces[0]), mirrored, 1);
  const BoardDetection detection = Detect(mirrored, board);
  EXPECT_EQ(detection.unusable.rfind("mirrored", 0), 0u) << detection.unusable;
  EXPECT_TRUE(detection.corners.empty());
}

TEST_P(FlatPictures, UpsideDownIsNoTrouble) {
  const Board board = FlatBoard(GetParam());
  cv::Mat turned;
  cv::rotate(Draw(board.faces[0]), turned, cv::ROTATE_180);
  const BoardDetection detection = Detect(turned, board);
  ASSERT_EQ(static_cast<int>(detection.corners.size()), board.faces[0].CornerCount());
  const Eigen::Vector2d first(turned.cols - kBorder_px - kSquare_px,
                              turned.rows - kBorder_px - kSquare_px);
  EXPECT_LT((detection.corners[0].pixel - first).norm(), 0.005);
}

TEST_P(FlatPictures, ABlurredPictureIsRefusedByName) {
  const Board board = FlatBoard(GetParam());
  for (double sigma_px : {4.0, 7.0}) {
    cv::Mat blurred;
    cv::GaussianBlur(Draw(board.faces[0]), blurred, {}, sigma_px);
    const BoardDetection detection = Detect(blurred, board);
    EXPECT_EQ(detection.unusable.rfind("blurred", 0), 0u)
        << "sigma " << sigma_px << ": '" << detection.unusable << "' markers "
        << detection.markers_found << " width " << detection.edge_width_px;
    EXPECT_TRUE(detection.corners.empty());
  }
}

TEST_P(FlatPictures, MarkersOfAnotherBoardAreNamed) {
  Board board = FlatBoard(GetParam());
  BoardFace other = board.faces[0];
  other.first_id = board.faces[0].MarkerCount() - 2;  // two ids of ours, in other places
  cv::Mat both;
  cv::hconcat(Draw(board.faces[0]), Draw(other), both);
  const BoardDetection detection = Detect(both, board);
  EXPECT_EQ(detection.markers_found, board.faces[0].MarkerCount());
  EXPECT_EQ(static_cast<int>(detection.corners.size()), board.faces[0].CornerCount());
  for (const BoardCorner& corner : detection.corners) EXPECT_LT(corner.pixel.x(), both.cols / 2);
  const int first = board.faces[0].MarkerCount();
  EXPECT_TRUE(Rejected(detection, first + 3, "is on no face of the board"));
  EXPECT_TRUE(Rejected(detection, first - 1, "flat"));
}

TEST_P(FlatPictures, ADisplacedMarkerAndADoubleAreRejected) {
  const Board board = FlatBoard(GetParam());
  const BoardFace& face = board.faces[0];
  cv::Mat picture = Draw(face);
  const auto cell = [&](int id) {
    const Eigen::Vector2i square = face.SquareOfMarker(id);
    return cv::Rect(kBorder_px + square.x() * kSquare_px, kBorder_px + square.y() * kSquare_px,
                    kSquare_px, kSquare_px);
  };
  const cv::Mat five = picture(cell(5)).clone();
  five.copyTo(picture(cell(20)));  // 20 is gone, 5 is there twice
  const BoardDetection detection = Detect(picture, board);
  EXPECT_EQ(detection.markers_found, face.MarkerCount() - 1);
  EXPECT_TRUE(Rejected(detection, 5, "not where its neighbours"));
  EXPECT_EQ(static_cast<int>(detection.corners.size()), face.CornerCount());
}

TEST_P(FlatPictures, TwoCopiesOfTheBoardAreRefused) {
  const Board board = FlatBoard(GetParam());
  cv::Mat both;
  cv::hconcat(Draw(board.faces[0]), Draw(board.faces[0]), both);
  const BoardDetection detection = Detect(both, board);
  EXPECT_EQ(detection.markers_found, 0);
  EXPECT_TRUE(detection.corners.empty());
  EXPECT_TRUE(Rejected(detection, 3, "seen twice"));
}

TEST_P(FlatPictures, ALoneMarkerIsNotTrusted) {
  const Board board = FlatBoard(GetParam());
  cv::Mat picture = Draw(board.faces[0]);
  const Eigen::Vector2i square = board.faces[0].SquareOfMarker(9);
  const cv::Rect cell(kBorder_px + square.x() * kSquare_px, kBorder_px + square.y() * kSquare_px,
                      kSquare_px, kSquare_px);
  cv::Mat lone(picture.size(), CV_8UC1, cv::Scalar(200));
  picture(cell).copyTo(lone(cell));
  const BoardDetection detection = Detect(lone, board);
  EXPECT_EQ(detection.markers_found, 0);
  EXPECT_TRUE(Rejected(detection, 9, "no other marker of its face"));
}

/// The reasons of the corners that were rejected, and that each corner is found or rejected, not
/// both.
std::map<int, CornerRejection> Reasons(const BoardDetection& detection) {
  std::map<int, CornerRejection> reasons;
  for (const RejectedCorner& corner : detection.rejected_corners) {
    EXPECT_TRUE(reasons.emplace(corner.corner, corner.kind).second) << corner.corner;
  }
  for (const BoardCorner& corner : detection.corners) {
    EXPECT_EQ(reasons.count(corner.corner), 0u) << corner.corner;
  }
  return reasons;
}

/// Pixels around the corner between these columns and rows of squares.
cv::Rect Around(int column, int row, int reach_px) {
  return {kBorder_px + column * kSquare_px - reach_px, kBorder_px + row * kSquare_px - reach_px,
          2 * reach_px, 2 * reach_px};
}

TEST_P(FlatPictures, EveryCornerThatIsNotFoundHasItsReason) {
  const Board board = FlatBoard(GetParam());
  const auto corner = [&](int column, int row) {
    return (row - 1) * (board.faces[0].columns - 1) + column - 1;
  };
  cv::Mat picture = Draw(board.faces[0]);
  EXPECT_TRUE(Detect(picture, board).rejected_corners.empty());
  constexpr int kWindow_px = 17;                       // 0.42 squares
  picture(Around(2, 2, kWindow_px)).setTo(120);        // hidden
  picture(Around(5, 3, kWindow_px)).col(8).setTo(30);  // a cable in front
  picture(Around(5, 3, kWindow_px)).colRange(20, 26).setTo(200);
  const cv::Rect from = Around(3, 6, kWindow_px);  // a crumpled print
  picture(from).clone().copyTo(picture(from + cv::Point(2, 0)));
  const BoardDetection detection = Detect(picture, board);
  const std::map<int, CornerRejection> reasons = Reasons(detection);
  EXPECT_EQ(detection.corners.size() + reasons.size(),
            static_cast<size_t>(board.faces[0].CornerCount()));
  EXPECT_EQ(reasons,
            (std::map<int, CornerRejection>{{corner(2, 2), CornerRejection::kFaint},
                                            {corner(5, 3), CornerRejection::kUnclear},
                                            {corner(3, 6), CornerRejection::kOffPattern}}));
}

/// Near the rim of a wide-angle lens, the faces' squares no longer lie on a plane's.
TEST_P(FlatPictures, CornersAtTheRimOfAWideAngleLensAreFound) {
  const Board board = FlatBoard(GetParam());
  const BoardFace& face = board.faces[0];
  const cv::Mat straight = Draw(face);
  constexpr double kBarrel = 0.3, kFocal_px = 300;  // distance from the axis grows by 0.3 (r/f)^2
  const auto straightened = [](const Eigen::Vector2d& pixel) -> Eigen::Vector2d {
    return (1 + kBarrel * pixel.squaredNorm() / (kFocal_px * kFocal_px)) * pixel;
  };
  cv::Mat x(straight.size(), CV_32FC1), y(straight.size(), CV_32FC1), bent;
  for (int row = 0; row < straight.rows; ++row) {
    for (int column = 0; column < straight.cols; ++column) {
      const Eigen::Vector2d from = straightened({column + 0.5, row + 0.5});
      x.at<float>(row, column) = static_cast<float>(from.x() - 0.5);
      y.at<float>(row, column) = static_cast<float>(from.y() - 0.5);
    }
  }
  cv::remap(straight, bent, x, y, cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar(200));
  const BoardDetection detection = Detect(bent, board);
  EXPECT_EQ(static_cast<int>(detection.corners.size()), face.CornerCount());
  EXPECT_TRUE(Reasons(detection).empty());
  for (const BoardCorner& corner : detection.corners) {
    const Eigen::Vector2d expected =
        Eigen::Vector2d::Constant(kBorder_px) +
        face.CornerInFace(corner.corner).head<2>() * kSquare_px / face.square_m;
    EXPECT_LT((straightened(corner.pixel) - expected).norm(), 0.15) << corner.corner;
  }
}

TEST_P(FlatPictures, CornersCutByThePicturesEdgeSaySoAndThoseOutsideAreNoneOfIt) {
  const Board board = FlatBoard(GetParam());
  const BoardFace& face = board.faces[0];
  const int across = face.columns - 1;
  // The last column of corners is outside, the one before 4 px from the edge.
  const cv::Mat whole = Draw(face);
  const cv::Mat picture = whole.colRange(0, kBorder_px + (across - 1) * kSquare_px + 4).clone();
  const std::map<int, CornerRejection> reasons = Reasons(Detect(picture, board));
  std::map<int, CornerRejection> expected;
  for (int row = 0; row < face.rows - 1; ++row) {
    expected[row * across + across - 2] = CornerRejection::kAtEdge;
  }
  EXPECT_EQ(reasons, expected);
}

TEST_P(FlatPictures, CornersOfTooSmallSquaresSaySo) {
  const Board board = FlatBoard(GetParam());
  BoardDetectionOptions options;
  options.min_square_px = kSquare_px + 1;
  const auto detection = DetectBoard(Draw(board.faces[0]), board, options);
  ASSERT_TRUE(detection) << detection.error().ToString();
  EXPECT_TRUE(detection->corners.empty());
  EXPECT_EQ(Reasons(*detection).size(), static_cast<size_t>(board.faces[0].CornerCount()));
  for (const RejectedCorner& corner : detection->rejected_corners) {
    EXPECT_EQ(corner.kind, CornerRejection::kSmall);
  }
}

INSTANTIATE_TEST_SUITE_P(BoardDetection, FlatPictures,
                         testing::Values("APRILTAG_36h11", "6X6_1000"));

TEST(DetectBoard, BoardsOfDifferentDictionariesAreOneTarget) {
  Board board = FlatBoard("APRILTAG_36h11");
  board.faces.push_back(FlatBoard("6X6_1000").faces[0]);  // the same ids, of another dictionary
  board.faces[1].name = "second";
  cv::Mat both;
  cv::hconcat(Draw(board.faces[0]), Draw(board.faces[1]), both);
  const BoardDetection detection = Detect(both, board);
  EXPECT_EQ(detection.markers_found, 2 * board.faces[0].MarkerCount());
  ASSERT_EQ(static_cast<int>(detection.corners.size()), 2 * board.faces[0].CornerCount());
  for (const BoardCorner& corner : detection.corners) {
    EXPECT_EQ(corner.pixel.x() > 0.5 * both.cols, corner.face == 1);
  }
}

TEST(DetectBoard, MarkersTooSmallToBeReadAreToldInPicturesOfTheRigsSize) {
  const Board board = FlatBoard("APRILTAG_36h11");
  constexpr double kScale = 9.0 / 30;  // markers of 9 px
  cv::Mat small, picture(1600, 1200, CV_8UC1, cv::Scalar(200));
  cv::resize(Draw(board.faces[0]), small, {}, kScale, kScale, cv::INTER_AREA);
  small.copyTo(picture(cv::Rect({900, 1300}, small.size())));
  const BoardDetection detection = Detect(picture, board);
  EXPECT_EQ(detection.unusable, "");
  EXPECT_EQ(detection.few_markers.find("small: its markers are about 9 px wide, to be read they "
                                       "must be 16 px"),
            0u)
      << detection.few_markers;
}

TEST(DetectBoard, AnEmptyPictureIsADetectionWithoutCorners) {
  const BoardDetection detection =
      Detect(cv::Mat(200, 300, CV_8UC1, cv::Scalar(90)), FlatBoard("APRILTAG_36h11"));
  EXPECT_TRUE(detection.corners.empty());
  EXPECT_TRUE(detection.unusable.empty());
}

TEST(DetectBoard, RefusesColourPictures) {
  const auto colour = DetectBoard(cv::Mat(20, 30, CV_8UC3), FlatBoard("APRILTAG_36h11"), {});
  ASSERT_FALSE(colour);
  EXPECT_EQ(colour.error().code, ErrorCode::kInvalidArgument);
}

/// Rendered pictures of the bowed, inexact cuboid against the truth.
class RenderedCuboid : public testing::Test {
 protected:
  void Build(int placement) {
    options_.target = sim::Target::kCuboid;
    options_.placement = placement;
    options_.seed = 1;
    world_ = sim::BuildWorld(rig_, options_, context_).value();
    scene_ = std::make_unique<sim::RayScene>(sim::RayScene::Build(world_, false).value());
  }

  cv::Mat Rgb(const CalibratedCamera& camera) {
    sim::Picture picture = sim::RenderPicture(world_, *scene_, camera, rig_.sensor, options_);
    return cv::Mat(picture.height, picture.width, CV_8UC3, picture.rgb.data()).clone();
  }

  BoardDetection DetectIn(const CalibratedCamera& camera) {
    cv::Mat grey;
    cv::cvtColor(Rgb(camera), grey, cv::COLOR_RGB2GRAY);
    return Detect(grey, options_.board);
  }

  /// Where the corner is in the picture, and the cosine between its face's normal and the view;
  /// no place behind the camera.
  struct TrueCorner {
    std::optional<Eigen::Vector2d> pixel;
    double facing = 0;
  };
  TrueCorner Truth(const CalibratedCamera& camera, int f, int corner) const {
    const Rigid3 rig_from_board = sim::BoardPlacement(options_.placement);
    const BoardFace& face = options_.board.faces[f];
    const CalibratedFace real = sim::BoardOf(options_)[f];
    const Eigen::Vector3d at = rig_from_board * PointOnBoard(face, real, face.CornerInFace(corner));
    const Eigen::Vector3d outward =
        rig_from_board.rotation * real.board_from_face.rotation * -Eigen::Vector3d::UnitZ();
    const Eigen::Vector3d view = (camera.cam_from_rig.OriginInSource() - at).normalized();
    return {camera.intrinsics.Project(camera.cam_from_rig * at), view.dot(outward)};
  }

  ThreadPool threads_{2};
  RunContext context_{threads_};
  sim::RigOptions rig_;
  sim::SimulateOptions options_;
  sim::World world_;
  std::unique_ptr<sim::RayScene> scene_;
};

TEST_F(RenderedCuboid, CornersAreFoundWithoutBias) {
  Build(4);
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double squares = 0, worst = 0;
  size_t visible = 0, found = 0;
  for (const CalibratedCamera& camera : sim::DrawRig(rig_, 6, 3, 1.0).cameras) {
    std::map<std::pair<int, int>, BoardCorner> corners;
    for (const BoardCorner& c : DetectIn(camera).corners) corners[{c.face, c.corner}] = c;
    ASSERT_FALSE(corners.empty());
    for (int f = 0; f < static_cast<int>(options_.board.faces.size()); ++f) {
      for (int i = 0; i < options_.board.faces[f].CornerCount(); ++i) {
        const auto [pixel, facing] = Truth(camera, f, i);
        const auto corner = corners.find({f, i});
        if (corner != corners.end()) {
          ASSERT_TRUE(pixel);
          const Eigen::Vector2d off = corner->second.pixel - *pixel;
          sum += off;
          squares += off.squaredNorm();
          worst = std::max(worst, off.norm());
        }
        if (facing < 0.3 || !pixel || pixel->x() < 15 || pixel->y() < 15 ||
            pixel->x() > camera.intrinsics.width_px - 15 ||
            pixel->y() > camera.intrinsics.height_px - 15) {
          continue;
        }
        ++visible;
        if (corner != corners.end()) ++found;
      }
    }
  }
  const double n = static_cast<double>(found);
  std::printf("%zu of %zu corners, bias %.4f %.4f px, RMS of an axis %.4f px, worst %.3f px\n",
              found, visible, sum.x() / n, sum.y() / n, std::sqrt(squares / n / 2), worst);
  ASSERT_GT(visible, 250u);
  EXPECT_GT(n, 0.97 * static_cast<double>(visible));
  EXPECT_LT((sum / n).norm(), 0.003);
  EXPECT_LT(std::sqrt(squares / n / 2), 0.004);
  EXPECT_LT(worst, 0.04);
}

/// A camera that stands upright `turn_deg` about the axis from the front face, a crop of the rig's.
CalibratedCamera UprightCamera(double turn_deg, double roll_deg) {
  CalibratedCamera camera;
  camera.camera = "upright";
  camera.intrinsics = {CameraModel::kOpencv, 560, 560, {1840, 1840, 280, 280, 0, 0, 0, 0}};
  const double turn_rad = RadFromDeg(turn_deg);
  const Eigen::Vector3d back(std::cos(turn_rad), std::sin(turn_rad), 0);
  const Eigen::Vector3d down(0, 0, -1);
  Eigen::Matrix3d cam_from_rig;
  cam_from_rig << down.cross(-back).transpose(), down.transpose(), -back.transpose();
  const Eigen::Matrix3d roll =
      Eigen::AngleAxisd(RadFromDeg(roll_deg), Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Eigen::Vector3d centre = 1.7 * back + Eigen::Vector3d(0, 0, 0.8);
  camera.cam_from_rig.rotation = Eigen::Quaterniond(roll * cam_from_rig);
  camera.cam_from_rig.translation = -(camera.cam_from_rig.rotation * centre);
  return camera;
}

/// Edges along the pixels' rows and columns have the same place between two pixels all along: what
/// the pictures or the fit of a corner get wrong about an edge's profile does not average out, but
/// draws the corners towards the pixels' middles or borders, by the sine of their place.
TEST_F(RenderedCuboid, PixelsDoNotDrawCornersTowardsThem) {
  Build(0);
  for (const double turn_deg : {0.0, 35.0, 52.0, 62.0}) {
    Eigen::Vector2d locked = Eigen::Vector2d::Zero(), squares = Eigen::Vector2d::Zero();
    double ratio = 0, n = 0;
    for (const double roll_deg : {0.4, 1.3}) {
      const CalibratedCamera camera = UprightCamera(turn_deg, roll_deg);
      for (const BoardCorner& corner : DetectIn(camera).corners) {
        const Eigen::Vector2d truth = Truth(camera, corner.face, corner.corner).pixel.value();
        const Eigen::Array2d off = corner.pixel - truth;
        locked += (2 * off * (2 * kPi * truth.array()).sin()).matrix();
        squares += off.square().matrix();
        ratio += off.square().sum() / (2 * corner.sigma_px * corner.sigma_px);
        n += 1;
      }
    }
    ASSERT_GT(n, 60);
    const Eigen::Vector2d rms = (squares / n).cwiseSqrt();
    std::printf(
        "%2.0f deg: %3.0f corners, RMS %.4f %.4f px, locked %.4f %.4f px, error/sigma %.2f\n",
        turn_deg, n, rms.x(), rms.y(), locked.x() / n, locked.y() / n, std::sqrt(ratio / n));
    EXPECT_LT((locked / n).cwiseAbs().maxCoeff(), 0.003) << turn_deg;
    EXPECT_LT(rms.maxCoeff(), 0.005) << turn_deg;
    EXPECT_LT(std::sqrt(ratio / n), 1.0) << turn_deg;
  }
}

/// The picture as a sensor of order RGGB gives it when it is more sensitive to green.
cv::Mat MosaicOf(const cv::Mat& rgb) {
  constexpr std::array<double, 3> kSensitivity = {0.6, 1.0, 0.5};
  cv::Mat mosaic(rgb.size(), CV_8UC1);
  for (int y = 0; y < rgb.rows; ++y) {
    for (int x = 0; x < rgb.cols; ++x) {
      const int channel = (x & 1) + (y & 1);
      mosaic.at<uint8_t>(y, x) = cv::saturate_cast<uint8_t>(
          kSensitivity[static_cast<size_t>(channel)] * rgb.at<cv::Vec3b>(y, x)[channel]);
    }
  }
  return mosaic;
}

TEST_F(RenderedCuboid, CornersInAMosaicAreFoundAsWellAsInGrey) {
  Build(4);
  double squares = 0, ratio = 0, demosaiced_squares = 0, n = 0, demosaiced_n = 0;
  for (const CalibratedCamera& camera : sim::DrawRig(rig_, 6, 3, 1.0).cameras) {
    const cv::Mat mosaic = MosaicOf(Rgb(camera));
    cv::Mat demosaiced;
    cv::cvtColor(mosaic, demosaiced, cv::COLOR_BayerRGGB2GRAY);
    const auto found = DetectBoardInMosaic(mosaic, demosaiced, options_.board, {});
    ASSERT_TRUE(found) << found.error().ToString();
    for (const BoardCorner& corner : found->corners) {
      const auto truth = Truth(camera, corner.face, corner.corner).pixel.value();
      squares += (corner.pixel - truth).squaredNorm();
      ratio += (corner.pixel - truth).squaredNorm() / (2 * corner.sigma_px * corner.sigma_px);
      n += 1;
    }
    for (const BoardCorner& corner : Detect(demosaiced, options_.board).corners) {
      const auto truth = Truth(camera, corner.face, corner.corner).pixel.value();
      demosaiced_squares += (corner.pixel - truth).squaredNorm();
      demosaiced_n += 1;
    }
  }
  ASSERT_GT(n, 250);
  std::printf("%.0f corners, RMS of an axis %.4f px (%.0f, %.4f px demosaiced), error/sigma %.2f\n",
              n, std::sqrt(squares / n / 2), demosaiced_n,
              std::sqrt(demosaiced_squares / demosaiced_n / 2), std::sqrt(ratio / n));
  EXPECT_LT(std::sqrt(squares / n / 2), 0.015);
  EXPECT_LT(std::sqrt(ratio / n), 1.3);
  EXPECT_GE(n, 0.98 * demosaiced_n);
}

/// In half the size no marker can be read, or one or two: the colours are to be balanced over more
/// of the board than the corners beside those.
TEST_F(RenderedCuboid, SmallMarkersInAMosaicGiveCornersAsGoodAsOthers) {
  Build(0);
  for (const double focal_px : {725.0, 730.0, 735.0, 740.0, 760.0}) {
    CalibratedCamera camera = UprightCamera(45, 3);
    camera.intrinsics.params[0] = camera.intrinsics.params[1] = focal_px;
    const cv::Mat mosaic = MosaicOf(Rgb(camera));
    cv::Mat demosaiced;
    cv::cvtColor(mosaic, demosaiced, cv::COLOR_BayerRGGB2GRAY);
    const auto found = DetectBoardInMosaic(mosaic, demosaiced, options_.board, {});
    ASSERT_TRUE(found) << found.error().ToString();
    double squares = 0;
    for (const BoardCorner& corner : found->corners) {
      const auto truth = Truth(camera, corner.face, corner.corner).pixel.value();
      squares += (corner.pixel - truth).squaredNorm();
    }
    const auto n = static_cast<double>(found->corners.size());
    ASSERT_GT(n, 200) << focal_px;
    std::printf("%.0f px: %.0f corners, RMS of an axis %.4f px\n", focal_px, n,
                std::sqrt(squares / n / 2));
    EXPECT_LT(std::sqrt(squares / n / 2), 0.007) << focal_px;
  }
}

struct RealSet {
  const char* folder;
  const char* board;
  double least_corners;  // of a picture, in the mean
};

class RealSets : public testing::TestWithParam<RealSet> {};

TEST_P(RealSets, EveryPictureShowsTheBoard) {
  const char* shared = std::getenv("ROTUNDA_SHARED");
  const std::filesystem::path source = ROTUNDA_SOURCE_DIR;
  const std::filesystem::path folder =
      (shared ? std::filesystem::path(shared) : source.parent_path() / "shared") / "data" /
      GetParam().folder;
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << folder << " is not there";
  const auto board = config::ReadBoard(source / "config" / "boards" / GetParam().board);
  ASSERT_TRUE(board) << board.error().ToString();
  auto shots = FindShots({folder});
  ASSERT_TRUE(shots) << shots.error().ToString();
  // A few shots: the whole sets take half a minute.
  shots->shots.resize(4);
  shots->pictures.resize(4);
  ThreadPool threads(2);
  RunContext context{threads};
  const auto sightings = DetectBoards(*shots, *board, {}, context);
  ASSERT_TRUE(sightings) << sightings.error().ToString();
  size_t corners = 0, pictures = 0;
  for (const auto& row : sightings->sightings) {
    for (const BoardSighting& sighting : row) {
      ASSERT_TRUE(sighting.detection) << sighting.picture << ": " << sighting.missing;
      EXPECT_EQ(sighting.detection->unusable, "");
      EXPECT_GT(sighting.detection->corners.size(), 15u) << sighting.picture;
      corners += sighting.detection->corners.size();
      ++pictures;
    }
  }
  const double mean = static_cast<double>(corners) / static_cast<double>(pictures);
  std::printf("%s: %.1f corners a picture\n", GetParam().folder, mean);
  EXPECT_GT(mean, GetParam().least_corners);
}

INSTANTIATE_TEST_SUITE_P(BoardDetection, RealSets,
                         testing::Values(RealSet{"charuco-cube", "charuco-cube.toml", 70},
                                         RealSet{"charuco-4cam", "charuco-8x11.toml", 66}));

}  // namespace
}  // namespace rotunda::rig
