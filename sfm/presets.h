#pragma once

#include <string>
#include <string_view>

#include "sfm/core/result.h"
#include "sfm/pipeline.h"
#include "sfm/run_choices.h"

namespace rotunda::sfm {

/// Sets what the preset changes of the method tc-sfm.
void ApplyPreset(Preset preset, PipelineOptions& options);

/// What the choices stand for; they are valid.
PipelineOptions OptionsOf(const RunChoices& choices);

/// Sets one option by its name, for comparisons. kInvalidArgument names the key or the value and
/// what is known or expected, also when the option does not act on `options.method`.
Status SetOption(std::string_view key, std::string_view value, PipelineOptions& options);

/// Whether that option acts where features are made, and nowhere else.
bool ActsOnFeatures(std::string_view key);

}  // namespace rotunda::sfm
