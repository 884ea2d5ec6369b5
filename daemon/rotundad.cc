#include <spdlog/logger.h>
#include <sys/stat.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "config/daemon_config.h"
#include "daemon/service.h"
#include "daemon/service_folders.h"
#include "daemon/service_groups.h"
#include "daemon/service_log.h"
#include "daemon/store.h"
#include "daemon/systemd_notify.h"

namespace rotunda::daemon {
namespace {

using std::chrono::microseconds;

constexpr int kDone = 0;
constexpr int kFailed = 1;
constexpr int kWrongUsage = 2;
// How often the daemon looks after itself when no watchdog asks for more.
constexpr auto kTick = microseconds(1000000);
// Of the watchdog's interval: two late ticks in a row are forgiven.
constexpr int kTicksPerInterval = 3;

struct Arguments {
  std::string config = "/etc/rotunda/rotundad.toml";
  bool check_only = false;
  std::optional<std::string> backup;
};

void PrintProblems(const config::CheckedDaemonConfig& checked) {
  for (const Error& problem : checked.problems) {
    std::fprintf(stderr, "%s\n", problem.ToString().c_str());
  }
}

/// The signals that main() alone waits for; blocked before any thread is made.
sigset_t BlockSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  for (const int signal : {SIGTERM, SIGINT, SIGHUP}) sigaddset(&signals, signal);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::signal(SIGPIPE, SIG_IGN);  // a client that goes is an error of its connection
  return signals;
}

void Reload(Service& service, const Arguments& arguments, spdlog::logger& log) {
  NotifyReloading();
  const config::CheckedDaemonConfig checked = config::CheckDaemonConfig(arguments.config);
  for (const Error& problem : checked.problems) log.error("{}", problem.ToString());
  if (checked.problems.empty()) {
    service.Reload(checked.config);
    log.info("configuration reloaded");
  } else {
    service.RefuseReload(checked.problems.front().ToString());
  }
  NotifyReady(service.Summary());
}

/// Tells systemd how the service is, when that has changed.
class StatusLine {
 public:
  explicit StatusLine(std::string told) : told_(std::move(told)) {}
  void Tell(std::string status) {
    if (status != told_) NotifyStatus(status);
    told_ = std::move(status);
  }

 private:
  std::string told_;
};

/// Until SIGTERM or SIGINT. The watchdog is fed only while everything is alive. `ready`: what
/// systemd was told at the start.
void Run(Service& service, const std::string& ready, const Arguments& arguments,
         const sigset_t& signals, spdlog::logger& log) {
  const auto watchdog = WatchdogInterval();
  const microseconds tick = watchdog ? std::min(kTick, *watchdog / kTicksPerInterval) : kTick;
  const timespec wait{static_cast<time_t>(tick.count() / 1000000),
                      static_cast<long>(tick.count() % 1000000 * 1000)};
  StatusLine status(ready);
  bool told = false;
  while (true) {
    const int signal = sigtimedwait(&signals, nullptr, &wait);
    if (signal == SIGTERM || signal == SIGINT) return;
    if (signal == SIGHUP) Reload(service, arguments, log);
    const auto hung = service.Hung();
    if (!hung) NotifyAlive();
    if (hung && !told) log.critical("{}; the watchdog is not fed any more", *hung);
    told = hung.has_value();
    status.Tell(service.Summary());
  }
}

/// Ends the process when its orderly end takes longer than `patience`. A thread that waits for a
/// disk that does not answer cannot be ended otherwise, and nothing is lost that a crash would not
/// lose: what was acknowledged is on the disk, and the next start marks jobs under way interrupted.
class LatestEnd {
 public:
  LatestEnd(std::chrono::milliseconds patience, spdlog::logger& log)
      : thread_([patience, &log](std::stop_token ended) {
          std::mutex mutex;
          std::condition_variable_any wake;
          std::unique_lock lock(mutex);
          wake.wait_for(lock, ended, patience, [] { return false; });
          if (ended.stop_requested()) return;
          log.critical(
              "not at the end after {} ms (service.end_ms): something does not answer, a disk or a "
              "share; ended all the same, jobs under way are interrupted",
              patience.count());
          log.flush();
          std::_Exit(kFailed);
        }) {}

