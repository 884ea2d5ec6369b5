#pragma once

#include <filesystem>
#include <string>

#include "tests/bench/disambiguation_methods.h"

namespace rotunda::bench {

/// What became of a scene's copies.
struct SceneJudgement {
  bool right = false;
  std::string why;
};

/// Whether the two copies stand apart: the balls about the middles of their points that hold most
/// of either do not touch. Draws the layout from above and, below it, photographs of each copy with
/// the keypoints in the colours of their communities (as in report.html; where the method has
/// communities). `model`: what the method gave, a COLMAP model; the communities are not in it, so
/// the method is run again from the same stages.
SceneJudgement JudgeScene(const Cell& cell, const CaptureFiles& files,
                          const std::filesystem::path& model, const std::filesystem::path& png);

}  // namespace rotunda::bench
