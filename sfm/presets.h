#pragma once

#include <string>
#include <string_view>

#include "sfm/core/result.h"
#include "sfm/pipeline.h"

namespace rotunda::sfm {

enum class Preset {
  kRig,       // a cylinder of calibrated cameras around a person; the default
  kInternet,  // photographs from anywhere: nothing is known of where the cameras stand
  kLiteral,   // TC-SfM word for word, to compare with
};

const char* PresetName(Preset preset);  // "rig", "internet", "literal"

/// Sets what the preset changes of the method tc-sfm.
void ApplyPreset(Preset preset, PipelineOptions& options);

/// Sets one option by its name, for comparisons. kInvalidArgument names the key or the value and
/// what is known or expected, also when the option does not act on `options.method`.
Status SetOption(std::string_view key, std::string_view value, PipelineOptions& options);

/// Whether that option acts where features are made, and nowhere else.
bool ActsOnFeatures(std::string_view key);

}  // namespace rotunda::sfm
