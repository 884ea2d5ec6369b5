#pragma once

#include "rig/board_detection.h"

namespace rotunda::rig {

/// DetectBoard in a picture as a Bayer sensor gave it (CV_8UC1, any of the four orders).
///
/// Demosaicing interpolates, and edges interpolated from one colour's pixels are off by a tenth of
/// a pixel, by where they lie in the pattern. A printed board is neutral: once the four interleaved
/// colours are brought to the same mean over it, the mosaic is its grey picture, sample by sample.
/// Where the board is, is found in a picture of half the size first. `demosaiced` (CV_8UC1, the
/// same size) is searched too when too little is found there to tell the colours' means, for boards
/// that are small in the picture or seen from the side.
Result<BoardDetection> DetectBoardInMosaic(const cv::Mat& mosaic, const cv::Mat& demosaiced,
                                           const Board& board,
                                           const BoardDetectionOptions& options);

}  // namespace rotunda::rig
