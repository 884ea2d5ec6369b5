#include "tests/bench/disambiguation_record.h"

#include <algorithm>
#include <numeric>

namespace rotunda::bench {
namespace {

constexpr char kSureVerdict[] = "sure";  // the verdict of a result that stands by itself
constexpr char kColmap[] = "colmap";

}  // namespace

bool HasError(const CellRecord& record) { return record.contains("error"); }

std::optional<double> Number(const CellRecord& object, const char* key) {
  if (!object.contains(key) || !object[key].is_number()) return std::nullopt;
  return object[key].get<double>();
}

std::optional<double> Evaluated(const CellRecord& record, const char* key) {
  if (!record.contains("evaluation")) return std::nullopt;
  return Number(record["evaluation"], key);
}

bool IsFolded(const CellRecord& record) {
  return record.contains("evaluation") && record["evaluation"]["folded"];
}

bool Warns(const CellRecord& record) {
  if (record.value("says_folded", false)) return true;
  return record.contains("verdict") && record["verdict"] != kSureVerdict;
}

bool PicturesWarn(const CellRecord& record) {
  return record.value("verdict_of_pictures", kSureVerdict) != kSureVerdict;
}

bool IsComplete(const CellRecord& record) {
  return record.value("registered", 0) == record.value("of", -1);
}

const CellRecord* Find(const std::vector<TableRow>& rows, const TableRow& same_capture,
                       const std::string& method) {
  const auto found = std::find_if(rows.begin(), rows.end(), [&](const TableRow& row) {
    return row.cell.group == same_capture.cell.group && row.cell.method.name == method &&
           row.cell.capture.name == same_capture.cell.capture.name;
  });
  return found == rows.end() ? nullptr : &found->record;
}

std::optional<double> Mean(const std::vector<double>& values) {
  if (values.empty()) return std::nullopt;
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

ColmapTimes::ColmapTimes(const std::vector<TableRow>& rows) {
  for (const TableRow& row : rows) {
    const auto value = Number(row.record, "seconds");
    if (row.record["method"] == kColmap && value) {
      seconds_.emplace_back(row.record["capture"], *value);
    }
  }
}

std::optional<double> ColmapTimes::Over(const CellRecord& record) const {
  const auto theirs = std::find_if(seconds_.begin(), seconds_.end(), [&](const auto& entry) {
    return entry.first == record["capture"];
  });
  const auto ours = Number(record, "seconds");
  if (theirs == seconds_.end() || !ours || record["method"] == kColmap) return std::nullopt;
  return *ours / theirs->second;
}

}  // namespace rotunda::bench
