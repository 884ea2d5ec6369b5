#pragma once

#include "rig/sim/world.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"

namespace rotunda::sim {

/// Radiance of the studio's lights seen in a direction (rig frame, unit length): a bright ceiling,
/// soft boxes around, a dim floor.
float StudioRadiance(const Eigen::Vector3f& direction);

/// Fills WorldObject::light: irradiance / pi at every vertex by hemisphere sampling with occlusion
/// by what casts shadows; occluded directions give a little light back (one bounce). The same for
/// any number of threads. Errors as RayScene::Build.
Status BakeLight(World* world, ThreadPool& threads);

}  // namespace rotunda::sim
