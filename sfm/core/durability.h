#pragma once

#include <filesystem>

#include "sfm/core/result.h"

namespace rotunda {

/// fsync of what `path` names, a file or, with the flag O_DIRECTORY, a folder, whose names it makes
/// durable. kIo with errno's text.
Status MakeDurable(const std::filesystem::path& path, int flags = 0);

}  // namespace rotunda
