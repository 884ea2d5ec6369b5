#pragma once

#include <vector>

#include "tests/bench/disambiguation_record.h"
#include "tests/bench/limits.h"

namespace rotunda::bench {

/// What tc-sfm must reach, on the cells that were run: all cameras, no fold and the errors on the
/// mean set; right or flagged on the stressed captures; right on the photographs; sigmas that are
/// believable; times that are a share of colmap's. And the captures must be mean enough that others
/// fold on most of what should fold. Prints what is not so.
void JudgeRows(const std::vector<TableRow>& rows, Limits& limits);

}  // namespace rotunda::bench
