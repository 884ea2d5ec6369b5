#pragma once

#include <gtest/gtest.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <thread>

namespace rotunda::test {

/// Calls `act` in a thread of its own, as a user who is nobody when this process is root's; as its
/// own user otherwise, who owns what it makes.
template <typename Act>
void AsNobody(const Act& act) {
  constexpr int kNobody = 65534;
  std::jthread([&] {
    if (::geteuid() == 0) {
      // These, without libc, are of the calling thread alone.
      EXPECT_EQ(syscall(SYS_setresgid, -1, kNobody, -1), 0);
      EXPECT_EQ(syscall(SYS_setresuid, -1, kNobody, -1), 0);
    }
    act();
  }).join();
}

}  // namespace rotunda::test
