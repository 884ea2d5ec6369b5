#include "rig/sim/simulate.h"

#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <mutex>
#include <optional>
#include <sstream>

#include "rig/sim/board_object.h"
#include "rig/sim/body_paint.h"
#include "rig/sim/calibrated_rig.h"
#include "rig/sim/lighting.h"
#include "rig/sim/obj_body.h"
#include "rig/sim/png_writer.h"
#include "rig/sim/ray_scene.h"
#include "rig/sim/renderer.h"
#include "rig/sim/sensor.h"
#include "rig/sim/studio.h"
#include "sfm/core/calibration.h"
#include "sfm/core/checksum.h"
#include "sfm/core/file_io.h"
#include "sfm/core/frame_set.h"

namespace rotunda::sim {
namespace {

// What each part of the world draws its seed by.
enum SeedOf : uint64_t {
  kRigSeed,
  kProportionsSeed,
  kGarmentSeed,
  kSkinSeed,
  kStudioSeed,
  kNoiseSeed,
  kBoardSeed
};

constexpr float kBodyVoxel_m = 0.0035f;
constexpr float kBackdropStudio = 0.012f;  // above the curtain
constexpr float kBackdropPlain = 0.09f;

Status Validate(const RigOptions& rig, const SimulateOptions& options) {
  ROTUNDA_RETURN_IF_ERROR(rig.Validate());
  if (options.target == Target::kCuboid) ROTUNDA_RETURN_IF_ERROR(options.board.Validate());
  const int most = rig.geometry.columns * rig.geometry.rows;
  const auto refused = [](const char* what, double value, const std::string& expected) {
    std::ostringstream text;
    text << what << " is " << value << ", expected " << expected;
    return Error{ErrorCode::kInvalidArgument, text.str(), ""};
  };
  if (options.cameras < 2 || options.cameras > most) {
    return refused("number of cameras", options.cameras,
                   "2 to " + std::to_string(most) + " (the rig's)");
  }
  if (!(options.height_m >= 0.8 && options.height_m <= 2.2)) {
    return refused("height of the body", options.height_m, "0.8 to 2.2 m");
  }
  if (!(options.picture_scale > 0.05 && options.picture_scale <= 2.0)) {
    return refused("scale of the pictures", options.picture_scale, "more than 0.05, at most 2");
  }
  if (options.placement < 0) {
    return refused("placement of the cuboid", options.placement, "0 or more");
  }
  if (!(options.board_errors >= 0 && options.board_errors <= 20)) {
    return refused("errors of the board", options.board_errors, "0 to 20 (times the usual ones)");
  }
  if (options.target == Target::kBody && options.texture == GarmentTexture::kOwn &&
      options.body == "procedural") {
    return Error{ErrorCode::kInvalidArgument,
                 "'own' needs a body with a texture (an .obj); the procedural body takes unique, "
                 "twin or plaid",
                 "texture"};
  }
  return {};
}

constexpr int kMostMoved_mm = 1000;
constexpr int kMostTurned_deg = 180;

Status MoveCamera(const MovedCamera& moved, Calibration& truth) {
  if (!(std::abs(moved.right_mm) <= kMostMoved_mm)) {
    return Error{ErrorCode::kInvalidArgument,
                 "a camera is moved by at most " + std::to_string(kMostMoved_mm) + " mm", "moved"};
  }
  if (!(std::abs(moved.turn_deg) <= kMostTurned_deg)) {
    return Error{ErrorCode::kInvalidArgument,
                 "a camera is turned by at most " + std::to_string(kMostTurned_deg) + " degrees",
                 "moved"};
  }
  const auto camera =
      std::find_if(truth.cameras.begin(), truth.cameras.end(),
                   [&](const CalibratedCamera& each) { return each.camera == moved.camera; });
  if (camera == truth.cameras.end()) {
    return Error{ErrorCode::kInvalidArgument,
                 "the rig has no camera '" + moved.camera + "' (or leaves it out: see cameras)",
                 "moved"};
  }
  // x_in_cam = R (x - centre): a centre further right has all points further left.
  camera->cam_from_rig.translation.x() -= 1e-3 * moved.right_mm;
  // And what a camera that turns to the right sees goes to the left.
  const Rigid3 turned_from_cam{
      Eigen::Quaterniond(Eigen::AngleAxisd(-RadFromDeg(moved.turn_deg), Eigen::Vector3d::UnitY())),
      Eigen::Vector3d::Zero()};
  camera->cam_from_rig = turned_from_cam * camera->cam_from_rig;
  return {};
}

/// The calibration that was made before any camera was moved.
Result<Calibration> CalibrationBefore(const RigOptions& rig, const SimulateOptions& options) {
  SimulateOptions before = options;
  before.moved.clear();
  ROTUNDA_ASSIGN_OR_RETURN(const Calibration truth, SimulatedTruth(rig, before));
  return DrawCalibration(truth, options.seed);
}

WorldObject MakeProceduralBody(const SimulateOptions& options, RunContext& context) {
  const BodyShape shape(DrawProportions(DeriveSeed(options.seed, kProportionsSeed)), options.relief,
                        static_cast<float>(options.height_m));
  WorldObject object;
  object.mesh = MakeBodyMesh(shape, kBodyVoxel_m, context.threads);
  Garment garment(options.texture, DeriveSeed(options.seed, kGarmentSeed), shape.layout());
  object.paint =
      MakeBodyPaint(shape, std::move(garment), options.cover, DeriveSeed(options.seed, kSkinSeed));
  return object;
}

Result<WorldObject> MakeObjBody(const SimulateOptions& options) {
  ROTUNDA_ASSIGN_OR_RETURN(ObjBody body,
                           ReadObjBody(options.body, static_cast<float>(options.height_m)));
  if (options.relief == Relief::kSymmetric) {
    ROTUNDA_RETURN_IF_ERROR(MirrorFrontOntoBack(body.layout, &body.mesh));
  }
  std::unique_ptr<Garment> garment;
  if (options.texture != GarmentTexture::kOwn) {
    garment = std::make_unique<Garment>(options.texture, DeriveSeed(options.seed, kGarmentSeed),
                                        body.layout);
  }
  WorldObject object;
  object.mesh = body.mesh;
  object.paint = MakeObjPaint(std::move(body), std::move(garment), options.cover);
  return object;
}

Frame DescribeFrame(const CalibratedCamera& camera, const RigOptions& rig) {
  Frame frame;
  frame.camera = camera.camera;
  frame.serial = camera.serial;
  frame.file = "frames/" + camera.camera + ".png";
  frame.width_px = camera.intrinsics.width_px;
  frame.height_px = camera.intrinsics.height_px;
  frame.pixel_format = "RGB8";
  frame.exposure_us = rig.sensor.exposure_us;
  frame.frame_id = 1;
  return frame;
}

/// Renders and writes every camera's picture below `folder`; fills in the frames' hashes.
Status WritePictures(const World& world, const Calibration& truth, const RigOptions& rig,
                     const SimulateOptions& options, const std::filesystem::path& folder,
                     std::vector<Frame>* frames, RunContext& context) {
  ROTUNDA_ASSIGN_OR_RETURN(const RayScene scene, RayScene::Build(world, false));
  std::vector<std::optional<Error>> errors(frames->size());
  std::mutex progress;
  size_t done = 0;
  context.Report("pictures", 0, frames->size());
  context.threads.ParallelFor(
      frames->size(),
      [&](size_t i) {
        const Result<std::string> png =
            EncodePng(RenderPicture(world, scene, truth.cameras[i], rig.sensor, options));
        Frame& frame = (*frames)[i];
        if (!png) {
          errors[i] = png.error().In(frame.file);
          return;
        }
        frame.xxh3 = Xxh3Text(*png);
        const Status written = WriteFileAtomically(folder / frame.file, *png);
        if (!written) errors[i] = written.error();
        const std::scoped_lock lock(progress);
        context.Report("pictures", ++done, frames->size());
      },
      context.stop);
  for (const std::optional<Error>& error : errors) {
    if (error) return *error;
  }
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "stopped while rendering", ""};
  return {};
}

/// Shots of a set a minute apart, so that calibrations from different ones can be told apart.
std::string TimeOfPlacement(int placement) {
  constexpr int kMinutesADay = 24 * 60;
  char text[48];
  std::snprintf(text, sizeof(text), "2000-01-%02dT%02d:%02d:00Z", 1 + placement / kMinutesADay,
                placement % kMinutesADay / 60, placement % 60);
  return text;
}

/// A frame set into `folder`, which is there and empty.
Status WriteShot(const RigOptions& rig, const Calibration& truth, const SimulateOptions& options,
                 const std::filesystem::path& folder, RunContext& context) {
  ROTUNDA_ASSIGN_OR_RETURN(const World world, BuildWorld(rig, options, context));
  FrameSet set;
  set.id = truth.id;
  if (options.target == Target::kCuboid) {
    set.id += "-placement-" + std::to_string(options.placement);
  }
  set.captured_at =
      options.target == Target::kCuboid ? TimeOfPlacement(options.placement) : truth.created_at;
  set.trigger["source"] = "simulated";
  for (const CalibratedCamera& camera : truth.cameras) {
    set.frames.push_back(DescribeFrame(camera, rig));
  }
  std::error_code failed;
  std::filesystem::create_directory(folder / "frames", failed);
  if (failed) return Error{ErrorCode::kIo, failed.message(), (folder / "frames").string()};
  ROTUNDA_RETURN_IF_ERROR(WritePictures(world, truth, rig, options, folder, &set.frames, context));
  ROTUNDA_RETURN_IF_ERROR(WriteFileAtomically(folder / "truth.json", CalibrationToJson(truth)));
  ROTUNDA_ASSIGN_OR_RETURN(const Calibration calibration, CalibrationBefore(rig, options));
  ROTUNDA_RETURN_IF_ERROR(WriteCalibration(calibration, folder / "calibration.json"));
  return WriteFileAtomically(folder / "frameset.json", FrameSetToJson(set));
}

}  // namespace

