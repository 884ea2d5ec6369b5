#pragma once

#include <cstddef>
#include <numeric>
#include <utility>
#include <vector>

namespace rotunda::sfm {

/// Union-find with path halving; the smaller set's root is hung below the larger's (ties: the
/// smaller root stays), so that roots depend on the order of unions alone.
class DisjointSets {
 public:
  explicit DisjointSets(size_t count) : parent_(count), size_(count, 1) {
    std::iota(parent_.begin(), parent_.end(), size_t{0});
  }

  size_t Find(size_t item) {
    while (parent_[item] != item) item = parent_[item] = parent_[parent_[item]];
    return item;
  }

  /// False when both are in one set already.
  bool Unite(size_t a, size_t b) {
    a = Find(a);
    b = Find(b);
    if (a == b) return false;
    if (size_[a] < size_[b] || (size_[a] == size_[b] && b < a)) std::swap(a, b);
    parent_[b] = a;
    size_[a] += size_[b];
    return true;
  }

 private:
  std::vector<size_t> parent_;
  std::vector<size_t> size_;
};

}  // namespace rotunda::sfm
