#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "rig/board.h"
#include "rig/sim/body_shape.h"
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

/// A camera that somebody has pushed or turned since the rig was calibrated.
struct MovedCamera {
  std::string camera;
  double right_mm = 0;  // along its own x axis
  double turn_deg = 0;  // to its right, about its own y axis and centre
};

struct SimulateOptions {
  Target target = Target::kBody;
  rig::Board board = rig::CuboidBoard({});  // the target kCuboid: any board
  double board_errors = 1.0;                // times BoardErrors; 0: the board is as drawn
  int placement = 0;                        // of the board; see BoardPlacement
  std::string body = "procedural";          // or the path of an .obj
  GarmentTexture texture = GarmentTexture::kUnique;
  Relief relief = Relief::kNatural;
  Cover cover = Cover::kNone;
  Background background = Background::kStudio;
  double height_m = 1.75;  // of the body
  uint64_t seed = 0;
  int cameras = 90;            // how many of the rig's
  double picture_scale = 1.0;  // of the rig's picture size
  std::vector<MovedCamera> moved;
};

/// The faces of the target as they really are: the same in every placement of a seed.
std::vector<CalibratedFace> BoardOf(const SimulateOptions& options);
/// The exact cameras of the simulated rig, moved ones where they are now. kInvalidArgument names
/// the option.
Result<Calibration> SimulatedTruth(const RigOptions& rig, const SimulateOptions& options);

/// Who or what stands in the rig, dressed and lit.
Result<World> BuildWorld(const RigOptions& rig, const SimulateOptions& options,
                         RunContext& context);

/// One camera's 8-bit picture of a lit world.
Picture RenderPicture(const World& world, const RayScene& scene, const CalibratedCamera& camera,
                      const RigSensor& sensor, const SimulateOptions& options);

/// Writes a frame set with truth.json (with the target, also its board) and calibration.json
/// (DrawCalibration; of the rig before cameras were moved) to `out`, which appears whole or not at
/// all. The bytes depend on the options alone. kInvalidArgument names the option; kCancelled when
/// stopped.
Status SimulateFrameSet(const RigOptions& rig, const SimulateOptions& options,
                        const std::filesystem::path& out, RunContext& context);

/// A set of `count` shots of the target for a calibration: the frame sets `out`/placement_00, ...,
/// of the placements from options.placement on, all by the same rig and of the same target. `out`
/// appears whole or not at all.
Status SimulatePlacements(const RigOptions& rig, const SimulateOptions& options, int count,
                          const std::filesystem::path& out, RunContext& context);

}  // namespace rotunda::sim
