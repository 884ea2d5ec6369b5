#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "rig/sim/body_shape.h"
#include "rig/sim/cuboid.h"
#include "rig/sim/garment.h"
#include "rig/sim/ray_scene.h"
#include "rig/sim/rig_options.h"
#include "rig/sim/texture.h"
#include "rig/sim/world.h"
#include "sfm/core/calibration.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"

namespace rotunda::sim {

enum class Target { kBody, kCuboid };
enum class Background { kStudio, kPlain };

struct SimulateOptions {
  Target target = Target::kBody;
  CuboidOptions cuboid;
  int placement = 0;                // of the cuboid; see CuboidPlacement
  std::string body = "procedural";  // or the path of an .obj
  GarmentTexture texture = GarmentTexture::kUnique;
  Relief relief = Relief::kNatural;
  Cover cover = Cover::kNone;
  Background background = Background::kStudio;
  double height_m = 1.75;  // of the body
  uint64_t seed = 0;
  int cameras = 90;            // how many of the rig's
  double picture_scale = 1.0;  // of the rig's picture size
};

/// The exact cameras of the simulated rig. kInvalidArgument names the option.
Result<Calibration> SimulatedTruth(const RigOptions& rig, const SimulateOptions& options);

/// Who or what stands in the rig, dressed and lit.
Result<World> BuildWorld(const RigOptions& rig, const SimulateOptions& options,
                         RunContext& context);

/// One camera's 8-bit picture of a lit world.
Picture RenderPicture(const World& world, const RayScene& scene, const CalibratedCamera& camera,
                      const RigSensor& sensor, const SimulateOptions& options);

/// Writes a frame set with truth.json and calibration.json (DrawCalibration) to `out`, which
/// appears whole or not at all. The bytes depend on the options alone. kInvalidArgument names the
/// option; kCancelled when stopped.
Status SimulateFrameSet(const RigOptions& rig, const SimulateOptions& options,
                        const std::filesystem::path& out, RunContext& context);

}  // namespace rotunda::sim
