#pragma once

#include <string>

#include "sfm/report_facts.h"

namespace rotunda::sfm::report {

/// One SVG: a row of bars by camera for every graded figure, over one axis of camera names. Empty
/// when there is nothing to draw.
std::string DrawBars(const ReportInput& input, const Facts& facts);

}  // namespace rotunda::sfm::report
