#pragma once

#include <filesystem>

#include "sfm/core/result.h"

// Private to the .cc files of the store and of the service.

namespace rotunda::daemon {

/// Makes `folder` unless it is there. kIo, in one line: what keeps this process from writing in it,
/// whose it is, and what to do.
Status MakeWritableFolder(const std::filesystem::path& folder);

/// Changes nothing. kIo: this process's user has no `access` (R_OK | W_OK | X_OK) to `folder`,
/// cannot see it, or cannot make it in what is there above: whose that is, or else why.
Status CheckFolderForWriting(const std::filesystem::path& folder, int access);

/// As MakeWritableFolder of a file; fine when it is not there.
Status CheckWritableFile(const std::filesystem::path& file);

}  // namespace rotunda::daemon
