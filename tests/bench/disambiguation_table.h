#pragma once

#include <string>
#include <vector>

#include "tests/bench/disambiguation_record.h"

namespace rotunda::bench {

/// One table a group in the order of the rows, each with a summary by method, the mean seconds of
/// every stage by method, and the cells that another revision made below.
std::string TableText(const std::vector<TableRow>& rows);
/// The records with their groups and, where colmap ran on the same capture, the ratio of times.
std::string TableJson(const std::vector<TableRow>& rows);
/// The row of one cell, as in the table.
std::string RowText(const CellRecord& record);

}  // namespace rotunda::bench
