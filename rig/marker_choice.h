#pragma once

#include <vector>

#include "rig/board_detection.h"

namespace rotunda::rig {

/// A marker that is where the board has it.
struct BoardMarker {
  int face = 0;
  FoundMarker marker;
};

struct MarkerChoice {
  std::vector<BoardMarker> accepted;  // sorted by face and id; each id once
  std::vector<RejectedMarker> rejected;
};

/// Which of the found markers are the board's: an id of the board's, and one plane (a homography)
/// with most of its neighbours on the face. Of an id seen twice, the one that its neighbours agree
/// with; none when both look right.
MarkerChoice ChooseMarkers(std::vector<FoundMarker> found, const Board& board,
                           const BoardDetectionOptions& options);

}  // namespace rotunda::rig
