#include "tests/support/process.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <thread>

namespace rotunda::test {
namespace {

constexpr auto kPollInterval = std::chrono::milliseconds(2);

[[noreturn]] void Become(const std::vector<std::string>& arguments, const char* out,
                         const char* err) {
  dup2(open(out, O_CREAT | O_WRONLY | O_TRUNC, 0600), STDOUT_FILENO);
  dup2(open(err, O_CREAT | O_WRONLY | O_TRUNC, 0600), STDERR_FILENO);
  std::vector<char*> argv;
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  execvp(argv[0], argv.data());
  _exit(127);
}

}  // namespace

ProcessOutcome RunProcess(const std::vector<std::string>& arguments,
                          const std::function<bool()>& interrupt_when) {
  const TemporaryFolder streams;
  const std::string out = (streams / "out").string(), err = (streams / "err").string();
  const auto begin = std::chrono::steady_clock::now();
  const pid_t child = fork();
  if (child < 0) throw std::runtime_error("fork failed");
  if (child == 0) Become(arguments, out.c_str(), err.c_str());
  int status = 0;
  rusage usage{};
  if (interrupt_when) {
    bool ended = false;
    while (!(ended = wait4(child, &status, WNOHANG, &usage) == child) && !interrupt_when()) {
      std::this_thread::sleep_for(kPollInterval);
    }
    if (!ended) kill(child, SIGINT);
    if (!ended) wait4(child, &status, 0, &usage);
  } else {
    wait4(child, &status, 0, &usage);
  }
  const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - begin;
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), TextOf(out),
          TextOf(err), spent.count(), static_cast<double>(usage.ru_maxrss) / 1024.0};
}

bool Contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

std::string TextOf(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file, std::ios::binary).rdbuf();
  return text.str();
}

TemporaryFolder::TemporaryFolder() {
  std::string pattern = (std::filesystem::temp_directory_path() / "rotunda-test-XXXXXX").string();
  if (mkdtemp(pattern.data()) == nullptr) throw std::runtime_error("mkdtemp failed: " + pattern);
  path_ = pattern;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

}  // namespace rotunda::test