 private:
  std::jthread thread_;
};

int Serve(const Arguments& arguments, const config::DaemonConfig& config) {
  ::umask(0077);  // pictures and subjects' names are the daemon's alone, however it is started
  const sigset_t signals = BlockSignals();
  const std::unique_ptr<spdlog::logger> log = MakeLog(config.service.log_level);
  const auto fail = [&log](const Error& error) {
    log->critical("{}", error.ToString());
    return kFailed;
  };
  const auto inherited = InheritedSocket();
  if (!inherited) return fail(inherited.error());
  log->info("rotundad {} starts", ROTUNDA_VERSION);
  auto service =
      Service::Start({config, ROTUNDA_VERSION, *inherited,
                      [] { return std::chrono::system_clock::now(); }, NotifyStillStarting},
                     *log);
  if (!service) return fail(service.error());
  log->info("ready on {}", *inherited ? "the socket of systemd" : config.service.socket);
  const std::string ready = (*service)->Summary();
  NotifyReady(ready);
  Run(**service, ready, arguments, signals, *log);
  const std::chrono::milliseconds longest_end(config.service.end_ms);
  NotifyStopping(longest_end);
  log->info("stopping");
  const LatestEnd latest_end(longest_end, *log);
  *service = nullptr;
  log->info("stopped");
  return kDone;
}

int BackUp(const std::string& file, const config::DaemonConfig& config) {
  if (Status copied = BackUpStore(config.service.state_folder, file); !copied) {
    std::fprintf(stderr, "rotundad: %s\n", copied.error().ToString().c_str());
    return kFailed;
  }
  return kDone;
}

/// Of a configuration that nothing is wrong with.
int Warn(const std::string& file, const config::CheckedDaemonConfig& checked) {
  const auto warn = [](const std::string& text) {
    std::fprintf(stderr, "warning: %s\n", text.c_str());
  };
  for (const std::string& missing : MissingGroups(checked.config.access)) warn(missing);
  for (const Error& doubt : FolderDoubts(checked.config.service)) {
    warn(checked.Located(doubt).ToString());
  }
  std::printf("%s: nothing is wrong\n", file.c_str());
  return kDone;
}

int Main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app(
      "The Rotunda daemon: holds the rig's cameras, takes captures, calibrates, reconstructs, and "
      "serves its API on a UNIX socket.",
      "rotundad");
  app.set_version_flag("--version", ROTUNDA_VERSION);
  app.add_option("--config", arguments.config, "Configuration (config/rotundad.toml shows it)")
      ->type_name("FILE")
      ->capture_default_str();
  CLI::Option* check = app.add_flag(
      "--check-config", arguments.check_only,
      "Print everything that is wrong with the configuration and the files it names, a "
      "line each, and exit: 0 nothing, 1 something. A group that there is not is a warning, and so "
      "is a folder of the state or the socket that is not there or that you cannot see or write "
      "(run it as the daemon's user), unless systemd makes it");
  app.add_option(
         "--backup", arguments.backup,
         "Write a copy of the database to FILE, which must not exist and only its owner may "
         "read, and exit; also while a daemon runs. Pictures and results are files: copy them with "
         "what keeps their times (cp -a)")
      ->type_name("FILE")
      ->excludes(check);
  app.footer(
      "Example:\n  rotundad --config /etc/rotunda/rotundad.toml --check-config\n\nSIGHUP reloads "
      "the configuration, SIGTERM ends the daemon, within service.end_ms whatever hangs.");
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& help) {
    return app.exit(help);
  } catch (const CLI::ParseError& wrong) {
    std::fprintf(stderr, "rotundad: %s (see --help)\n", wrong.what());
    return kWrongUsage;
  }
  const config::CheckedDaemonConfig checked = config::CheckDaemonConfig(arguments.config);
  PrintProblems(checked);
  if (!checked.problems.empty()) return kFailed;
  if (arguments.check_only) return Warn(arguments.config, checked);
  if (arguments.backup) return BackUp(*arguments.backup, checked.config);
  return Serve(arguments, checked.config);
}

}  // namespace
}  // namespace rotunda::daemon

int main(int argc, char** argv) { return rotunda::daemon::Main(argc, argv); }
