#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <thread>
#include <vector>

#include "rig/frame_set_writer.h"
#include "sfm/core/frame_set.h"
#include "tests/support/process.h"
#include "tests/support/simulated_rig.h"

// Cameras, session and writer together over a disk that does not keep up.

namespace {

enum class Disk { kGood, kHangs, kFull, kPlaceRefused };
std::atomic<Disk> disk = Disk::kGood;
std::atomic<int> refused_or_waiting = 0;
std::atomic<ino_t> place = 0;  // the folder that the sets are in

bool Refuses(int fd) {
  if (disk == Disk::kFull) return true;
  struct stat file {};
  return disk == Disk::kPlaceRefused && fstat(fd, &file) == 0 && file.st_ino == place;
}

}  // namespace

/// In place of libc's, for what is linked into this program.
extern "C" int fsync(int fd) {
  if (disk == Disk::kHangs) ++refused_or_waiting;
  while (disk == Disk::kHangs) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  if (Refuses(fd)) {
    ++refused_or_waiting;
    errno = ENOSPC;
    return -1;
  }
  return static_cast<int>(syscall(SYS_fsync, fd));
}

namespace rotunda::rig {
namespace {

using namespace std::chrono_literals;
using test::SimulatedRig;

constexpr int kCameras = 3;

struct BadDisk {
  const char* name;
  const char* block;
  Disk disk;
};
/// However a test ends, the writer does too.
struct GoodInTheEnd {
  ~GoodInTheEnd() { disk = Disk::kGood; }
};

const BadDisk kBadDisks[] = {{"Hangs", "127.34.1", Disk::kHangs},
                             {"Full", "127.34.2", Disk::kFull},
                             // When the set is whole and in its place already.
                             {"FullForThePlace", "127.34.3", Disk::kPlaceRefused}};

void PrintTo(const BadDisk& bad, std::ostream* out) { *out << bad.name; }

class CaptureOverABadDisk : public testing::TestWithParam<BadDisk> {
 protected:
  CaptureOverABadDisk() : rig_(Options()) {
    rig_.capture().retries = 0;
    rig_.capture().sets_in_memory = 2;
  }
  static SimulatedRig::Options Options() {
    SimulatedRig::Options options;
    options.block = GetParam().block;
    options.cameras = kCameras;
    options.like.width_px = 160;
    options.like.height_px = 120;
    return options;
  }
  FrameSetOrder OrderTo(const std::string& name) const {
    FrameSetOrder order;
    order.out = folder_ / name;
    order.id = name;
    order.captured_at = "2026-01-01T00:00:00Z";
    order.trigger_source = "simulated";
    return order;
  }
  /// Whether the set has the pictures that the cameras saw in shot number `shot`.
  void ExpectServed(const std::string& name, int shot) const {
    const auto set = ReadFrameSet(folder_ / name);
    ASSERT_TRUE(set) << set.error().ToString();
    EXPECT_EQ(set->trigger.at("complete"), TriggerValue(true));
    ASSERT_EQ(set->frames.size(), size_t{kCameras});
    for (int i = 0; i < kCameras; ++i) {
      const std::string file = set->folder / set->frames[static_cast<size_t>(i)].file;
      const cv::Mat picture = cv::imread(file, cv::IMREAD_UNCHANGED);
      const std::vector<uint8_t> served = rig_.Served(i, shot);
      ASSERT_EQ(picture.total() * picture.elemSize(), served.size());
      EXPECT_EQ(std::memcmp(picture.data, served.data(), served.size()), 0) << file;
    }
  }

  const test::TemporaryFolder folder_;
  SimulatedRig rig_;
};

TEST_P(CaptureOverABadDisk, PulsesAreTakenMeanwhileNothingIsLostAndItIsSaid) {
  const auto session = rig_.Open();
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(60s), size_t{kCameras});
  FrameSetWriter writer(2);
  const GoodInTheEnd mend;
  auto first = (*session)->Capture();
  ASSERT_TRUE(first) << first.error().ToString();
  ASSERT_TRUE(first->complete()) << first->Summary();

  struct stat here {};
  ASSERT_EQ(stat(folder_.path().c_str(), &here), 0);
  place = here.st_ino;
  disk = GetParam().disk;
  refused_or_waiting = 0;
  const auto first_ticket = writer.Submit(OrderTo("first"), std::move(*first));
  while (refused_or_waiting == 0) std::this_thread::sleep_for(1ms);
  auto second = (*session)->Capture();
  ASSERT_TRUE(second) << second.error().ToString();
  EXPECT_TRUE(second->complete()) << second->Summary();
  EXPECT_EQ(rig_.ExactFrames(*second, 1), kCameras);
  const auto second_ticket = writer.Submit(OrderTo("second"), std::move(*second));

  const auto third = (*session)->Capture();
  ASSERT_FALSE(third) << "memory may hold two sets";
  EXPECT_NE(third.error().message.find("memory is full"), std::string::npos)
      << third.error().ToString();
  EXPECT_EQ(writer.pending(), 2u);
  const auto trouble = writer.trouble();
  if (GetParam().disk != Disk::kHangs) {
    ASSERT_TRUE(trouble);
    EXPECT_TRUE(trouble->tried_again);
    EXPECT_EQ(trouble->out, folder_ / "first");
    EXPECT_NE(trouble->error.message.find("No space left on device"), std::string::npos)
        << trouble->error.ToString();
  }

  disk = Disk::kGood;
  const auto first_set = writer.Wait(first_ticket);
  ASSERT_TRUE(first_set) << first_set.error().ToString();
  const auto second_set = writer.Wait(second_ticket);
  ASSERT_TRUE(second_set) << second_set.error().ToString();
  EXPECT_FALSE(writer.trouble());
  ExpectServed("first", 0);
  ExpectServed("second", 1);
  const auto next = (*session)->Capture();
  ASSERT_TRUE(next) << next.error().ToString();
  EXPECT_TRUE(next->complete()) << next->Summary();
  EXPECT_EQ(rig_.ExactFrames(*next, 2), kCameras) << "the refused shot fired no pulse";
}

INSTANTIATE_TEST_SUITE_P(Table, CaptureOverABadDisk, testing::ValuesIn(kBadDisks),
                         [](const auto& info) { return std::string(info.param.name); });

}  // namespace
}  // namespace rotunda::rig
