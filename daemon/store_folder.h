#pragma once

#include <filesystem>

#include "sfm/core/result.h"

// Private to the .cc files of the store and of the service.

namespace rotunda::daemon {

/// Makes `folder` unless it is there. kIo, in one line: what keeps this process from writing in it,
/// whose it is, and what to do.
Status MakeWritableFolder(const std::filesystem::path& folder);

/// Changes nothing. kIo: this process's user cannot write in `folder`, or in what is there above
/// one that is to be made: whose that is.
Status CheckFolderForWriting(const std::filesystem::path& folder);

/// As MakeWritableFolder of a file; fine when it is not there.
Status CheckWritableFile(const std::filesystem::path& file);

}  // namespace rotunda::daemon
