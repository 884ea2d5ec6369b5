#pragma once

#include <memory>

#include "rig/sim/body_shape.h"
#include "rig/sim/garment.h"
#include "rig/sim/world.h"

namespace rotunda::sim {

/// Colours of the procedural person: skin with mottling, pores and freckles, eyes, brows, lips,
/// hair, shoes, and the garment; `cover` over it.
std::unique_ptr<Paint> MakeBodyPaint(const BodyShape& shape, Garment garment, Cover cover,
                                     uint64_t seed);

}  // namespace rotunda::sim
