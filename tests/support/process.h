#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace rotunda::test {

/// A finished program.
struct ProcessOutcome {
  int exit_code = -1;  // 128 + signal when it was ended by one
  std::string output;  // standard output
  std::string errors;  // standard error
  double seconds = 0;
  double peak_memory_mb = 0;
};

/// Runs `arguments` (the program first, found on PATH) and waits. As soon as `interrupt_when` says
/// true, SIGINT is sent.
ProcessOutcome RunProcess(const std::vector<std::string>& arguments,
                          const std::function<bool()>& interrupt_when = nullptr);

bool Contains(const std::string& text, const std::string& part);
/// Empty when it cannot be read.
std::string TextOf(const std::filesystem::path& file);

/// A folder under the system's temporary folder that is removed in the end.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

}  // namespace rotunda::test
