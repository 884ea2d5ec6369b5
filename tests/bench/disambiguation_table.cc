#include "tests/bench/disambiguation_table.h"

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <map>
#include <optional>

namespace rotunda::bench {
namespace {

using Json = nlohmann::ordered_json;

constexpr char kSureVerdict[] = "sure";  // the verdict of a result that stands by itself
constexpr size_t kMaxNames = 8;          // of cameras in one line
constexpr char kHeader[] =
    "capture                               method                     reg/of   folded      models "
    " e_r mean    max deg  e_t mean     max mm  margin  verdict  rot/sigma pos/sigma  seconds  "
    "/colmap\n";

__attribute__((format(printf, 1, 2))) std::string Format(const char* format, ...) {
  char line[512];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(line, sizeof line, format, arguments);
  va_end(arguments);
  return line;
}

bool HasError(const CellRecord& record) { return record.contains("error"); }

std::optional<double> Number(const Json& object, const char* key) {
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

/// Whether the result itself warns.
bool Warns(const CellRecord& record) {
  if (record.value("says_folded", false)) return true;
  return record.contains("verdict") && record["verdict"] != kSureVerdict;
}

std::string Cell(const std::optional<double>& value, int width, int decimals) {
  if (!value) return Format("%*s", width, "-");
  return Format("%*.*f", width, decimals, *value);
}

/// A margin that nothing contradicts is infinite, which JSON has no number for.
std::string MarginText(const CellRecord& record) {
  if (record.contains("margin") && record["margin"].is_null()) return "    inf";
  return Cell(Number(record, "margin"), 7, 2);
}

std::string FoldedText(const CellRecord& record) {
  if (!record.contains("evaluation")) return Warns(record) ? "? (said)" : "?";
  if (!IsFolded(record)) return Warns(record) ? "no (said)" : "no";
  return Warns(record) ? "YES (said)" : "YES";
}

std::string Join(const Json& names) {
  std::string text;
  for (size_t i = 0; i < names.size() && i < kMaxNames; ++i) {
    text += (i == 0 ? "" : " ") + names[i].get<std::string>();
  }
  if (names.size() > kMaxNames)
    text += " and " + std::to_string(names.size() - kMaxNames) + " more";
  return text.empty() ? "none" : text;
}

/// Which cameras are said to have moved or to be swapped, and which are.
std::string NamedText(const CellRecord& record) {
  std::string text;
  for (const char* what : {"moved", "swapped"}) {
    const Json expected = record.contains("expected") ? record["expected"][what] : Json::array();
    const Json named = record.contains(what) ? record[what] : Json::array();
    if (expected.empty() && named.empty()) continue;
    text += Format("    %s: %s, true: %s\n", what, Join(named).c_str(), Join(expected).c_str());
  }
  return text;
}

using ColmapSeconds = std::map<std::string, double>;  // by capture

ColmapSeconds SecondsOfColmap(const std::vector<TableRow>& rows) {
  ColmapSeconds seconds;
  for (const TableRow& row : rows) {
    const auto value = Number(row.record, "seconds");
    if (row.record["method"] == "colmap" && value) seconds[row.record["capture"]] = *value;
  }
  return seconds;
}

std::optional<double> OverColmap(const CellRecord& record, const ColmapSeconds& colmap) {
  const auto theirs = colmap.find(record["capture"]);
  const auto ours = Number(record, "seconds");
  if (theirs == colmap.end() || !ours || record["method"] == "colmap") return std::nullopt;
  return *ours / theirs->second;
}

std::string RowText(const CellRecord& record, const ColmapSeconds& colmap) {
  const std::string capture = record["capture"], method = record["method"];
  std::string line = Format("%-37s %-24s ", capture.c_str(), method.c_str());
  if (HasError(record)) return line + "error: " + record["error"].get<std::string>() + "\n";
  const std::string registered =
      Format("%d/%d", record.value("registered", 0), record.value("of", 0));
  const std::string verdict = record.value("verdict", "-");
  line += Format("%8s   %-11s %6d ", registered.c_str(), FoldedText(record).c_str(),
                 record.value("models", 0));
  line += Cell(Evaluated(record, "mean_rotation_deg"), 10, 4) +
          Cell(Evaluated(record, "max_rotation_deg"), 11, 4) +
          Cell(Evaluated(record, "mean_position_mm"), 10, 3) +
          Cell(Evaluated(record, "max_position_mm"), 11, 3) + " " + MarginText(record);
  line += Format("  %-8s", verdict.c_str());
  line += Cell(Evaluated(record, "rotation_error_over_sigma"), 10, 2) +
          Cell(Evaluated(record, "position_error_over_sigma"), 10, 2) +
          Cell(Number(record, "seconds"), 9, 1) + Cell(OverColmap(record, colmap), 9, 2) + "\n";
  if (record.contains("layout")) line += "    " + record["layout"].get<std::string>() + "\n";
  return line + NamedText(record);
}

/// What the cells of one method in one group come to.
struct Tally {
  int cells = 0, errors = 0, complete = 0, folded = 0, folded_unsaid = 0, warned_in_vain = 0;
  // Over what is not folded: the figures of a folded capture would drown all others.
  std::vector<double> rotation_deg, position_mm, rotation_square, position_square;
  std::vector<double> seconds, over_colmap;
};

void Put(const std::optional<double>& value, std::vector<double>& values) {
  if (value) values.push_back(*value);
}
std::optional<double> Square(const std::optional<double>& value) {
  return value ? std::optional(*value * *value) : std::nullopt;
}

void Count(const CellRecord& record, const ColmapSeconds& colmap, Tally& tally) {
  ++tally.cells;
  if (HasError(record)) {
    ++tally.errors;
    return;
  }
  tally.complete += record.value("registered", 0) == record.value("of", -1);
  tally.folded += IsFolded(record);
  tally.folded_unsaid += IsFolded(record) && !Warns(record);
  tally.warned_in_vain += !IsFolded(record) && Warns(record);
  Put(Number(record, "seconds"), tally.seconds);
  Put(OverColmap(record, colmap), tally.over_colmap);
  if (IsFolded(record)) return;
  Put(Evaluated(record, "mean_rotation_deg"), tally.rotation_deg);
  Put(Evaluated(record, "mean_position_mm"), tally.position_mm);
  Put(Square(Evaluated(record, "rotation_error_over_sigma")), tally.rotation_square);
  Put(Square(Evaluated(record, "position_error_over_sigma")), tally.position_square);
}

std::optional<double> Mean(const std::vector<double>& values) {
  if (values.empty()) return std::nullopt;
  double sum = 0;
  for (double value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

std::optional<double> Median(std::vector<double> values) {
  if (values.empty()) return std::nullopt;
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

std::string SummaryText(const std::vector<const CellRecord*>& records,
                        const ColmapSeconds& colmap) {
  std::vector<std::pair<std::string, Tally>> tallies;
  for (const CellRecord* record : records) {
    const std::string method = (*record)["method"];
    auto tally = std::find_if(tallies.begin(), tallies.end(),
                              [&](const auto& entry) { return entry.first == method; });
    if (tally == tallies.end()) tally = tallies.insert(tally, {method, {}});
    Count(*record, colmap, tally->second);
  }
  std::string text = Format(
      "\n%-36s captures errors complete folded unsaid warned-in-vain   e_r deg  e_t mm  "
      "(rot/sigma)^2 (pos/sigma)^2  median s  /colmap\n",
      "by method (errors: without the folded)");
  for (const auto& [method, tally] : tallies) {
    text += Format("%-36s %8d %6d %8d %6d %6d %14d", method.c_str(), tally.cells, tally.errors,
                   tally.complete, tally.folded, tally.folded_unsaid, tally.warned_in_vain);
    text += Cell(Mean(tally.rotation_deg), 10, 4) + Cell(Mean(tally.position_mm), 8, 3) +
            Cell(Mean(tally.rotation_square), 15, 2) + Cell(Mean(tally.position_square), 14, 2) +
            Cell(Median(tally.seconds), 10, 1) + Cell(Median(tally.over_colmap), 9, 2) + "\n";
  }
  return text;
}

}  // namespace

std::string TableText(const std::vector<TableRow>& rows) {
  const ColmapSeconds colmap = SecondsOfColmap(rows);
  std::string text;
  for (size_t begin = 0; begin < rows.size();) {
    const std::string& group = rows[begin].group;
    text += (begin == 0 ? "" : "\n") + group + "\n" + kHeader;
    std::vector<const CellRecord*> records;
    size_t end = begin;
    for (; end < rows.size() && rows[end].group == group; ++end) {
      text += RowText(rows[end].record, colmap);
      records.push_back(&rows[end].record);
    }
    text += SummaryText(records, colmap);
    begin = end;
  }
  return text;
}

std::string TableJson(const std::vector<TableRow>& rows) {
  const ColmapSeconds colmap = SecondsOfColmap(rows);
  Json table = Json::array();
  for (const TableRow& row : rows) {
    Json entry = {{"group", row.group}};
    entry.update(row.record);
    if (const auto ratio = OverColmap(row.record, colmap)) entry["over_colmap"] = *ratio;
    table.push_back(entry);
  }
  return table.dump(1) + "\n";
}

std::string RowText(const CellRecord& record) { return RowText(record, {}); }

}  // namespace rotunda::bench
