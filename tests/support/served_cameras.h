#pragma once

#include <atomic>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/process.h"

namespace rotunda::test {

/// `rotunda simulate --serve` as a process of its own, until the object goes.
class ServedCameras {
 public:
  struct Options {
    std::string command;                 // the program `rotunda`
    std::filesystem::path frame_set;     // empty: they show what would be rendered
    std::string block;                   // "127.42.1"
    std::vector<std::string> more = {};  // arguments
  };
  /// Returns when the cameras are there. Throws when they did not come.
  explicit ServedCameras(Options options);
  ~ServedCameras() { End(); }
  ServedCameras(const ServedCameras&) = delete;
  ServedCameras& operator=(const ServedCameras&) = delete;

  std::string socket() const { return folder_ / "cameras.sock"; }
  /// `rotunda simulate --send WORDS`.
  ProcessOutcome Send(std::vector<std::string> words) const;
  /// As Ctrl-C would.
  const ProcessOutcome& End();

 private:
  const Options options_;
  TemporaryFolder folder_;
  std::atomic<bool> done_ = false;
  std::atomic<bool> ended_ = false;
  ProcessOutcome outcome_;
  std::thread server_;
};

}  // namespace rotunda::test
