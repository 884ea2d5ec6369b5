#include "tests/fuzz/fuzz_input.h"

#include <unistd.h>

namespace rotunda::fuzz {

InputFile::InputFile(const uint8_t* data, size_t size) {
  std::string name = std::filesystem::temp_directory_path() / "rotunda-fuzz-XXXXXX";
  const int fd = mkstemp(name.data());
  Require(fd >= 0 && write(fd, data, size) == static_cast<ssize_t>(size) && close(fd) == 0,
          "the temporary folder takes a file");
  path_ = name;
}

InputFile::~InputFile() { std::filesystem::remove(path_); }

}  // namespace rotunda::fuzz
