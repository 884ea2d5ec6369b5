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
  std::string group;  // "mean", "full-size", "stress", "ablation", "photographs"
  Capture capture;
  Method method;
};

/// Which groups of cells are wanted.
struct Groups {
  bool mean = false;
  bool full_size = false;
  bool stress = false;
  bool ablation = false;
  bool photographs = false;
};

/// All cells of the groups in the order in which they are run: capture by capture.
std::vector<Cell> PlanCells(const Groups& groups, const CaptureSize& size);

}  // namespace rotunda::bench
