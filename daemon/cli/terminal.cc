#include "daemon/cli/terminal.h"

#include <pthread.h>
#include <signal.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>

namespace rotunda::cli {
namespace {

constexpr char kInterruptedWord[] = "interrupted";
constexpr auto kDrawInterval = std::chrono::milliseconds(100);

sigset_t InterruptSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  return signals;
}

/// Sets the kernel's high-water mark of this process's memory back to what is used now.
void ResetPeakMemory() { std::ofstream("/proc/self/clear_refs") << "5"; }

double PeakMemory_mb() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with("VmHWM:")) return std::stod(line.substr(6)) / 1024.0;
  }
  return 0;
}

std::string Duration(double seconds) {
  const auto whole = static_cast<long>(seconds + 0.5);
  return whole < 90 ? std::to_string(whole) + " s" : std::to_string((whole + 30) / 60) + " min";
}

}  // namespace

ProgressLine::ProgressLine(bool show) : show_(show && isatty(STDERR_FILENO)) {}

ProgressLine::~ProgressLine() { Finish(); }

void ProgressLine::Update(std::string_view stage, size_t done, size_t total) {
  std::lock_guard lock(mutex_);
  if (stage != stage_) {
    EndStage();
    stage_ = stage;
    stage_begin_ = Clock::now();
    ResetPeakMemory();
  } else if (Clock::now() - last_drawn_ < kDrawInterval) {
    return;
  }
  Draw(done, total);
}

std::vector<StageCost> ProgressLine::Finish() {
  std::lock_guard lock(mutex_);
  EndStage();
  if (show_) std::fputs("\r\033[K", stderr);
  return costs_;
}

void ProgressLine::Tell(const std::string& text) {
  std::lock_guard lock(mutex_);
  std::fprintf(stderr, "%srotunda: %s\n", show_ ? "\r\033[K" : "", text.c_str());
}

void ProgressLine::EndStage() {
  if (stage_.empty()) return;
  const std::chrono::duration<double> spent = Clock::now() - stage_begin_;
  costs_.push_back({stage_, spent.count(), PeakMemory_mb()});
  stage_.clear();
}

void ProgressLine::Draw(size_t done, size_t total) {
  last_drawn_ = Clock::now();
  if (!show_) return;
  const std::chrono::duration<double> spent = last_drawn_ - stage_begin_;
  std::string line = stage_;
  if (total > 1) line += " " + std::to_string(done) + "/" + std::to_string(total);
  if (done > 0 && done < total) {
    const double rate = static_cast<double>(done) / spent.count();
    line += ", about " + Duration(static_cast<double>(total - done) / rate) + " left";
  }
  std::fprintf(stderr, "\r\033[K%s", line.c_str());
}

InterruptWatch::InterruptWatch() {
  const sigset_t signals = InterruptSignals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  watcher_ = std::jthread([this](std::stop_token quit) {
    const sigset_t waited_for = InterruptSignals();
    const timespec patience{0, 100'000'000};
    while (!quit.stop_requested()) {
      if (sigtimedwait(&waited_for, nullptr, &patience) > 0) stop_.request_stop();
    }
  });
}

InterruptWatch::~InterruptWatch() = default;

Error Interrupted(const std::string& text) {
  return {ErrorCode::kCancelled, kInterruptedWord + text, ""};
}

int Fail(const Error& error) {
  const bool interrupted = error.code == ErrorCode::kCancelled;
  const bool has_more = error.message.starts_with(kInterruptedWord);
  const std::string reason = interrupted && !has_more ? kInterruptedWord : error.ToString();
  std::fprintf(stderr, "rotunda: %s\n", reason.c_str());
  return interrupted ? kInterrupted : kFailed;
}

}  // namespace rotunda::cli
