#pragma once

#include <cstdint>
#include <vector>

#include "rig/board.h"
#include "rig/sim/world.h"
#include "sfm/core/result.h"
#include "sfm/core/rigid3.h"

namespace rotunda::sim {

/// How far a real target is from its drawing. Each face's middle is displaced and the face turned
/// about it in random directions, by uniform amounts up to these; its middle bows out or in by
/// exactly `bow_mm`, divided at random between bending about the vertical and the horizontal.
struct BoardErrors {
  double position_mm = 1.0;
  double rotation_deg = 0.2;
  double bow_mm = 0.5;
};

/// The faces of the physical target of this seed; `scale` times the errors, 0: as drawn.
std::vector<CalibratedFace> DrawBoard(const rig::Board& board, double scale, uint64_t seed);

/// Where the target stands in shot `placement`: 0 upright on the axis, its frame the rig's; others
/// turned, shifted and a little tilted.
Rigid3 BoardPlacement(int placement);

/// The target as a thing in the world: its printed faces where `faces` has them (in the order of
/// board.faces), each with a grey back.
Result<WorldObject> MakeBoardObject(const rig::Board& board,
                                    const std::vector<CalibratedFace>& faces,
                                    const Rigid3& rig_from_board);

}  // namespace rotunda::sim
