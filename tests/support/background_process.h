#pragma once

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace rotunda::test {

/// A program that runs beside the test; killed in the end when it still runs.
class BackgroundProcess {
 public:
  struct Options {
    std::vector<std::string> arguments;              // the program first, found on PATH
    std::map<std::string, std::string> environment;  // besides the test's own
    /// Handed over as systemd does: as descriptor 3, with LISTEN_FDS and LISTEN_PID.
    std::optional<int> listening_fd = std::nullopt;
    std::filesystem::path output;  // standard output and error
  };
  explicit BackgroundProcess(const Options& options);
  ~BackgroundProcess();
  BackgroundProcess(const BackgroundProcess&) = delete;
  BackgroundProcess& operator=(const BackgroundProcess&) = delete;

  bool Running();
  void Signal(int signal);
  /// The exit code, 128 + signal when it was ended by one; waits for the end.
  int Wait();
  std::string Output() const;
  pid_t pid() const { return pid_; }

 private:
  void Note(int status);
  const std::filesystem::path output_;
  pid_t pid_ = -1;
  std::optional<int> exit_code_;
};

/// Stands in for systemd's end of sd_notify(3).
class NotifySocket {
 public:
  explicit NotifySocket(const std::filesystem::path& path);
  ~NotifySocket();
  NotifySocket(const NotifySocket&) = delete;
  NotifySocket& operator=(const NotifySocket&) = delete;

  /// Waits for a message with this line; false when none came within `patience`. Takes all messages
  /// up to it.
  bool WaitFor(const std::string& line, std::chrono::milliseconds patience);
  /// Takes what has come so far.
  std::vector<std::string> Messages();

 private:
  std::optional<std::string> Next(int patience_ms);
  int fd_ = -1;
};

/// A listening UNIX socket as a .socket unit would open it.
int ListenAsSystemd(const std::filesystem::path& path);

}  // namespace rotunda::test