std::vector<CalibratedFace> BoardOf(const SimulateOptions& options) {
  return DrawBoard(options.board, options.board_errors, DeriveSeed(options.seed, kBoardSeed));
}

Result<Calibration> SimulatedTruth(const RigOptions& rig, const SimulateOptions& options) {
  ROTUNDA_RETURN_IF_ERROR(Validate(rig, options));
  Calibration truth =
      DrawRig(rig, DeriveSeed(options.seed, kRigSeed), options.cameras, options.picture_scale);
  truth.id = "simulated-" + std::to_string(options.seed);
  if (options.target == Target::kCuboid) truth.board = BoardOf(options);
  for (const MovedCamera& moved : options.moved) {
    ROTUNDA_RETURN_IF_ERROR(MoveCamera(moved, truth));
  }
  return truth;
}

Result<World> BuildWorld(const RigOptions& rig, const SimulateOptions& options,
                         RunContext& context) {
  World world;
  context.Report("world", 0, 2);
  if (options.target == Target::kCuboid) {
    ROTUNDA_ASSIGN_OR_RETURN(
        WorldObject target,
        MakeBoardObject(options.board, BoardOf(options), BoardPlacement(options.placement)));
    world.objects.push_back(std::move(target));
  } else if (options.body == "procedural") {
    world.objects.push_back(MakeProceduralBody(options, context));
  } else {
    ROTUNDA_ASSIGN_OR_RETURN(WorldObject body, MakeObjBody(options));
    world.objects.push_back(std::move(body));
  }
  if (options.background == Background::kStudio) {
    AddStudio(rig.geometry, DeriveSeed(options.seed, kStudioSeed), &world);
  }
  context.Report("world", 1, 2);
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "stopped while building", ""};
  ROTUNDA_RETURN_IF_ERROR(BakeLight(&world, context.threads));
  context.Report("world", 2, 2);
  return world;
}

