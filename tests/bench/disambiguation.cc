// Whether look-alike sides of a person are told apart: our methods and Debian's colmap mapper on
// the same matches, capture by capture, against truth. Every cell (capture, method) leaves a JSON
// file in the work folder, so that a run goes on where an earlier one ended.

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "sfm/core/file_io.h"
#include "tests/bench/bench_process.h"
#include "tests/bench/disambiguation_cells.h"
#include "tests/bench/disambiguation_methods.h"
#include "tests/bench/disambiguation_table.h"
#include "tests/bench/disambiguation_verdict.h"

namespace rotunda::bench {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

struct Arguments {
  fs::path work;
  std::string only = ".*";
  std::vector<std::string> methods;
  Groups groups;
  CaptureSize size;
  bool force = false;
  bool report_only = false;
};

std::string Duration(double seconds) {
  const auto whole = static_cast<long>(seconds + 0.5);
  return whole < 90 ? std::to_string(whole) + " s" : std::to_string((whole + 30) / 60) + " min";
}

std::regex ReadRegex(const std::string& text) {
  try {
    return std::regex(text);
  } catch (const std::regex_error& error) {
    Die("--only " + text + ": " + error.what());
  }
}

/// The cells of this call; captures that cannot be had are named and left out.
std::vector<Cell> ChooseCells(const Arguments& arguments) {
  const std::regex only = ReadRegex(arguments.only);
  const std::set<std::string> methods(arguments.methods.begin(), arguments.methods.end());
  std::vector<Cell> chosen;
  std::set<std::string> left_out;
  std::set<std::pair<std::string, std::string>> seen;  // groups share cells
  for (const Cell& cell : PlanCells(arguments.groups, arguments.size)) {
    if (!std::regex_search(cell.capture.name, only)) continue;
    if (!methods.empty() && !methods.contains(cell.method.name)) continue;
    if (!seen.emplace(cell.capture.name, cell.method.name).second) continue;
    if (cell.capture.unavailable.empty()) {
      chosen.push_back(cell);
    } else if (left_out.insert(cell.capture.name).second) {
      std::fprintf(stderr, "left out: %s: %s\n", cell.capture.name.c_str(),
                   cell.capture.unavailable.c_str());
    }
  }
  if (chosen.empty()) Die("the sets that are asked for have no such capture or method");
  return chosen;
}

/// A cell that failed is tried again, unless its method refused the capture.
std::vector<Cell> CellsToRun(const std::vector<Cell>& chosen, const Arguments& arguments) {
  std::vector<Cell> missing;
  for (const Cell& cell : chosen) {
    const auto record = ReadCell(cell, arguments.work);
    const bool failed = record && record->contains("error") && !record->value("refused", false);
    if (arguments.force || !record || failed) missing.push_back(cell);
  }
  SortToRun(missing);
  return missing;
}

void RunCells(const std::vector<Cell>& cells, const Arguments& arguments) {
  const auto begin = Clock::now();
  const auto elapsed = [&] { return std::chrono::duration<double>(Clock::now() - begin).count(); };
  for (size_t i = 0; i < cells.size(); ++i) {
    std::string left;
    if (i > 0) {
      const double each = elapsed() / static_cast<double>(i);
      left = ", about " + Duration(each * static_cast<double>(cells.size() - i)) + " left";
    }
    std::fprintf(stderr, "cell %zu of %zu: %s, %s (%s elapsed%s)\n", i + 1, cells.size(),
                 cells[i].capture.name.c_str(), cells[i].method.name.c_str(),
                 Duration(elapsed()).c_str(), left.c_str());
    std::fprintf(stderr, "%s", RowText(RunCell(cells[i], arguments.work)).c_str());
  }
}

/// Everything that exists, whatever this call was about; 1 when it is not as it must be.
int Report(const Arguments& arguments) {
  constexpr Groups kAll = {true, true, true, true, true, true};
  std::vector<TableRow> rows;
  std::map<std::string, int> lacking;  // by group
  for (const Cell& cell : PlanCells(kAll, arguments.size)) {
    if (const auto record = ReadCell(cell, arguments.work)) {
      rows.push_back({cell, *record});
    } else {
      ++lacking[cell.group];
    }
  }
  if (rows.empty()) Die(arguments.work.string() + ": nothing has been run there");
  const std::string text = TableText(rows);
  OrDie(WriteFileAtomically(arguments.work / "table.txt", text));
  OrDie(WriteFileAtomically(arguments.work / "table.json", TableJson(rows)));
  std::printf("%s\n", text.c_str());
  Limits limits;
  JudgeRows(rows, limits);
  for (const auto& [group, cells] : lacking) {
    std::printf("not run: %d of the cells of %s\n", cells, group.c_str());
  }
  if (limits.broken() == 0) std::printf("What was run is as it must be.\n");
  return limits.broken() == 0 ? 0 : 1;
}

void AddOptions(CLI::App& app, Arguments& arguments) {
  app.add_option("--work", arguments.work, "Folder for captures, stages, results and tables")
      ->type_name("DIR")
      ->required();
  app.add_option("--only", arguments.only, "Captures whose name this regular expression finds")
      ->type_name("REGEX");
  app.add_option("--methods", arguments.methods,
                 "Of plain, literal, tc-sfm, colmap and the ablation's; default: all")
      ->delimiter(',');
  app.add_flag("--mean", arguments.groups.mean,
               "The mean set at 600x800 (the default when no set is named)");
  app.add_flag("--full-size", arguments.groups.full_size, "Four of its captures at 1200x1600");
  app.add_flag("--stress", arguments.groups.stress,
               "Keypoints thinned, cameras missing, moved, swapped");
  app.add_flag("--held-out", arguments.groups.held_out,
               "A body and seeds that the method was not developed on");
  app.add_flag("--ablation", arguments.groups.ablation,
               "The literal method plus each of our readings, ours less each");
  app.add_flag("--photographs", arguments.groups.photographs,
               "Real look-alike objects; draws the layouts");
  app.add_option("--cameras", arguments.size.cameras,
                 "Cameras of the simulated captures; another number needs another --work")
      ->capture_default_str();
  app.add_option("--scale", arguments.size.scale,
                 "Size of their pictures but for --full-size, 1 is 1200x1600; likewise")
      ->capture_default_str();
  app.add_flag("--force", arguments.force, "Run cells again that exist (from the same matches)");
  app.add_flag("--report-only", arguments.report_only, "Run nothing, print what exists");
}

int Main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app(
      "Whether look-alike sides are told apart: our methods and colmap's mapper on the same "
      "matches, against truth. Goes on where an earlier run ended; the tables go to standard "
      "output and to table.txt and table.json in the work folder. Ends with 1, naming what failed, "
      "when the results that are there are not as they must be.",
      "disambiguation");
  AddOptions(app, arguments);
  CLI11_PARSE(app, argc, argv);
  Groups& groups = arguments.groups;
  groups.mean = groups.mean || !(groups.full_size || groups.held_out || groups.stress ||
                                 groups.ablation || groups.photographs);
  // colmap's programs want a display otherwise.
  setenv("QT_QPA_PLATFORM", "offscreen", 1);
  fs::create_directories(arguments.work);
  arguments.work = fs::absolute(arguments.work);
  if (!arguments.report_only) {
    RunCells(CellsToRun(ChooseCells(arguments), arguments), arguments);
  }
  return Report(arguments);
}

}  // namespace
}  // namespace rotunda::bench

int main(int argc, char** argv) { return rotunda::bench::Main(argc, argv); }
