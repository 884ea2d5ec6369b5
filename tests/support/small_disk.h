#pragma once

#include <sys/mount.h>

#include <cstdint>
#include <filesystem>
#include <string>

#include "tests/support/process.h"

namespace rotunda::test {

/// A file system of its own, small; only root may mount one.
class SmallDisk {
 public:
  explicit SmallDisk(uint64_t size_bytes) {
    const std::string options = "size=" + std::to_string(size_bytes);
    mounted_ = ::mount("tmpfs", folder_.path().c_str(), "tmpfs", 0, options.c_str()) == 0;
  }
  ~SmallDisk() {
    if (mounted_) ::umount2(folder_.path().c_str(), MNT_DETACH);
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  bool mounted() const { return mounted_; }
  const std::filesystem::path& path() const { return folder_.path(); }

 private:
  TemporaryFolder folder_;
  bool mounted_ = false;
};

}  // namespace rotunda::test
