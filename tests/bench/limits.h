#pragma once

#include <cstdio>
#include <string>

namespace rotunda::bench {

/// Counts what is not as it must be, naming each.
class Limits {
 public:
  void AtMost(const std::string& what, double value, double limit) {
    Check(value <= limit, what, value, limit);
  }
  void AtLeast(const std::string& what, double value, double limit) {
    Check(value >= limit, what, value, limit);
  }
  void Must(const std::string& what, bool holds) {
    if (holds) return;
    ++broken_;
    std::printf("NOT AS IT MUST BE  %s\n", what.c_str());
  }
  int broken() const { return broken_; }

 private:
  void Check(bool kept, const std::string& what, double value, double limit) {
    if (kept) return;
    ++broken_;
    std::printf("LIMIT BROKEN  %s: %.4g, limit %.4g\n", what.c_str(), value, limit);
  }
  int broken_ = 0;
};

}  // namespace rotunda::bench
