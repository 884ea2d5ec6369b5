#include "rig/sim/rendered_shot.h"

#include <mutex>
#include <utility>

#include "rig/sim/ray_scene.h"

namespace rotunda::sim {

Result<ServedShots> RenderShot(const RigOptions& rig, const SimulateOptions& options,
                               PixelFormat format, RunContext& context) {
  ROTUNDA_ASSIGN_OR_RETURN(const Calibration truth, SimulatedTruth(rig, options));
  ROTUNDA_ASSIGN_OR_RETURN(const World world, BuildWorld(rig, options, context));
  ROTUNDA_ASSIGN_OR_RETURN(const RayScene scene, RayScene::Build(world, false));
  const auto images = std::make_shared<std::vector<std::shared_ptr<const ServedImage>>>();
  images->resize(truth.cameras.size());
  std::mutex progress;
  size_t done = 0;
  context.threads.ParallelFor(
      images->size(),
      [&](size_t i) {
        Picture picture = RenderPicture(world, scene, truth.cameras[i], rig.sensor, options);
        ServedImage image{picture.width, picture.height, PixelFormat::kRgb8,
                          std::move(picture.rgb)};
        (*images)[i] = std::make_shared<const ServedImage>(
            format == image.format ? std::move(image) : ConvertImage(image, format));
        const std::scoped_lock lock(progress);
        context.Report("pictures", ++done, images->size());
      },
      context.stop);
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "stopped while rendering", ""};
  ServedShots served;
  served.format = format;
  for (const CalibratedCamera& camera : truth.cameras) {
    served.cameras.push_back(camera.camera);
    served.serials.push_back(camera.serial);
    served.width_px = camera.intrinsics.width_px;
    served.height_px = camera.intrinsics.height_px;
  }
  served.source = [images](const Exposure& exposure) {
    return (*images)[static_cast<size_t>(exposure.camera)];
  };
  return served;
}

}  // namespace rotunda::sim
