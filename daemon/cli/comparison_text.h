#pragma once

#include <nlohmann/json.hpp>

#include "rig/calibration_comparison.h"

namespace rotunda::cli {

/// For programs: what changed, camera by camera, and whether the two are of one rig.
nlohmann::ordered_json ComparisonJson(const rig::CalibrationComparison& comparison);

/// For people: how much all cameras scatter, then who moved; `nothing_changed` when
/// nobody did.
void PrintComparison(const rig::CalibrationComparison& comparison, const char* nothing_changed);

}  // namespace rotunda::cli
