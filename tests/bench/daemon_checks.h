#pragma once

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "daemon/store.h"
#include "tests/support/simulated_daemon.h"

// What the benches that are hard on the daemon share.

namespace rotunda::bench {

/// Throws std::runtime_error with `what`.
void Require(bool fine, const std::string& what);

/// The value that a `part` of the values, 0 to 1, does not exceed; there is at least one.
double Quantile(std::vector<double> values, double part);

/// `rotunda simulate OUT WORDS`; throws when it fails.
void Render(const std::string& command, const std::filesystem::path& out,
            std::vector<std::string> words);

/// How many captures, the first ones, are of the calibration target.
inline constexpr size_t kTargetShots = 2;
/// Frame sets of kTargetShots placements of the target and of a person, in `folder`.
std::vector<std::filesystem::path> RenderScenes(const std::string& command,
                                                const std::filesystem::path& folder, int cameras);

/// Runs again what was interrupted, keeps every kind of job coming, and notes what is told to be
/// done.
class DaemonClient {
 public:
  explicit DaemonClient(const test::SimulatedDaemon& daemon) : daemon_(daemon) {}

  /// Until `patience` is over, or nothing is left to do and no `new_work` is wanted; whether the
  /// latter came. Goes on when nobody answers.
  bool Run(std::chrono::milliseconds patience, bool new_work);

  std::set<std::string> acknowledged;  // captures

 private:
  struct Open {  // queued or running
    int captures = 0, computing = 0;
  };
  /// At most; nullopt: nobody answers.
  std::optional<std::vector<nlohmann::json>> NewestJobs(size_t most) const;
  bool WantsRerun(const nlohmann::json& job, bool new_work);
  /// So that always a capture and two other jobs are open; some reconstructions are asked for with
  /// the capture.
  void Submit(const Open& open);

  const test::SimulatedDaemon& daemon_;
  int interrupted_ = 0, computed_ = 0;
  bool follow_up_wanted_ = false;  // of the next capture
};

/// Looks at a state folder as a daemon that starts does (which puts right what a crash left), and
/// throws with what is wrong. No daemon may use it meanwhile.
class StateInspector {
 public:
  /// Jobs may fail for a reason that has one of `more_reasons` in it, or one that the pictures of
  /// RenderScenes() explain; for any other Look() throws.
  explicit StateInspector(std::filesystem::path state, std::vector<std::string> more_reasons = {})
      : state_(std::move(state)), more_reasons_(std::move(more_reasons)) {}

  struct Findings {                             // of all looks
    std::map<std::string, size_t> interrupted;  // jobs, by kind
    size_t adopted = 0;                         // folders without a row
    size_t temporaries = 0;                     // half-written folders that were removed
    size_t captures = 0;                        // now
    size_t pictures = 0;                        // compared with their checksums
    size_t follow_ups = 0;                   // now: captures with the reconstruction they asked for
    std::map<std::string, size_t> jobs;      // now, by state
    std::map<std::string, size_t> failures;  // now: why jobs failed
  };
  /// The database is whole and no row lacks what it refers to; the acknowledged captures are there;
  /// the pictures of captures that were not looked at before (or of all) are what was taken; each
  /// job is done, queued, interrupted, cancelled or failed for a reason that may be; a capture that
  /// was to be reconstructed has one job for that; no temporary folder is left.
  void Look(const std::set<std::string>& acknowledged, bool all_pictures);
  const Findings& findings() const { return findings_; }

 private:
  void LookAtJobs(daemon::Store& store);
  void CheckFailure(const daemon::JobRecord& job) const;
  void LookAtDatabase() const;
  void LookAtTemporaries() const;

  const std::filesystem::path state_;
  const std::vector<std::string> more_reasons_;
  std::set<std::string> compared_;  // captures
  Findings findings_;
};

/// "3 capture, 1 calibration".
std::string CountsText(const std::map<std::string, size_t>& counts);

}  // namespace rotunda::bench
