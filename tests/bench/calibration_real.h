#pragma once

#include <filesystem>

#include "sfm/core/run_context.h"

namespace rotunda::bench {

/// Calibrates real cameras from the shots in `folder` of the board in `board_file`, with its time
/// by stage. A board of one face also goes through mrcal, and both results are compared.
void BenchReal(const std::filesystem::path& board_file, const std::filesystem::path& folder,
               ThreadPool& threads);

}  // namespace rotunda::bench
