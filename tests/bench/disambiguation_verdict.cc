#include "tests/bench/disambiguation_verdict.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <tuple>

namespace rotunda::bench {
namespace {

constexpr char kOurs[] = "tc-sfm";

/// Mean errors in pictures of 1200x1600; in smaller ones so much more.
constexpr double kMaxRotation_deg = 0.03, kMaxPosition_mm = 2.0;
/// On `unique` both methods adjust nearly the same observations: a capture's errors differ by a few
/// per cent to either side. Ours is worse when the mean over the captures is, by more standard
/// errors than these.
constexpr double kWorseErrors = 2.0;
constexpr size_t kFewestToCompare = 3;
/// Of the right results, the share that may say that they are not sure.
constexpr double kMostInVain = 0.25;
/// Of measured error / predicted sigma, mean square over the mean set.
constexpr double kLeastSquare = 0.7, kMostSquare = 1.5;

/// Mean share of colmap's time.
struct TimeLimit {
  const char* garment;
  double of_colmap;
};
constexpr TimeLimit kTimeLimits[] = {{"unique", 0.5}, {"twin", 0.25}, {"twin-symmetric", 0.25}};

/// Captures with nothing wrong.
bool IsMean(const TableRow& row) {
  const std::string& group = row.cell.group;
  return group == "mean" || group == "full-size" || group == "held-out";
}

void JudgeErrors(const TableRow& row, Limits& limits) {
  const Capture& capture = row.cell.capture;
  for (const auto& [key, what, limit] :
       {std::tuple{"mean_rotation_deg", ": mean rotation, deg", kMaxRotation_deg},
        std::tuple{"mean_position_mm", ": mean position, mm", kMaxPosition_mm}}) {
    limits.AtMost(capture.name + what, Evaluated(row.record, key).value(), limit / capture.scale);
  }
}

/// Of the cameras that are said to have moved or changed places, none is wrong.
void JudgeNames(const TableRow& row, Limits& limits) {
  for (const char* what : {"moved", "swapped"}) {
    for (const auto& camera : row.record[what]) {
      const auto& expected = row.record["expected"][what];
      const bool right = std::find(expected.begin(), expected.end(), camera) != expected.end();
      limits.Must(row.cell.capture.name + ": " + camera.get<std::string>() + " has not " +
                      (what == std::string("moved") ? "moved" : "changed places"),
                  right);
    }
  }
}

/// Logarithms of our error over plain's, on the captures where both are right.
std::vector<double> LogRatiosToPlain(const std::vector<TableRow>& rows, const char* key) {
  std::vector<double> ratios;
  for (const TableRow& row : rows) {
    if (!IsMean(row) || row.cell.method.name != kOurs) continue;
    if (row.cell.capture.garment != "unique") continue;
    const CellRecord* plain = Find(rows, row, "plain");
    if (plain == nullptr) continue;
    if (HasError(row.record) || HasError(*plain)) continue;
    if (IsFolded(row.record) || IsFolded(*plain)) continue;
    ratios.push_back(std::log(Evaluated(row.record, key).value() / Evaluated(*plain, key).value()));
  }
  return ratios;
}

void JudgeUnique(const std::vector<TableRow>& rows, Limits& limits) {
  for (const char* key : {"mean_rotation_deg", "mean_position_mm"}) {
    const std::vector<double> ratios = LogRatiosToPlain(rows, key);
    if (ratios.size() < kFewestToCompare) continue;
    const double mean = Mean(ratios).value();
    double squares = 0;
    for (const double ratio : ratios) squares += (ratio - mean) * (ratio - mean);
    const auto count = static_cast<double>(ratios.size());
    const double error = std::sqrt(squares / (count - 1) / count);
    limits.AtMost("unique: " + std::string(key) + " over plain's, mean of its logarithm", mean,
                  kWorseErrors * error);
  }
}

void JudgeMean(const std::vector<TableRow>& rows, Limits& limits) {
  for (const TableRow& row : rows) {
    if (!IsMean(row) || row.cell.method.name != kOurs) continue;
    const std::string& name = row.cell.capture.name;
    limits.Must(name + ": tc-sfm gives a result", !HasError(row.record));
    if (HasError(row.record)) continue;
    limits.Must(name + ": tc-sfm registers all cameras", IsComplete(row.record));
    limits.Must(name + ": tc-sfm does not fold", !IsFolded(row.record));
    if (IsFolded(row.record)) continue;
    JudgeErrors(row, limits);
    JudgeNames(row, limits);
  }
}

/// A method that is never sure is never wrong: of what is right, most must be sure.
void JudgeCertainty(const std::vector<TableRow>& rows, Limits& limits) {
  double right = 0, warned = 0;
  for (const TableRow& row : rows) {
    if (!IsMean(row) || row.cell.method.name != kOurs) continue;
    if (HasError(row.record) || IsFolded(row.record)) continue;
    ++right;
    warned += Warns(row.record);
  }
  if (right == 0) return;
  limits.AtMost("tc-sfm: share of the right results that are not sure", warned / right,
                kMostInVain);
}

/// The pictures' own verdict counts: the calibration of the cameras' places, which the captures
/// come with, would show a fold by itself.
void JudgeStress(const std::vector<TableRow>& rows, Limits& limits) {
  for (const TableRow& row : rows) {
    if (row.cell.group != "stress" || row.cell.method.name != kOurs) continue;
    const CellRecord& record = row.record;
    if (record.value("refused", false)) continue;
    const std::string& name = row.cell.capture.name;
    limits.Must(name + ": tc-sfm gives a result", !HasError(record));
    if (HasError(record)) continue;
    JudgeNames(row, limits);
    if (PicturesWarn(record)) continue;
    limits.Must(name + ": tc-sfm is sure, and folded", !IsFolded(record));
    limits.Must(name + ": tc-sfm is sure, and lacks cameras", IsComplete(record));
    for (const char* what : {"moved", "swapped"}) {
      limits.Must(name + ": tc-sfm is sure, and does not name what has " + what,
                  record[what] == record["expected"][what]);
    }
    if (!IsFolded(record)) JudgeErrors(row, limits);
  }
}

void JudgePhotographs(const std::vector<TableRow>& rows, Limits& limits) {
  for (const TableRow& row : rows) {
    if (row.cell.group != "photographs" || row.cell.method.name != kOurs) continue;
    const bool right = row.record.contains("scene") && row.record["scene"]["right"];
    limits.Must(row.cell.capture.name + ": tc-sfm sets the copies apart", right);
  }
}

/// A set on which nothing folds proves nothing.
void JudgeMeanness(const std::vector<TableRow>& rows, Limits& limits) {
  for (const char* method : {"plain", "colmap"}) {
    int all = 0, folded = 0;
    for (const TableRow& row : rows) {
      if (row.cell.group != "mean" || row.cell.capture.garment != "twin-symmetric") continue;
      if (row.cell.method.name != method || HasError(row.record)) continue;
      ++all;
      folded += IsFolded(row.record);
    }
    limits.Must("the captures are mean enough that " + std::string(method) +
                    " folds on most of twin-symmetric: on " + std::to_string(folded) + " of " +
                    std::to_string(all),
                all == 0 || 2 * folded > all);
  }
}

void JudgeSigmas(const std::vector<TableRow>& rows, Limits& limits) {
  for (const char* key : {"rotation_error_over_sigma", "position_error_over_sigma"}) {
    std::vector<double> squares;
    for (const TableRow& row : rows) {
      if (row.cell.group != "mean" || row.cell.method.name != kOurs || IsFolded(row.record))
        continue;
      const auto ratio = Evaluated(row.record, key);
      if (ratio) squares.push_back(*ratio * *ratio);
    }
    const auto mean = Mean(squares);
    if (!mean) continue;
    const std::string what = std::string("mean square of ") + key;
    limits.AtLeast(what, *mean, kLeastSquare);
    limits.AtMost(what, *mean, kMostSquare);
  }
}

void JudgeTimes(const std::vector<TableRow>& rows, Limits& limits) {
  const ColmapTimes colmap(rows);
  for (const TimeLimit& limit : kTimeLimits) {
    std::vector<double> ratios;
    for (const TableRow& row : rows) {
      if (row.cell.group != "mean" || row.cell.method.name != kOurs) continue;
      if (row.cell.capture.garment != limit.garment) continue;
      const auto ratio = colmap.Over(row.record);
      if (ratio) ratios.push_back(*ratio);
    }
    const auto mean = Mean(ratios);
    if (!mean) continue;
    limits.AtMost(std::string(limit.garment) + ": mean time over colmap's", *mean, limit.of_colmap);
  }
}

}  // namespace

void JudgeRows(const std::vector<TableRow>& rows, Limits& limits) {
  JudgeMean(rows, limits);
  JudgeCertainty(rows, limits);
  JudgeUnique(rows, limits);
  JudgeMeanness(rows, limits);
  JudgeSigmas(rows, limits);
  JudgeTimes(rows, limits);
  JudgeStress(rows, limits);
  JudgePhotographs(rows, limits);
}

}  // namespace rotunda::bench
