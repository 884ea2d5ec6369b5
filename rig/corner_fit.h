#pragma once

#include <Eigen/Core>
#include <variant>

namespace cv {
class Mat;
}

namespace rotunda::rig {

/// What is known of a chessboard corner before it is measured.
struct CornerGuess {
  Eigen::Vector2d pixel;  // (0.5, 0.5) is the centre of the top-left pixel
  /// Pixels per square along the board's x (first column) and y.
  Eigen::Matrix2d px_per_square;
  bool top_left_black = true;  // and bottom right
  double marker_gap = 0.125;   // white between a square's edge and its marker, in squares
};

struct CornerFit {
  Eigen::Vector2d pixel;
  double sigma_px = 0;  // of each coordinate, from the noise that the fit left
  double blur_px = 0;   // standard deviation of the edges' profile
  double contrast = 0;  // grey levels between white and black
  double residual = 0;  // root mean square, grey levels
};

/// Why a corner that was looked for is not used.
enum class CornerRejection {
  kAtEdge,      // of the picture: pixels around it are missing
  kSmall,       // squares are too small
  kFaint,       // hardly any contrast
  kUnclear,     // the picture is no chessboard corner there
  kOffPattern,  // it is not where the markers and corners around it put it
};

using CornerMeasurement = std::variant<CornerFit, CornerRejection>;

struct CornerFitOptions {
  /// The fit looks this far along the edges: half a square brings in the next corner's blur, and
  /// over more than 12 px the edges of a distorted picture are no longer straight to 0.01 px.
  double max_reach_squares = 0.42;
  double max_reach_px = 12;
  double min_contrast = 10;  // grey levels; less is not an edge in an 8-bit picture
  /// The residual may be this share of the contrast. What is no chessboard corner leaves 0.2 and
  /// more; curved edges, texture of paper and coding of JPEG leave up to 0.08.
  double max_residual = 0.12;
  /// Least standard deviation given to a corner: what the fit's model lacks moves corners by this
  /// much without showing as noise (0.002 px: pixels of which 80 % are sensitive; 0.005 px: a tone
  /// curve bent twice; both where edges run along the pixels' rows).
  double floor_px = 0.004;
};

/// Measures a corner by fitting two blurred edges that cross in it, as pixels see them:
///     I = K + (C + g . (q - p)) T(w),   w = (1 -+ E(d1) E(d2)) / 2,
/// over the pixels along both edges that the markers do not reach. d1, d2 are the distances of
/// pixel q from the edges through p, E an edge's mean over the pixel's square (a blurred edge taken
/// at the pixel's middle is off by 0.02 px where edges run along the pixels' rows and the lens is
/// sharp), T the curve of the camera or of spreading ink (left out or a parabola: 0.01 px there, as
/// it does not average out), g uneven light. By symmetry the markers do not move p. Any rejection
/// but kOffPattern when there is no such corner here.
CornerMeasurement FitCorner(const cv::Mat& grey, const CornerGuess& guess,
                            const CornerFitOptions& options);

}  // namespace rotunda::rig
