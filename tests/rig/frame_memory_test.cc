#include "rig/frame_memory.h"

#include <gtest/gtest.h>

#include <memory>
#include <stop_token>
#include <thread>

namespace rotunda::rig {
namespace {

const auto kNow = std::chrono::steady_clock::time_point();

TEST(FrameMemory, LendsNoMoreThanItHas) {
  FrameMemory memory(3, 100);
  auto two = memory.Take(2, kNow);
  ASSERT_EQ(two.size(), 2u);
  EXPECT_EQ(two[0].size(), 100u);
  EXPECT_TRUE(memory.Take(2, kNow).empty());
  const uint8_t* spare = two[1].data();
  two.pop_back();
  const auto more = memory.Take(2, kNow);
  ASSERT_EQ(more.size(), 2u);
  EXPECT_EQ(more[0].data(), spare) << "what comes back is lent again";
  EXPECT_EQ(memory.lent(), 3u);
}

TEST(FrameMemory, IsNotWaitedForWhenStopped) {
  FrameMemory memory(1, 100);
  const auto lent = memory.Take(1, kNow);
  std::stop_source stop;
  std::jthread stopping([&] { stop.request_stop(); });
  // Without the stop this would not come back.
  const auto forever = std::chrono::steady_clock::now() + std::chrono::hours(24);
  EXPECT_TRUE(memory.Take(1, forever, stop.get_token()).empty());
}

TEST(FrameMemoryDeathTest, DoesNotGoBeforeItsBlocks) {
  EXPECT_DEATH(
      {
        auto memory = std::make_unique<FrameMemory>(1, 100);
        const auto block = memory->Take(1, kNow);
        memory.reset();
      },
      "");
}

TEST(FrameMemory, GrowsWhenALargerCameraComes) {
  FrameMemory memory(2, 100);
  auto early = memory.Take(1, kNow);
  memory.Grow(400);
  memory.Grow(300);
  EXPECT_EQ(memory.limit_bytes(), 800u);
  EXPECT_EQ(early[0].size(), 100u);
  early.clear();
  const auto late = memory.Take(2, kNow);
  ASSERT_EQ(late.size(), 2u);
  for (const FrameBlock& block : late) {
    EXPECT_EQ(block.size(), 400u);
    std::fill_n(block.data(), block.size(), uint8_t{7});
  }
}

}  // namespace
}  // namespace rotunda::rig
