#include "tests/support/background_process.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

#include "tests/support/process.h"

namespace rotunda::test {
namespace {

constexpr int kFirstListenFd = 3;  // SD_LISTEN_FDS_START

[[noreturn]] void Become(const BackgroundProcess::Options& options) {
  const int out = open(options.output.c_str(), O_CREAT | O_WRONLY | O_APPEND, 0600);
  dup2(out, STDOUT_FILENO);
  dup2(out, STDERR_FILENO);
  if (options.listening_fd) {
    dup2(*options.listening_fd, kFirstListenFd);
    fcntl(kFirstListenFd, F_SETFD, 0);  // also when it was 3 already
    setenv("LISTEN_FDS", "1", 1);
    setenv("LISTEN_PID", std::to_string(getpid()).c_str(), 1);
  }
  for (const auto& [name, value] : options.environment) setenv(name.c_str(), value.c_str(), 1);
  std::vector<char*> argv;
  for (const std::string& argument : options.arguments) {
    argv.push_back(const_cast<char*>(argument.c_str()));
  }
  argv.push_back(nullptr);
  execvp(argv[0], argv.data());
  _exit(127);
}

sockaddr_un AddressOf(const std::filesystem::path& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, path.c_str(), sizeof(address.sun_path) - 1);
  return address;
}

int BoundSocket(const std::filesystem::path& path, int type) {
  const sockaddr_un address = AddressOf(path);
  const int fd = socket(AF_UNIX, type | SOCK_CLOEXEC, 0);
  if (bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    close(fd);
    throw std::runtime_error(path.string() + ": " + std::strerror(errno));
  }
  return fd;
}

}  // namespace

BackgroundProcess::BackgroundProcess(const Options& options) : output_(options.output) {
  pid_ = fork();
  if (pid_ < 0) throw std::runtime_error("fork failed");
  if (pid_ == 0) Become(options);
}

BackgroundProcess::~BackgroundProcess() {
  if (Running()) Signal(SIGKILL);
  Wait();
}

void BackgroundProcess::Note(int status) {
  exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

bool BackgroundProcess::Running() {
  int status = 0;
  if (!exit_code_ && waitpid(pid_, &status, WNOHANG) == pid_) Note(status);
  return !exit_code_;
}

void BackgroundProcess::Signal(int signal) {
  if (!exit_code_) kill(pid_, signal);
}

int BackgroundProcess::Wait() {
  int status = 0;
  if (!exit_code_ && waitpid(pid_, &status, 0) == pid_) Note(status);
  return exit_code_.value_or(-1);
}

std::string BackgroundProcess::Output() const { return TextOf(output_); }

NotifySocket::NotifySocket(const std::filesystem::path& path)
    : fd_(BoundSocket(path, SOCK_DGRAM)) {}

NotifySocket::~NotifySocket() { close(fd_); }

std::optional<std::string> NotifySocket::Next(int patience_ms) {
  pollfd ready{fd_, POLLIN, 0};
  if (poll(&ready, 1, patience_ms) <= 0) return std::nullopt;
  char message[4096];
  const ssize_t got = recv(fd_, message, sizeof(message), 0);
  return got < 0 ? std::nullopt : std::optional(std::string(message, static_cast<size_t>(got)));
}

bool NotifySocket::WaitFor(const std::string& line, std::chrono::milliseconds patience) {
  const auto deadline = std::chrono::steady_clock::now() + patience;
  while (true) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
        deadline - std::chrono::steady_clock::now());
    if (left.count() <= 0) return false;
    const auto message = Next(static_cast<int>(left.count()));
    if (!message) return false;
    if (("\n" + *message + "\n").find("\n" + line + "\n") != std::string::npos) return true;
  }
}

std::vector<std::string> NotifySocket::Messages() {
  std::vector<std::string> messages;
  while (auto message = Next(0)) messages.push_back(*std::move(message));
  return messages;
}

int ListenAsSystemd(const std::filesystem::path& path) {
  const int fd = BoundSocket(path, SOCK_STREAM);
  listen(fd, 64);
  return fd;
}

}  // namespace rotunda::test
