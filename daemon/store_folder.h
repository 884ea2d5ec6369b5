#pragma once

#include <filesystem>

#include "sfm/core/result.h"

// Private to the .cc files of the store.

namespace rotunda::daemon {

/// Makes `folder` unless it is there. kIo, in one line: what keeps this process from writing in it,
/// whose it is, and what to do.
Status MakeWritableFolder(const std::filesystem::path& folder);

/// Likewise of a file; fine when it is not there.
Status CheckWritableFile(const std::filesystem::path& file);

}  // namespace rotunda::daemon
