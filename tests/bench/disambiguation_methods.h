#pragma once

#include <string>
#include <vector>

#include "tests/bench/disambiguation_captures.h"

namespace rotunda::bench {

struct Method {
  std::string name;
  std::vector<std::string> options;  // of `rotunda reconstruct`, from the two-view geometries on
  /// Options before that; empty: it starts from the stages that the methods share.
  std::vector<std::string> front_end = {};
  bool is_colmap = false;  // colmap's mapper instead
};

/// One run: a method on a capture.
struct Cell {
  std::string group;  // "mean", "full-size", "held-out", "stress", "ablation", "photographs"
  Capture capture;
  Method method;
};

/// Which groups of cells are wanted.
struct Groups {
  bool mean = false;
  bool full_size = false;
  bool held_out = false;
  bool stress = false;
  bool ablation = false;
  bool photographs = false;
};

/// All cells of the groups in the order of the table: capture by capture.
std::vector<Cell> PlanCells(const Groups& groups, const CaptureSize& size);

/// What matters most first, for long runs are cut off: tc-sfm and plain of all captures, then the
/// literal method, the ablation's others, and colmap.
void SortToRun(std::vector<Cell>& cells);

}  // namespace rotunda::bench
