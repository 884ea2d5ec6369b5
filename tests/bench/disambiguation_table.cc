#include "tests/bench/disambiguation_table.h"

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <map>
#include <optional>

namespace rotunda::bench {
namespace {

using Json = nlohmann::ordered_json;

constexpr size_t kMaxNames = 8;  // of cameras in one line
constexpr char kHeader[] =
    "capture                               method                     reg/of   folded      models "
    " e_r mean    max deg  e_t mean     max mm   margin  verdict  rot/sigma pos/sigma  seconds  "
    "/colmap\n";

__attribute__((format(printf, 1, 2))) std::string Format(const char* format, ...) {
  char line[512];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(line, sizeof line, format, arguments);
  va_end(arguments);
  return line;
}

std::string Cell(const std::optional<double>& value, int width, int decimals) {
  if (!value) return Format("%*s", width, "-");
  return Format("%*.*f", width, decimals, *value);
}

/// Where a method that gives margins gives none, nothing looks alike; but a fold that only the
/// calibration shows has no margin.
std::string MarginText(const CellRecord& record) {
  const bool judged = record.value("gives_margins", false) && record["verdict"] != "folded";
  if (judged && !record.contains("margin")) return Format("%8s", "no twin");
  return Cell(Number(record, "margin"), 8, 2);
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

/// Of photographs: whether the copies of the object stand apart, why, and the picture of it.
std::string ScenesText(const CellRecord& record) {
  if (!record.contains("scene")) return "";
  const Json& scene = record["scene"];
  const std::string right = scene["right"].get<bool>() ? "right" : "WRONG";
  return "    " + right + ": " + scene["why"].get<std::string>() +
         "\n    truth: " + scene["truth"].get<std::string>() + "\n    " +
         scene["picture"].get<std::string>() + "\n";
}

std::string RowText(const CellRecord& record, const ColmapTimes& colmap) {
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
          Cell(Number(record, "seconds"), 9, 1) + Cell(colmap.Over(record), 9, 2) + "\n";
  return line + ScenesText(record) + NamedText(record);
}

/// What the cells of one method in one group come to.
struct Tally {
  int cells = 0, errors = 0, complete = 0, folded = 0, folded_unsaid = 0, warned_in_vain = 0;
  std::optional<double> as_varied;  // the same poses, to the last bit, as the method it varies
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

void Count(const CellRecord& record, const ColmapTimes& colmap, Tally& tally) {
  ++tally.cells;
  if (HasError(record)) {
    ++tally.errors;
    return;
  }
  tally.complete += IsComplete(record);
  tally.folded += IsFolded(record);
  tally.folded_unsaid += IsFolded(record) && !PicturesWarn(record);
  tally.warned_in_vain += !IsFolded(record) && Warns(record);
  Put(Number(record, "seconds"), tally.seconds);
  Put(colmap.Over(record), tally.over_colmap);
  if (IsFolded(record)) return;
  Put(Evaluated(record, "mean_rotation_deg"), tally.rotation_deg);
  Put(Evaluated(record, "mean_position_mm"), tally.position_mm);
  Put(Square(Evaluated(record, "rotation_error_over_sigma")), tally.rotation_square);
  Put(Square(Evaluated(record, "position_error_over_sigma")), tally.position_square);
}

std::optional<double> Median(std::vector<double> values) {
  if (values.empty()) return std::nullopt;
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

/// Of an ablation's method, that of the method it varies on the same capture, when both are known.
const CellRecord* FindVaried(const std::vector<const CellRecord*>& records,
                             const CellRecord& varying) {
  const std::string method = varying["method"];
  const auto varied = std::find_if(records.begin(), records.end(), [&](const CellRecord* record) {
    const std::string base = (*record)["method"];
    const bool varies = method.size() > base.size() && method.starts_with(base);
    return varies && (*record)["capture"] == varying["capture"] && record->contains("poses_xxh3") &&
           varying.contains("poses_xxh3");
  });
  return varied == records.end() ? nullptr : *varied;
}

std::string SummaryText(const std::vector<const CellRecord*>& records, const ColmapTimes& colmap) {
  std::vector<std::pair<std::string, Tally>> tallies;
  for (const CellRecord* record : records) {
    const std::string method = (*record)["method"];
    auto tally = std::find_if(tallies.begin(), tallies.end(),
                              [&](const auto& entry) { return entry.first == method; });
    if (tally == tallies.end()) tally = tallies.insert(tally, {method, {}});
    Count(*record, colmap, tally->second);
    const CellRecord* varied = FindVaried(records, *record);
    if (varied == nullptr) continue;
    const bool same = (*varied)["poses_xxh3"] == (*record)["poses_xxh3"];
    tally->second.as_varied = tally->second.as_varied.value_or(0) + same;
  }
  std::string text = Format(
      "\nunsaid: not by the pictures alone; no effect: on so many captures the poses are, to the "
      "last bit, those of the method that is varied\n"
      "%-36s captures errors complete folded unsaid warned-in-vain   e_r deg  e_t mm  "
      "(rot/sigma)^2 (pos/sigma)^2  median s  /colmap  no effect\n",
      "by method (errors: without the folded)");
  for (const auto& [method, tally] : tallies) {
    text += Format("%-36s %8d %6d %8d %6d %6d %14d", method.c_str(), tally.cells, tally.errors,
                   tally.complete, tally.folded, tally.folded_unsaid, tally.warned_in_vain);
    text += Cell(Mean(tally.rotation_deg), 10, 4) + Cell(Mean(tally.position_mm), 8, 3) +
            Cell(Mean(tally.rotation_square), 15, 2) + Cell(Mean(tally.position_square), 14, 2) +
            Cell(Median(tally.seconds), 10, 1) + Cell(Median(tally.over_colmap), 9, 2) +
            Cell(tally.as_varied, 11, 0) + "\n";
  }
  return text;
}

/// Mean seconds of the stages of one method's cells.
struct Profile {
  std::string method;
  int cells = 0;
  double whole_s = 0;  // sums
  std::map<std::string, double> stages_s;
};

std::vector<Profile> Profiles(const std::vector<const CellRecord*>& records,
                              std::vector<std::string>& stages) {
  std::vector<Profile> profiles;
  for (const CellRecord* record : records) {
    if (HasError(*record) || !record->contains("stages")) continue;
    const std::string method = (*record)["method"];
    auto profile = std::find_if(profiles.begin(), profiles.end(),
                                [&](const Profile& entry) { return entry.method == method; });
    if (profile == profiles.end()) profile = profiles.insert(profile, {method, 0, 0, {}});
    ++profile->cells;
    profile->whole_s += Number(*record, "seconds").value_or(0);
    for (const Json& stage : (*record)["stages"]) {
      const std::string name = stage["stage"];
      if (std::find(stages.begin(), stages.end(), name) == stages.end()) stages.push_back(name);
      profile->stages_s[name] += stage["seconds"].get<double>();
    }
  }
  return profiles;
}

std::string ProfileText(const std::vector<const CellRecord*>& records) {
  std::vector<std::string> stages;
  const std::vector<Profile> profiles = Profiles(records, stages);
  if (profiles.empty()) return "";
  const auto width = [](const std::string& stage) {
    constexpr size_t kLeastWidth = 8;
    return static_cast<int>(2 + std::max(kLeastWidth, stage.size()));
  };
  std::string text = Format("\n%-36s", "mean seconds by stage");
  for (const std::string& stage : stages) text += Format("%*s", width(stage), stage.c_str());
  text += Format("%10s%10s\n", "the rest", "all");
  for (const Profile& profile : profiles) {
    text += Format("%-36s", profile.method.c_str());
    double rest_s = profile.whole_s;
    for (const std::string& stage : stages) {
      const auto found = profile.stages_s.find(stage);
      const double sum_s = found == profile.stages_s.end() ? 0 : found->second;
      rest_s -= sum_s;
      text += Format("%*.2f", width(stage), sum_s / profile.cells);
    }
    text += Format("%10.2f%10.2f\n", rest_s / profile.cells, profile.whole_s / profile.cells);
  }
  return text;
}

/// Cells that these sources did not make.
std::string OtherRevisionsText(const std::vector<const CellRecord*>& records) {
  std::map<std::string, std::string> cells;  // by revision
  for (const CellRecord* record : records) {
    const std::string revision = record->value("revision", "unknown");
    if (revision == kRevision) continue;
    cells[revision] += "    " + (*record)["capture"].get<std::string>() + ", " +
                       (*record)["method"].get<std::string>() + "\n";
  }
  std::string text;
  for (const auto& [revision, names] : cells) {
    text += "\nof revision " + revision + ", not of " + std::string(kRevision) +
            " (--force runs again):\n" + names;
  }
  return text;
}

}  // namespace

std::string TableText(const std::vector<TableRow>& rows) {
  const ColmapTimes colmap(rows);
  std::string text;
  for (size_t begin = 0; begin < rows.size();) {
    const std::string& group = rows[begin].cell.group;
    text += (begin == 0 ? "" : "\n") + group + "\n" + kHeader;
    std::vector<const CellRecord*> records;
    size_t end = begin;
    for (; end < rows.size() && rows[end].cell.group == group; ++end) {
      text += RowText(rows[end].record, colmap);
      records.push_back(&rows[end].record);
    }
    text += SummaryText(records, colmap) + ProfileText(records) + OtherRevisionsText(records);
    begin = end;
  }
  return text;
}

std::string TableJson(const std::vector<TableRow>& rows) {
  const ColmapTimes colmap(rows);
  Json table = Json::array();
  for (const TableRow& row : rows) {
    Json entry = {{"group", row.cell.group}};
    entry.update(row.record);
    if (const auto ratio = colmap.Over(row.record)) entry["over_colmap"] = *ratio;
    table.push_back(entry);
  }
  return table.dump(1) + "\n";
}

std::string RowText(const CellRecord& record) { return RowText(record, ColmapTimes({})); }

}  // namespace rotunda::bench
