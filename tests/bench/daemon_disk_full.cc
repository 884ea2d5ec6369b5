#include "tests/bench/daemon_disk_full.h"

#include <fcntl.h>
#include <sys/mount.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <system_error>
#include <utility>

#include "daemon/capture_job.h"
#include "tests/bench/daemon_checks.h"

namespace rotunda::bench {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

constexpr int kDisk_mb = 600;
// About what one capture of 12 small pictures writes: the disk is full before, in or after it.
constexpr int64_t kMostLeft_bytes = 5'000'000;
constexpr auto kPatience = milliseconds(120000);
constexpr int kEnoughToMeetShots = 10;  // rounds
// What the system and SQLite say of a full disk.
constexpr const char* kReasons[] = {"No space left on device", "database or disk is full",
                                    "disk I/O error"};

/// A memory disk at `place`, filled up by one file.
class SmallDisk {
 public:
  explicit SmallDisk(fs::path place) : place_(std::move(place)) {
    fs::create_directories(place_);
    const std::string size = "size=" + std::to_string(kDisk_mb) + "m";
    if (mount("rotunda-test", place_.c_str(), "tmpfs", MS_NOSUID | MS_NODEV, size.c_str()) != 0) {
      problem_ = std::generic_category().message(errno);
    }
  }
  ~SmallDisk() {
    if (!problem_) umount2(place_.c_str(), MNT_DETACH);
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;

  const std::optional<std::string>& problem() const { return problem_; }

  void LeaveFree(int64_t bytes) {
    struct statvfs disk = {};
    Require(statvfs(place_.c_str(), &disk) == 0, "statvfs");
    const int64_t free_bytes = static_cast<int64_t>(disk.f_bavail * disk.f_frsize);
    const int file = open(Ballast().c_str(), O_CREAT | O_WRONLY | O_CLOEXEC, 0600);
    Require(file >= 0, "the disk cannot be filled");
    const int failed = free_bytes > bytes ? posix_fallocate(file, 0, free_bytes - bytes) : 0;
    close(file);
    Require(failed == 0 || failed == ENOSPC, "the disk cannot be filled");
  }
  void MakeRoom() { fs::remove(Ballast()); }

 private:
  fs::path Ballast() const { return place_ / "ballast"; }
  const fs::path place_;
  std::optional<std::string> problem_;
};

/// What is done with the daemon while its disk is full.
enum class Turn { kGoOn, kKill, kKillAndStart };

class FullDisk {
 public:
  FullDisk(const test::SimulatedDaemon& daemon, size_t cameras, SmallDisk& disk, unsigned seed)
      : daemon_(daemon),
        cameras_(cameras),
        disk_(disk),
        client_(daemon),
        inspector_(daemon.State(), {std::begin(kReasons), std::end(kReasons)}),
        random_(seed) {}

  void Warm() {
    Begin();
    // The first captures are of the target: calibrations need them.
    Require(test::WaitUntil(kPatience,
                            [&] {
                              client_.Run(milliseconds(500), true);
                              return client_.acknowledged.size() >= kTargetShots;
                            }),
            "no captures:\n" + daemon_.Log());
    End();
  }

  void Round(Turn turn) {
    Begin();
    std::uniform_int_distribution<int64_t> left_bytes(0, kMostLeft_bytes);
    std::uniform_int_distribution<int> work_ms(500, 4000);
    // Cameras take seconds until they are ready, and shots are what shall meet the full disk.
    Require(daemon_.WaitForCameras(cameras_, kPatience), "no cameras:\n" + daemon_.Log());
    disk_.LeaveFree(left_bytes(random_));
    client_.Run(milliseconds(work_ms(random_)), true);
    Require(process_->Running(), "the daemon ended by itself:\n" + daemon_.Log());
    const nlohmann::json status = daemon_.Get("/v1/status");
    Require(status.is_object(), "it does not answer:\n" + daemon_.Log());
    shots_in_memory_ += status["problems"].dump().find(daemon::kShotWaits) != std::string::npos;
    if (turn != Turn::kGoOn) Kill();
    if (turn == Turn::kKillAndStart) StartOnFullDisk();
    disk_.MakeRoom();
    if (turn == Turn::kGoOn) End();
    inspector_.Look(client_.acknowledged, false);
  }

