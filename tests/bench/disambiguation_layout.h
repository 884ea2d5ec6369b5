#pragma once

#include <filesystem>

namespace rotunda::bench {

/// Draws a COLMAP model from above as a PNG: points in their colours, cameras as numbered wedges
/// (numbers: their order by name). "Above" is against the mean of the cameras' downward axes.
void DrawLayout(const std::filesystem::path& model, const std::filesystem::path& png);

}  // namespace rotunda::bench
