#pragma once

#include <string>

#include "rig/sim/texture.h"
#include "sfm/core/result.h"

namespace rotunda::sim {

/// The picture as the bytes of an RGB8 PNG file; lossless, little effort.
Result<std::string> EncodePng(const Picture& picture);

}  // namespace rotunda::sim
