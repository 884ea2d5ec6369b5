#include "rig/board_detection.h"

#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <map>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <set>

#include "rig/marker_choice.h"
#include "rig/plane_fit.h"
#include "sfm/core/statistics.h"

namespace rotunda::rig {
namespace {

/// Fewer markers than this, and the picture is looked at again for what may be wrong with it.
constexpr size_t kFewMarkers = 4;
/// Pixels a cell of a marker (its black border is one wide) along its narrowest side. Of rendered
/// AprilTags with 2.0 px, 98 of 100 are read, with 1.7 px 70, with 1.4 px 24, below 1.2 px none.
constexpr double kReadableCell_px = 2;
/// Between the darkest and the brightest 2 % of a picture: less, and there is no board to be
/// blurred.
constexpr double kLeastContrast = 40;
constexpr double kWidthOfSigma = 2.563;  // 10 to 90 % of an edge blurred by a Gaussian
/// Where a corner is predicted from: what lies within this many squares (the larger of both ways),
/// at most so many points, the nearest first.
constexpr double kPredictionRadius_squares = 2.6;
constexpr size_t kPredictionPoints = 20;
constexpr size_t kLeastCornersAround = 5;
constexpr int kGrowthRounds =
    3;  // a round reaches a square further than the markers that were read
/// A corner may be found this far from where it was looked for: markers' corners are found to
/// better than a tenth of a square.
constexpr double kMaxShift_squares = 0.12;
constexpr double kMaxShift_px = 1.5;  // and more in small squares

/// What is known of one face in the picture.
class FaceSearch {
 public:
  FaceSearch(const cv::Mat& grey, const BoardFace& face, const BoardDetectionOptions& options)
      : grey_(grey),
        face_(face),
        options_(options),
        found_(face.CornerCount()),
        rejected_(face.CornerCount()) {}

  void AddMarker(const FoundMarker& marker) {
    const std::vector<Eigen::Vector3d> corners = face_.MarkerInFace(marker.id);
    for (size_t k = 0; k < 4; ++k) {
      marker_points_.push_back({corners[k].head<2>() / face_.square_m, marker.corners_px[k]});
    }
  }

  /// Corners beside markers first, then outwards from those found.
  void Search() {
    for (int corner = 0; corner < face_.CornerCount(); ++corner) {
      if (BesideMarker(corner)) Measure(corner, Nearest(corner, marker_points_, 8));
    }
    for (int round = 0; round < kGrowthRounds; ++round) {
      const std::vector<std::optional<CornerFit>> before = found_;
      for (int corner = 0; corner < face_.CornerCount(); ++corner) {
        if (!before[corner]) Measure(corner, AroundIn(before, corner));
      }
    }
    RejectBent();
  }

  const std::vector<std::optional<CornerFit>>& found() const { return found_; }
  /// Of corners in the picture that were looked for and not found.
  const std::vector<std::optional<CornerRejection>>& rejected() const { return rejected_; }

 private:
  Eigen::Vector2d OnFace(int corner) const {
    return face_.CornerInFace(corner).head<2>() / face_.square_m;
  }

  bool BesideMarker(int corner) const {
    const Eigen::Vector2d at = OnFace(corner);
    return std::any_of(marker_points_.begin(), marker_points_.end(), [&](const PlanePoint& p) {
      return (p.on_face - at).cwiseAbs().maxCoeff() < 0.5;
    });
  }

