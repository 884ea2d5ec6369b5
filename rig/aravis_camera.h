#pragma once

#include <memory>

#include "rig/camera.h"
#include "sfm/core/result.h"

namespace rotunda::rig {

/// A GigE Vision camera at `place.address` through Aravis; see OpenCamera.
Result<std::unique_ptr<Camera>> OpenAravisCamera(const CameraPlace& place);

}  // namespace rotunda::rig
