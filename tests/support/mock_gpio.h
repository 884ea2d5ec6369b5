#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace rotunda::test {

/// A GPIO chip /dev/gpiochip0 of 8 lines by umockdev, for this process alone, which must run under
/// umockdev-wrapper. It answers the ioctls of libgpiod 1 and notes what is asked of it.
class MockGpio {
 public:
  struct Request {
    unsigned line = 0;
    bool output = false;
    bool active_low = false;
    std::string consumer;
    int fd = -1;
  };
  struct Edge {
    bool high = false;
    long long at_ns = 0;  // monotonic clock
  };

  MockGpio();
  ~MockGpio();
  MockGpio(const MockGpio&) = delete;
  MockGpio& operator=(const MockGpio&) = delete;

  /// True when this process runs under umockdev-wrapper.
  static bool Available();

  const std::vector<Request>& requests() const;
  const std::vector<Edge>& edges() const;
  /// From now on setting a line fails.
  void Break();
  /// The next time a line is lowered that fails.
  void BreakNextFall();
  /// While it is so, another program has all lines.
  void Occupy(bool occupied);
  /// Called at every rising edge.
  void OnRise(std::function<void()> call);
  /// True while the descriptor of the last request is open.
  bool LineIsHeld() const;

  struct Impl;

 private:
  std::unique_ptr<Impl> impl_;
};

}  // namespace rotunda::test
