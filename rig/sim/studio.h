#pragma once

#include "rig/sim/rig_options.h"
#include "rig/sim/world.h"

namespace rotunda::sim {

/// Floor with marks, dark curtain, and the rig's poles with their cameras, as things in the world.
void AddStudio(const RigGeometry& rig, uint64_t seed, World* world);

}  // namespace rotunda::sim
