#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "sfm/core/result.h"

namespace rotunda::daemon {

/// Formats that a reconstruction can be written in: "colmap", "colmap-text", "nerfstudio",
/// "metashape", "realitycapture" (sfm/model_exchange.h), "ply".
const std::vector<std::string>& ExportFormats();

struct ExportedModel {
  size_t images = 0;  // registered
  size_t points = 0;
};

/// Writes the model of the folder `reconstruction` into the existing folder `out`.
Result<ExportedModel> ExportModel(const std::filesystem::path& reconstruction,
                                  const std::string& format, const std::filesystem::path& out);

/// The files of a folder (not those below it) as a tar archive (POSIX ustar), sorted by name, with
/// no times and owners: the same files give the same bytes.
Result<std::string> TarOf(const std::filesystem::path& folder);

}  // namespace rotunda::daemon
