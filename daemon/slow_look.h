#pragma once

#include <chrono>
#include <functional>
#include <mutex>
#include <optional>
#include <utility>

namespace rotunda::daemon {

/// What is found by a look that may hang, at a share that does not answer for one. One thread looks
/// at a time and nobody waits for it, so that what hangs holds up one alone.
template <typename Seen>
class SlowLook {
 public:
  /// `first`: what was seen before any look. A look that takes `patience` hangs.
  explicit SlowLook(Seen first, std::chrono::milliseconds patience = std::chrono::seconds(2))
      : patience_(patience), seen_(std::move(first)) {}

  /// What `look`, which is given what was seen last, finds; what was seen last while another thread
  /// looks; nullopt when that one hangs.
  std::optional<Seen> Look(const std::function<Seen(const Seen& last)>& look) {
    if (const std::unique_lock only(looking_, std::try_to_lock); only) {
      SetBegun();
      Seen seen = look(seen_);  // nobody else changes it
      const std::lock_guard lock(mutex_);
      seen_ = std::move(seen);
      begun_.reset();
      return seen_;
    }
    const std::lock_guard lock(mutex_);
    if (begun_ && Clock::now() - *begun_ >= patience_) return std::nullopt;
    return seen_;
  }

 private:
  using Clock = std::chrono::steady_clock;

  void SetBegun() {
    const std::lock_guard lock(mutex_);
    begun_ = Clock::now();
  }

  const std::chrono::milliseconds patience_;
  std::mutex looking_;
  std::mutex mutex_;                        // of what follows
  std::optional<Clock::time_point> begun_;  // nullopt: nobody looks
  Seen seen_;
};

}  // namespace rotunda::daemon
