#pragma once

#include <string>

#include "rig/board.h"
#include "sfm/core/result.h"

namespace rotunda::rig {

/// Height of the strip below a face that carries its name and a ruler; it is cut off the print.
inline constexpr double kCaptionStrip_m = 0.014;

/// A face at true scale as an SVG file in millimetres or as a PDF file of one page, vectors
/// throughout. The page is the face with its margin, a thin outline to cut along, and below it the
/// caption strip. The ink is FaceInk's, at (margin, margin) from the page's top-left corner, so
/// that a print of the right size has the ruler's length on the ruler. Errors as FaceInk.
Result<std::string> FaceSvg(const BoardFace& face, const std::string& board_name);
Result<std::string> FacePdf(const BoardFace& face, const std::string& board_name);

}  // namespace rotunda::rig
