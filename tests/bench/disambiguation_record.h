#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tests/bench/disambiguation_cells.h"

namespace rotunda::bench {

/// A cell that was run.
struct TableRow {
  Cell cell;
  CellRecord record;
};

bool HasError(const CellRecord& record);
/// nullopt: not there, or no number.
std::optional<double> Number(const CellRecord& object, const char* key);
/// Likewise, of what `rotunda evaluate` found.
std::optional<double> Evaluated(const CellRecord& record, const char* key);
/// Against truth.
bool IsFolded(const CellRecord& record);
/// Whether the result itself warns.
bool Warns(const CellRecord& record);
/// Whether it would without the calibration of the cameras' places, which most captures come with.
bool PicturesWarn(const CellRecord& record);
/// All cameras have a pose.
bool IsComplete(const CellRecord& record);

/// The row of another method on the same capture in the same group; nullptr: it was not run.
const CellRecord* Find(const std::vector<TableRow>& rows, const TableRow& same_capture,
                       const std::string& method);

/// nullopt without values.
std::optional<double> Mean(const std::vector<double>& values);

/// The rows' time over that of colmap's mapper on the same capture; nullopt where one is not known,
/// and of colmap itself.
class ColmapTimes {
 public:
  explicit ColmapTimes(const std::vector<TableRow>& rows);
  std::optional<double> Over(const CellRecord& record) const;

 private:
  std::vector<std::pair<std::string, double>> seconds_;  // by capture
};

}  // namespace rotunda::bench