  void Finish() {
    Begin();
    End();
    inspector_.Look(client_.acknowledged, true);
    for (const auto& [state, count] : inspector_.findings().jobs) {
      Require(state == "done" || state == "failed", CountsText(inspector_.findings().jobs));
    }
  }

  const StateInspector::Findings& findings() const { return inspector_.findings(); }
  size_t acknowledged() const { return client_.acknowledged.size(); }
  int refused_starts() const { return refused_starts_; }
  int shots_in_memory() const { return shots_in_memory_; }

 private:
  void Begin() {
    process_ = daemon_.Start();
    Require(test::WaitUntil(
                kPatience,
                [&] { return daemon_.Get("/v1/status").is_object() || !process_->Running(); }) &&
                process_->Running(),
            "the daemon does not start:\n" + daemon_.Log());
  }
  /// There is room: all that was begun comes to its end.
  void End() {
    Require(client_.Run(kPatience, false), "jobs do not end:\n" + daemon_.Log());
    process_->Signal(SIGTERM);
    Require(process_->Wait() == 0, "the daemon did not stop well:\n" + daemon_.Log());
  }
  void Kill() {
    process_->Signal(SIGKILL);
    Require(process_->Wait() == 128 + SIGKILL, "the daemon ended by itself:\n" + daemon_.Log());
    daemon_.SendToCameras({"fault", "all", "reboot", "100"});  // they wait for the dead one
  }
  /// It serves, or it ends with 1 and says why.
  void StartOnFullDisk() {
    process_ = daemon_.Start();
    const auto decided = [&] {
      return !process_->Running() || daemon_.Get("/v1/status").is_object();
    };
    Require(test::WaitUntil(kPatience, decided),
            "on a full disk it neither serves nor ends:\n" + daemon_.Log());
    if (process_->Running()) return Kill();
    ++refused_starts_;
    Require(process_->Wait() == 1, "it did not end with 1 on a full disk:\n" + daemon_.Log());
  }

  const test::SimulatedDaemon& daemon_;
  const size_t cameras_;
  SmallDisk& disk_;
  DaemonClient client_;
  StateInspector inspector_;
  std::mt19937 random_;
  std::unique_ptr<test::BackgroundProcess> process_;
  int refused_starts_ = 0;
  int shots_in_memory_ = 0;
};

}  // namespace

void MeasureFullDisk(const test::SimulatedDaemon::Options& given, int rounds, unsigned seed) {
  test::SimulatedDaemon::Options options = given;
  options.more_config = "[storage]\nreserve_mb = 0\n";  // nothing is refused in time
  const test::SimulatedDaemon daemon(options);
  SmallDisk disk(daemon.State());
  Require(!disk.problem(), "no disk can be mounted to be filled (--full-disks 0 leaves it out): " +
                               disk.problem().value_or(""));
  const auto set = ReadFrameSet(options.frame_sets.front());
  Require(set.ok(), "no frame set");
  FullDisk full(daemon, set->frames.size(), disk, seed);
  full.Warm();
  constexpr Turn kTurns[] = {Turn::kGoOn, Turn::kKill, Turn::kKillAndStart};
  for (int round = 0; round < rounds; ++round) {
    full.Round(kTurns[static_cast<size_t>(round) % std::size(kTurns)]);
    std::printf("disk full %d: %zu captures, %zu of them acknowledged\n", round + 1,
                full.findings().captures, full.acknowledged());
    std::fflush(stdout);
  }
  full.Finish();
  std::printf(
      "%d times a full disk, %d times with a shot that waited in memory: all %zu captures are "
      "whole "
      "(%zu acknowledged), jobs: %s; %d starts on a full disk were refused with a reason\n",
      rounds, full.shots_in_memory(), full.findings().captures, full.acknowledged(),
      CountsText(full.findings().jobs).c_str(), full.refused_starts());
  for (const auto& [reason, count] : full.findings().failures) {
    std::printf("  %zu x %s\n", count, reason.c_str());
  }
  Require(rounds < kEnoughToMeetShots || full.shots_in_memory() > 0,
          "no shot met a full disk: the measurement says nothing");
}

}  // namespace rotunda::bench
