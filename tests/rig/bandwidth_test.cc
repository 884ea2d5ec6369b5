#include "rig/bandwidth.h"

#include <gtest/gtest.h>

namespace rotunda::rig {
namespace {

TEST(Bandwidth, NinetyCamerasOnTenGigabit) {
  const UplinkLoad load{"switch", 90, 1e10, 1e9};
  // Interval between packets of one camera: 90 * 9038 * 8 bit / (0.9 * 10 Gbit/s) = 723.04 us; the
  // packet itself takes 72.3 us of that on the camera's own link.
  EXPECT_NEAR(static_cast<double>(PacketDelay_ns(9000, load.Share())), 723'040 - 72'304, 1);
  EXPECT_NEAR(FrameTime_s(1200 * 1600, 9000, load.Share()), 0.157, 0.002);
  EXPECT_NEAR(FrameTime_s(12'000'000, 9000, load.Share()), 0.97, 0.01);
}

TEST(Bandwidth, ACameraIsNoFasterThanItsOwnLink) {
  const UplinkLoad alone{"switch", 1, 1e10, 1e9};
  EXPECT_EQ(PacketDelay_ns(9000, alone.Share()), 0);
  EXPECT_GE(FrameTime_s(1200 * 1600, 9000, alone.Share()), 8.0 * 1200 * 1600 / 1e9);
}

TEST(Bandwidth, SmallPacketsCostMoreOverhead) {
  const UplinkLoad load{"switch", 90, 1e10, 1e9};
  EXPECT_GT(FrameTime_s(1200 * 1600, 1500, load.Share()),
            1.03 * FrameTime_s(1200 * 1600, 9000, load.Share()));
}

TEST(Bandwidth, FramesMustBeThroughBeforeTheDeadline) {
  const UplinkLoad load{"switch", 90, 1e10, 1e9};
  // 157 ms of transfer and 4 ms of exposure.
  EXPECT_TRUE(CheckInTime({1200 * 1600, 9000, 4000}, load, 165));
  const Status slow = CheckInTime({1200 * 1600, 9000, 4000}, load, 160);
  ASSERT_FALSE(slow);
  EXPECT_EQ(slow.error().ToString(),
            "uplinks.switch: with 90 cameras, frames of 1.92 MB need 161 ms from the pulse on in "
            "packets of 9000 bytes, but capture.deadline_ms is 160");
  EXPECT_FALSE(CheckInTime({1200 * 1600, 1500, 4000}, load, 165)) << "with shorter packets";
}

TEST(Bandwidth, LongTimesArePlainNumbers) {
  const UplinkLoad slow{"switch", 90, 45e6, 1e9};
  const Status refused = CheckInTime({1200 * 1600, 9000, 4000}, slow, 2000);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("need 34871 ms"), std::string::npos)
      << refused.error().message;
}

}  // namespace
}  // namespace rotunda::rig
