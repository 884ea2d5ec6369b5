#pragma once

#include <chrono>
#include <mutex>
#include <stop_token>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "sfm/core/result.h"
#include "sfm/core/run_context.h"

namespace rotunda::cli {

/// What a stage cost.
struct StageCost {
  std::string stage;
  double seconds = 0;
  double peak_memory_mb = 0;  // largest resident set of the process while the stage ran
};

/// Turns a stage's progress into one line on the terminal (stage, count, time left; nothing when
/// standard error is no terminal) and keeps the time and peak memory of every stage.
class ProgressLine {
 public:
  explicit ProgressLine(bool show);
  ~ProgressLine();
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  void Update(std::string_view stage, size_t done, size_t total);
  /// A line of its own on stderr, also where no progress is shown.
  void Tell(const std::string& text);
  /// Ends the stage that runs and wipes the line.
  std::vector<StageCost> Finish();

 private:
  using Clock = std::chrono::steady_clock;
  void EndStage();
  void Draw(size_t done, size_t total);

  const bool show_;
  std::mutex mutex_;
  std::string stage_;
  Clock::time_point stage_begin_;
  Clock::time_point last_drawn_;
  std::vector<StageCost> costs_;
};

/// Ctrl-C (SIGINT) and SIGTERM as a stop token. One object, made in main() before any other thread
/// is.
class InterruptWatch {
 public:
  InterruptWatch();
  ~InterruptWatch();
  InterruptWatch(const InterruptWatch&) = delete;
  InterruptWatch& operator=(const InterruptWatch&) = delete;
  std::stop_token token() const { return stop_.get_token(); }

 private:
  std::stop_source stop_;
  std::jthread watcher_;
};

/// Exit codes of every command.
inline constexpr int kDone = 0;
inline constexpr int kFailed = 1;
inline constexpr int kWrongUsage = 2;
inline constexpr int kInterrupted = 130;  // as shells have it for what Ctrl-C has ended

/// What Ctrl-C has left, or in what it came: `text` goes on after "interrupted".
Error Interrupted(const std::string& text);

/// Prints the reason in one line on standard error and gives kFailed, or kInterrupted for
/// kCancelled: then the reason is what Interrupted() has to say, else that word alone. Wrong usage
/// is found by the parser of the options, before any work begins.
int Fail(const Error& error);

}  // namespace rotunda::cli
