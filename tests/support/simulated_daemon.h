#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "sfm/core/frame_set.h"
#include "tests/support/background_process.h"
#include "tests/support/process.h"

namespace rotunda::test {

/// Whether `condition` came true within `patience`; looks every 50 ms.
bool WaitUntil(std::chrono::milliseconds patience, const std::function<bool()>& condition);

/// capture.toml for cameras that `rotunda simulate --serve` shows `set` with, at `block`.1, .2, ...
std::string CaptureToml(const FrameSet& set, const std::string& block);

/// Simulated cameras in a process of their own, and the configuration of a real daemon that uses
/// them, in a temporary folder. Throws std::runtime_error when something does not start.
class SimulatedDaemon {
 public:
  struct Options {
    std::string command;                            // the program `rotunda`
    std::string daemon;                             // the program `rotundad`
    std::filesystem::path board;                    // a board file
    std::vector<std::filesystem::path> frame_sets;  // what the cameras see, one a pulse
    std::string block;                              // "127.63.1"
    bool hold = false;             // what they see is told by SendToCameras({"shot", NUMBER}) alone
    std::string more_config = {};  // goes behind the rest of rotundad.toml
  };
  /// Returns when the cameras are there.
  explicit SimulatedDaemon(Options options);

  std::filesystem::path State() const { return folder_ / "state"; }
  std::filesystem::path Socket() const { return folder_ / "api.sock"; }

  /// Starts the daemon, with `environment` besides the test's own; does not wait for it.
  std::unique_ptr<BackgroundProcess> Start(
      const std::map<std::string, std::string>& environment = {}) const;
  std::string Log() const;  // of all daemons that were started
  /// `rotunda simulate --send WORDS`.
  void SendToCameras(std::vector<std::string> words) const;

  /// The answer's JSON; null when nobody answers, or with a status of 500 and above.
  nlohmann::json Ask(const std::string& method, const std::string& target,
                     const std::string& body = "") const;
  nlohmann::json Get(const std::string& target) const { return Ask("GET", target); }
  /// All items of a list, over all its pages; nullopt when a page did not come.
  std::optional<std::vector<nlohmann::json>> All(const std::string& target) const;
  /// Whether all `cameras` became ready.
  bool WaitForCameras(size_t cameras, std::chrono::milliseconds patience) const;
  /// The job when it has ended; throws when it does not within `patience`.
  nlohmann::json Ended(const nlohmann::json& job, std::chrono::milliseconds patience) const;

 private:
  const Options options_;
  TemporaryFolder folder_;
  std::unique_ptr<BackgroundProcess> cameras_;
};

}  // namespace rotunda::test
