#pragma once

#include <string>
#include <vector>

#include "tests/bench/disambiguation_cells.h"

namespace rotunda::bench {

/// A cell that was run.
struct TableRow {
  std::string group;
  CellRecord record;
};

/// One table a group in the order of the rows, each with a summary by method below.
std::string TableText(const std::vector<TableRow>& rows);
/// The records with their groups and, where colmap ran on the same capture, the ratio of times.
std::string TableJson(const std::vector<TableRow>& rows);
/// The row of one cell, as in the table.
std::string RowText(const CellRecord& record);

}  // namespace rotunda::bench