  static std::vector<PlanePoint> NearestOf(std::vector<std::pair<double, PlanePoint>> points) {
    std::stable_sort(points.begin(), points.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    if (points.size() > kPredictionPoints) points.resize(kPredictionPoints);
    std::vector<PlanePoint> nearest;
    for (const auto& [distance, point] : points) nearest.push_back(point);
    return nearest;
  }

  /// Empty when there are fewer than `least`.
  std::vector<PlanePoint> Nearest(int corner, const std::vector<PlanePoint>& points,
                                  size_t least) const {
    const Eigen::Vector2d at = OnFace(corner);
    std::vector<std::pair<double, PlanePoint>> near;
    for (const PlanePoint& point : points) {
      const Eigen::Vector2d apart = point.on_face - at;
      if (apart.cwiseAbs().maxCoeff() < kPredictionRadius_squares) {
        near.emplace_back(apart.squaredNorm(), point);
      }
    }
    return near.size() < least ? std::vector<PlanePoint>() : NearestOf(std::move(near));
  }

  /// The corners around one, itself left out. Empty when there are too few of them.
  std::vector<PlanePoint> AroundIn(const std::vector<std::optional<CornerFit>>& found,
                                   int corner) const {
    const int across = face_.columns - 1, down = face_.rows - 1;
    const int reach = static_cast<int>(kPredictionRadius_squares);
    const int column = corner % across, row = corner / across;
    std::vector<std::pair<double, PlanePoint>> near;
    for (int r = std::max(row - reach, 0); r <= std::min(row + reach, down - 1); ++r) {
      for (int c = std::max(column - reach, 0); c <= std::min(column + reach, across - 1); ++c) {
        const int other = r * across + c;
        if (other == corner || !found[other]) continue;
        const double squared = (r - row) * (r - row) + (c - column) * (c - column);
        near.emplace_back(squared, PlanePoint{OnFace(other), found[other]->pixel});
      }
    }
    if (near.size() < kLeastCornersAround) return {};
    return NearestOf(std::move(near));
  }

  bool InPicture(const Eigen::Vector2d& pixel) const {
    return pixel.x() >= 0 && pixel.y() >= 0 && pixel.x() < grey_.cols && pixel.y() < grey_.rows;
  }

  void Measure(int corner, const std::vector<PlanePoint>& points) {
    const std::optional<PlaneFit> plane = PlaneFit::Fit(points);
    if (!plane) return;
    CornerGuess guess;
    guess.pixel = plane->Pixel(OnFace(corner));
    guess.px_per_square = plane->PixelsPerSquare(OnFace(corner));
    if (!InPicture(guess.pixel) || !guess.px_per_square.allFinite()) return;
    const int across = face_.columns - 1;
    guess.top_left_black = face_.IsBlack(corner % across, corner / across);
    guess.marker_gap = 0.5 * (1 - face_.marker_m / face_.square_m);
    const CornerMeasurement measured = MeasureNear(guess);
    if (const auto* fit = std::get_if<CornerFit>(&measured)) {
      found_[corner] = *fit;
      rejected_[corner].reset();
    } else {
      rejected_[corner] = std::get<CornerRejection>(measured);
    }
  }

  CornerMeasurement MeasureNear(CornerGuess guess) const {
    const double side_px = Narrowest(guess.px_per_square);
    if (side_px < options_.min_square_px) return CornerRejection::kSmall;
    const CornerMeasurement first = FitCorner(grey_, guess, options_.corners);
    const auto* fit = std::get_if<CornerFit>(&first);
    if (fit == nullptr) return first;
    const double most = std::max(kMaxShift_px, kMaxShift_squares * side_px);
    if ((fit->pixel - guess.pixel).norm() > most) return CornerRejection::kOffPattern;
    // Again from where it is: the window then is symmetric about the corner.
    guess.pixel = fit->pixel;
    return FitCorner(grey_, guess, options_.corners);
  }

  /// Distance between opposite edges of a square, the smaller one.
  static double Narrowest(const Eigen::Matrix2d& px_per_square) {
    const double area = std::abs(px_per_square.determinant());
    return area / std::max(px_per_square.col(0).norm(), px_per_square.col(1).norm());
  }

  /// What a lens bends: the points' distances from the plane as a parabola, at `at`. Zero when the
  /// points do not determine one.
  static Eigen::Vector2d BendAt(const Eigen::Vector2d& at, const PlaneFit& plane,
                                const std::vector<PlanePoint>& points) {
    constexpr Eigen::Index kCoefficients = 6;
    const auto count = static_cast<Eigen::Index>(points.size());
    Eigen::MatrixXd powers(count, kCoefficients);
    Eigen::MatrixX2d off(count, 2);
    for (Eigen::Index i = 0; i < count; ++i) {
      const PlanePoint& point = points[static_cast<size_t>(i)];
      const Eigen::Vector2d d = point.on_face - at;
      powers.row(i) << 1, d.x(), d.y(), d.x() * d.x(), d.x() * d.y(), d.y() * d.y();
      off.row(i) = point.pixel - plane.Pixel(point.on_face);
    }
    const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> fit(powers);
    if (count <= kCoefficients || fit.rank() < kCoefficients) return Eigen::Vector2d::Zero();
    return fit.solve(off).row(0);
  }

  void RejectBent() {
    const std::vector<std::optional<CornerFit>> before = found_;
    for (int corner = 0; corner < face_.CornerCount(); ++corner) {
      if (!before[corner]) continue;
      const Eigen::Vector2d at = OnFace(corner);
      const std::vector<PlanePoint> around = AroundIn(before, corner);
      const std::optional<PlaneFit> plane = PlaneFit::Fit(around);
      if (!plane) {
        continue;  // too few around: the markers beside it vouch for it
      }
      const double most_px =
          options_.max_bent * Narrowest(plane->PixelsPerSquare(at)) + 5 * before[corner]->sigma_px;
      const Eigen::Vector2d off = plane->Pixel(at) - before[corner]->pixel;
      if (off.norm() <= most_px) continue;
      // The rim of a wide-angle lens bends more, but smoothly.
      if ((off + BendAt(at, *plane, around)).norm() <= most_px) continue;
      found_[corner].reset();
      rejected_[corner] = CornerRejection::kOffPattern;
    }
  }

  const cv::Mat& grey_;
  const BoardFace& face_;
  const BoardDetectionOptions& options_;
  std::vector<PlanePoint> marker_points_;
  std::vector<std::optional<CornerFit>> found_;
  std::vector<std::optional<CornerRejection>> rejected_;
};

std::set<std::string> DictionariesOf(const Board& board) {
  std::set<std::string> dictionaries;
  for (const BoardFace& face : board.faces) dictionaries.insert(face.dictionary);
  return dictionaries;
}

Result<MarkerChoice> FindMarkers(const cv::Mat& grey, const Board& board,
                                 const BoardDetectionOptions& options) {
  std::vector<FoundMarker> found;
  for (const std::string& dictionary : DictionariesOf(board)) {
    ROTUNDA_ASSIGN_OR_RETURN(std::vector<FoundMarker> more,
                             DetectMarkers(grey, dictionary, options.markers));
    found.insert(found.end(), more.begin(), more.end());
  }
  return ChooseMarkers(std::move(found), board, options);
}

std::string Text(const char* format, double value) {
  char text[256];
  std::snprintf(text, sizeof(text), format, value);
  return text;
}

/// Value below which `share` of a CV_8UC1 picture's pixels lie.
int Percentile(const cv::Mat& values, double share) {
  std::array<size_t, 256> counts = {};
  for (int y = 0; y < values.rows; ++y) {
    const uint8_t* row = values.ptr<uint8_t>(y);
    for (int x = 0; x < values.cols; ++x) ++counts[row[x]];
  }
  size_t left = static_cast<size_t>(share * static_cast<double>(values.total()));
  int value = 0;
  while (value < 255 && left >= counts[value]) left -= counts[value++];
  return value;
}

/// Width (10 to 90 %) of the sharpest edges of the whole picture, whatever it shows: an edge of
/// contrast C blurred by s has the slope C / (s sqrt(2 pi)). 0 without contrast.
double SharpestEdge_px(const cv::Mat& grey) {
  cv::Mat smooth, dx, dy, slope;
  cv::GaussianBlur(grey, smooth, {}, 1.0);  // against noise
  const double contrast = Percentile(smooth, 0.98) - Percentile(smooth, 0.02);
  if (contrast < kLeastContrast) return 0;
  constexpr double kSobelGain = 8;
  cv::Sobel(smooth, dx, CV_32F, 1, 0);
  cv::Sobel(smooth, dy, CV_32F, 0, 1);
  cv::magnitude(dx, dy, slope);
  constexpr double kSteps = 4;  // an 8-bit picture of slopes in quarters of a grey level
  slope.convertTo(slope, CV_8U, kSteps / kSobelGain);
  const double steepest = std::max(Percentile(slope, 0.999), 1) / kSteps;
  return kWidthOfSigma * contrast / (steepest * std::sqrt(2 * kPi));
}

/// A picture with hardly a marker: is it mirrored, or too blurred to be read? Empty: neither.
Result<std::string> WhyFewMarkers(const cv::Mat& grey, const Board& board,
                                  const BoardDetectionOptions& options) {
  cv::Mat flipped;
  cv::flip(grey, flipped, 1);
  ROTUNDA_ASSIGN_OR_RETURN(const MarkerChoice mirrored, FindMarkers(flipped, board, options));
  if (mirrored.accepted.size() >= kFewMarkers) {
    return std::string(
        "mirrored: the picture shows the board as a mirror would; switch off the flipping of "
        "pictures in the camera (ReverseX, ReverseY) or take the mirror away");
  }
  const double width_px = SharpestEdge_px(grey);
  if (width_px > options.max_edge_width_px) {
    return Text("blurred: hardly a marker can be read and the sharpest edges are %.1f px wide",
                width_px) +
           Text(
               ", at most %.1f px is usable; focus the lens, hold the board still or expose "
               "shorter (or is the board not in view?)",
               options.max_edge_width_px);
  }
  return std::string();
}

/// The part with the most and sharpest edges, of at most `most_pixels`: a board is more likely
/// there than anywhere else.
cv::Mat BusiestPart(const cv::Mat& grey, double most_pixels) {
  const double scale = std::sqrt(most_pixels / static_cast<double>(grey.total()));
  if (scale >= 1) return grey;
  cv::Mat dx, dy, edges, sums;
  cv::Sobel(grey, dx, CV_32F, 1, 0);
  cv::Sobel(grey, dy, CV_32F, 0, 1);
  cv::magnitude(dx, dy, edges);
  cv::integral(edges, sums, CV_64F);
  cv::Rect part(0, 0, static_cast<int>(scale * grey.cols), static_cast<int>(scale * grey.rows));
  cv::Rect best = part;
  double most = -1;
  constexpr int kStep_px = 32;
  for (part.y = 0; part.br().y <= grey.rows; part.y += kStep_px) {
    for (part.x = 0; part.br().x <= grey.cols; part.x += kStep_px) {
      const double sum = sums.at<double>(part.br()) - sums.at<double>(part.y, part.br().x) -
                         sums.at<double>(part.br().y, part.x) + sums.at<double>(part.tl());
      if (sum <= most) continue;
      most = sum;
      best = part;
    }
  }
  return grey(best);
}

/// Markers that are there and too small to be read come out when the picture is enlarged: how wide
/// they are then tells what is missing. Empty: there are no more than the `markers` read before.
Result<std::string> WhySmall(const cv::Mat& grey, size_t markers, const Board& board,
                             const BoardDetectionOptions& options) {
  constexpr double kEnlarged = 3;
  constexpr double kMostPixels = 1.5e6;  // larger ones would take seconds each
  cv::Mat enlarged;
  cv::resize(BusiestPart(grey, kMostPixels), enlarged, {}, kEnlarged, kEnlarged, cv::INTER_CUBIC);
  ROTUNDA_ASSIGN_OR_RETURN(const MarkerChoice choice, FindMarkers(enlarged, board, options));
  if (choice.accepted.size() <= markers) return std::string();
  std::vector<double> sides_px;
  for (const BoardMarker& marker : choice.accepted) {
    sides_px.push_back(marker.marker.Side_px() / kEnlarged);
  }
  const double side_px = Median(std::move(sides_px));
  ROTUNDA_ASSIGN_OR_RETURN(
      const MarkerDictionary dictionary,
      MarkerDictionary::Named(
          board.faces[static_cast<size_t>(choice.accepted[0].face)].dictionary));
  const double needed_px = kReadableCell_px * dictionary.CellsAcross();
  if (side_px > needed_px) return std::string();
  return Text("small: its markers are about %.0f px wide", side_px) +
         Text(", to be read they must be %.0f px; bring the target nearer, use squares that are ",
              needed_px) +
         Text(
             "%.1f times larger, or take pictures with as many more pixels (width_px, height_px, "
             "binning)",
             needed_px / side_px);
}

void FindCorners(const cv::Mat& grey, const Board& board, const BoardDetectionOptions& options,
                 const std::vector<BoardMarker>& markers, BoardDetection* detection) {
  std::vector<double> widths;
  for (size_t f = 0; f < board.faces.size(); ++f) {
    FaceSearch search(grey, board.faces[f], options);
    for (const BoardMarker& marker : markers) {
      if (marker.face == static_cast<int>(f)) search.AddMarker(marker.marker);
    }
    search.Search();
    for (size_t corner = 0; corner < search.found().size(); ++corner) {
      const int face = static_cast<int>(f), number = static_cast<int>(corner);
      if (const std::optional<CornerFit>& fit = search.found()[corner]) {
        detection->corners.push_back({face, number, fit->pixel, fit->sigma_px});
        widths.push_back(kWidthOfSigma * fit->blur_px);
      } else if (const auto rejected = search.rejected()[corner]) {
        detection->rejected_corners.push_back({face, number, *rejected});
      }
    }
  }
  if (!widths.empty()) detection->edge_width_px = Median(std::move(widths));
}

}  // namespace

RejectionText TextOf(Rejection kind) {
  switch (kind) {
    case Rejection::kAlone:
      return {
          "alone",
          "No other marker of its face was read near it: usual where a face is seen from the "
          "side, at the picture's edge or partly hidden. If a camera has many, show it the face "
          "nearer, or light it better."};
    case Rejection::kMisplaced:
      return {"not where its neighbours put it",
              "A misread marker, or one of another print: a few do no harm. If a camera has many, "
              "compare the print with the board file (columns, rows, first_id, legacy_pattern) and "
              "look for another board in view."};
    case Rejection::kOnNoFace:
      return {"on no face of the board",
              "Another print is in view, or the board file is not this target's: take the print "
              "away, or give the target's own file."};
    case Rejection::kSeenTwice:
      break;
  }
  return {"seen twice",
          "A copy of the board, or its mirror image, is in view: take it away or cover it."};
}

RejectionText TextOf(CornerRejection kind) {
  switch (kind) {
    case CornerRejection::kAtEdge:
      return {"cut by the picture's edge",
              "It is in the picture, but not all that is around it: usual, and no harm."};
    case CornerRejection::kSmall:
      return {"squares too small",
              "Usual where a face is seen from the side. If a camera has many, bring the target "
              "nearer to it."};
    case CornerRejection::kFaint:
      return {"hardly any contrast",
              "Black and white are about the same there: in the shade, overexposed, or hidden. "
              "Light the target evenly, set the exposure, take away what hides it."};
    case CornerRejection::kUnclear:
      return {"no clear corner",
              "Something else is in its place: a thing in front of the target, a reflection, a "
              "damaged print. If a camera or a shot has many, look at its pictures."};
    case CornerRejection::kOffPattern:
      break;
  }
  return {"off the pattern around it",
          "It was found, but not where the markers and corners around it put it. A few do no harm; "
          "if a face has many, its print is damaged or not flat."};
}

Result<BoardDetection> DetectBoard(const cv::Mat& grey, const Board& board,
                                   const BoardDetectionOptions& options) {
  ROTUNDA_RETURN_IF_ERROR(board.Validate());
  if (grey.type() != CV_8UC1 || grey.empty()) {
    return Error{ErrorCode::kInvalidArgument, "expected a picture of one channel of 8 bits",
                 "picture"};
  }
  BoardDetection detection;
  ROTUNDA_ASSIGN_OR_RETURN(MarkerChoice choice, FindMarkers(grey, board, options));
  detection.markers_found = static_cast<int>(choice.accepted.size());
  detection.rejected = std::move(choice.rejected);
  if (choice.accepted.size() < kFewMarkers) {
    ROTUNDA_ASSIGN_OR_RETURN(detection.unusable, WhyFewMarkers(grey, board, options));
    if (!detection.unusable.empty()) return detection;
    ROTUNDA_ASSIGN_OR_RETURN(detection.few_markers,
                             WhySmall(grey, choice.accepted.size(), board, options));
  }
  FindCorners(grey, board, options, choice.accepted, &detection);
  if (detection.edge_width_px > options.max_edge_width_px) {
    detection.unusable =
        Text("blurred: edges are %.1f px wide", detection.edge_width_px) +
        Text(", at most %.1f px is usable; focus the lens, hold the board still or expose shorter",
             options.max_edge_width_px);
    detection.corners.clear();
    detection.rejected_corners.clear();
  }
  return detection;
}

}  // namespace rotunda::rig