Picture RenderPicture(const World& world, const RayScene& scene, const CalibratedCamera& camera,
                      const RigSensor& sensor, const SimulateOptions& options) {
  const bool studio = options.background == Background::kStudio;
  const Eigen::Vector3f backdrop =
      Eigen::Vector3f::Constant(studio ? kBackdropStudio : kBackdropPlain);
  const uint64_t name = XXH3_64bits(camera.camera.data(), camera.camera.size());
  const uint64_t seed = DeriveSeed(DeriveSeed(options.seed, kNoiseSeed), name);
  return Expose(RenderLight(world, scene, camera, backdrop), sensor, seed,
                static_cast<uint64_t>(options.placement));
}

Status SimulateFrameSet(const RigOptions& rig, const SimulateOptions& options,
                        const std::filesystem::path& out, RunContext& context) {
  ROTUNDA_ASSIGN_OR_RETURN(const Calibration truth, SimulatedTruth(rig, options));
  ROTUNDA_ASSIGN_OR_RETURN(OutputFolder folder, OutputFolder::Begin(out));
  const Status written = WriteShot(rig, truth, options, folder.path(), context);
  return written.ok() ? folder.Commit() : Status(folder.InPlace(written.error()));
}

Status SimulatePlacements(const RigOptions& rig, const SimulateOptions& options, int count,
                          const std::filesystem::path& out, RunContext& context) {
  ROTUNDA_ASSIGN_OR_RETURN(const Calibration truth, SimulatedTruth(rig, options));
  if (options.target != Target::kCuboid) {
    return Error{ErrorCode::kInvalidArgument,
                 "several placements are of the target cuboid, not of a body", "placements"};
  }
  ROTUNDA_ASSIGN_OR_RETURN(OutputFolder folder, OutputFolder::Begin(out));
  SimulateOptions shot = options;
  for (int i = 0; i < count; ++i) {
    shot.placement = options.placement + i;
    char name[32];
    std::snprintf(name, sizeof(name), "placement_%02d", shot.placement);
    std::error_code failed;
    std::filesystem::create_directory(folder.path() / name, failed);
    if (failed) return Error{ErrorCode::kIo, failed.message(), (out / name).string()};
    const Status written = WriteShot(rig, truth, shot, folder.path() / name, context);
    if (!written.ok()) return folder.InPlace(written.error());
  }
  return folder.Commit();
}

}  // namespace rotunda::sim
