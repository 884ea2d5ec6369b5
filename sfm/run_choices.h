#pragma once

#include <map>
#include <optional>
#include <string>

#include "sfm/core/pose_set.h"
#include "sfm/core/result.h"

namespace rotunda::sfm {

enum class Method {
  kTcSfm,
  kLiteral,  // TC-SfM as it was published
  kPlain,    // incremental structure from motion as it is: folds when front and back look the same
};
const char* MethodName(Method method);  // "tc-sfm", "tc-sfm literal", "plain"

enum class Preset {
  kRig,       // a cylinder of calibrated cameras around a person; the default
  kInternet,  // photographs from anywhere: nothing is known of where the cameras stand
  kLiteral,   // TC-SfM word for word, to compare with
};

enum class PairSelection { kExhaustive, kNeighbours };

/// What may be asked of a reconstruction, of the command and of the daemon alike, by these names.
struct RunChoices {
  Method method = Method::kTcSfm;
  Preset preset = Preset::kRig;
  PairSelection pairs = PairSelection::kExhaustive;
  bool calibration_prior = false;                        // PipelineOptions::calibration_prior
  std::optional<bool> refine_intrinsics = std::nullopt;  // likewise

  /// kInvalidArgument, with the field's name as context: one that has no effect on the method.
  Status Validate() const;
};
const std::map<std::string, Method>& MethodsByName();  // without the literal one, which is a preset
const std::map<std::string, Preset>& PresetsByName();  // "internet", "literal", "rig"
const std::map<std::string, PairSelection>& PairSelectionsByName();  // "exhaustive", "neighbours"
const std::map<std::string, bool>& PriorsByName();  // "calibration": true, "none": false

/// Whether the calibrated poses can be a prior of the method: kInvalidArgument.
Status CheckPriorOf(Method method);

/// How a result names its preset and its prior among PoseSet::options.
inline constexpr char kPresetOption[] = "preset";
inline constexpr char kPriorOption[] = "prior";
/// The prior of a result by its name; "none" where it does not say.
std::string PriorOf(const PoseSet& poses);
/// Whether the poses had the calibration as prior: they are no evidence of where cameras stand.
bool HadPrior(const PoseSet& poses);

}  // namespace rotunda::sfm
