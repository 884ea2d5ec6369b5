#include "rig/frame_set_writer.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <xxhash.h>

#include <chrono>
#include <csignal>
#include <cstring>
#include <opencv2/imgcodecs.hpp>
#include <random>
#include <thread>

#include "rig/png_encoder.h"
#include "sfm/core/file_io.h"
#include "tests/support/process.h"

namespace rotunda::rig {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

constexpr int kWidth = 101;
constexpr int kHeight = 67;

std::vector<uint8_t> Noise(size_t size, uint32_t seed) {
  std::mt19937 random(seed);
  std::vector<uint8_t> bytes(size);
  for (uint8_t& byte : bytes) byte = static_cast<uint8_t>(random());
  return bytes;
}

/// A shot of `cameras` cameras; the last one is missing when `incomplete`.
Shot MakeShot(FrameMemory& memory, int cameras, bool incomplete) {
  Shot shot;
  auto blocks = memory.Take(static_cast<size_t>(cameras), std::chrono::steady_clock::now());
  for (int i = 0; i < cameras; ++i) {
    CameraShot& camera = shot.cameras.emplace_back();
    camera.camera = "c" + std::to_string(i);
    camera.serial = "S" + std::to_string(i);
    camera.settings.width_px = kWidth;
    camera.settings.height_px = kHeight;
    camera.settings.pixel_format = "BayerRG8";
    if (incomplete && i == cameras - 1) {
      camera.reason = "trigger cable?";
      continue;
    }
    camera.verdict = Verdict::kOk;
    CameraFrame& frame = camera.frame.emplace();
    frame.complete = true;
    frame.frame_id = 7;
    frame.timestamp_ns = 1234567890123456789;
    frame.width_px = kWidth;
    frame.height_px = kHeight;
    frame.pixel_format = "BayerRG8";
    frame.memory = std::move(blocks[static_cast<size_t>(i)]);
    const auto noise = Noise(kWidth * kHeight, static_cast<uint32_t>(i));
    std::memcpy(frame.memory.data(), noise.data(), noise.size());
  }
  return shot;
}

FrameSetOrder OrderTo(const fs::path& out) {
  FrameSetOrder order;
  order.out = out;
  order.id = "shot-1";
  order.captured_at = "2026-01-01T00:00:00Z";
  order.trigger_source = "simulated";
  return order;
}

TEST(PngEncoder, GivesBackEveryByteOfGreyAndColour) {
  for (const int channels : {1, 3}) {
    const auto bytes = Noise(static_cast<size_t>(kWidth) * kHeight * channels, 5);
    const auto png = EncodePng({bytes, kWidth, kHeight, channels});
    ASSERT_TRUE(png) << png.error().ToString();
    const std::vector<uint8_t> file(png->begin(), png->end());
    const cv::Mat read = cv::imdecode(file, cv::IMREAD_UNCHANGED);
    ASSERT_EQ(read.channels(), channels);
    ASSERT_EQ(read.cols, kWidth);
    ASSERT_EQ(read.rows, kHeight);
    for (size_t i = 0; i < bytes.size(); ++i) {
      // OpenCV turns RGB into BGR.
      const size_t at = channels == 1 ? i : i - i % 3 + 2 - i % 3;
      ASSERT_EQ(read.data[at], bytes[i]) << i;
    }
  }
  EXPECT_FALSE(EncodePng({Noise(10, 1), 5, 3, 1}));
}

TEST(FrameSetWriter, WritesWhatWasTaken) {
  const test::TemporaryFolder folder;
  FrameMemory memory(3, kWidth * kHeight);
  FrameSetWriter writer(2);
  const auto written =
      writer.Wait(writer.Submit(OrderTo(folder / "set"), MakeShot(memory, 3, true)));
  ASSERT_TRUE(written) << written.error().ToString();
  EXPECT_EQ(memory.lent(), 0u);
  EXPECT_EQ(written->figures.size(), 2u);
  EXPECT_NEAR(written->figures.at("c0").mean_level, 127.5, 5);
  const auto set = ReadFrameSet(folder / "set");
  ASSERT_TRUE(set) << set.error().ToString();
  EXPECT_EQ(set->id, "shot-1");
  EXPECT_EQ(set->trigger.at("complete"), TriggerValue(false));
  ASSERT_EQ(set->frames.size(), 3u);
  EXPECT_EQ(set->frames[2].status, "missing");
  EXPECT_TRUE(set->frames[2].file.empty());
  for (int i = 0; i < 2; ++i) {
    const Frame& frame = set->frames[i];
    EXPECT_EQ(frame.status, "ok");
    EXPECT_EQ(frame.frame_id, 7u);
    EXPECT_EQ(frame.timestamp_ns, 1234567890123456789u);
    const std::string file = ReadFile(set->folder / frame.file).value();
    char hash[17];
    std::snprintf(hash, sizeof(hash), "%016llx",
                  static_cast<unsigned long long>(XXH3_64bits(file.data(), file.size())));
    EXPECT_EQ(frame.xxh3, hash);
    const cv::Mat picture = cv::imread(set->folder / frame.file, cv::IMREAD_UNCHANGED);
    const auto noise = Noise(kWidth * kHeight, static_cast<uint32_t>(i));
    ASSERT_EQ(picture.total(), noise.size());
    EXPECT_EQ(std::memcmp(picture.data, noise.data(), noise.size()), 0);
  }
  const std::string shot = ReadFile(folder / "set/shot.json").value();
  EXPECT_NE(shot.find("trigger cable?"), std::string::npos);
}

/// Waits for the writer to be in trouble, or not any more.
bool WaitForTrouble(const FrameSetWriter& writer, bool wanted) {
  for (int i = 0; i < 1000; ++i) {
    if (writer.trouble().has_value() == wanted) return true;
    std::this_thread::sleep_for(10ms);
  }
  return false;
}

TEST(FrameSetWriter, AFullDiskLosesNothing) {
  const test::TemporaryFolder folder;
  FrameMemory memory(6, kWidth * kHeight);
  FrameSetWriter writer(2);
  // No file may be longer than 1000 bytes: what write() says on a full disk, without needing one.
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  rlimit small = before;
  small.rlim_cur = 1000;
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  const auto first = writer.Submit(OrderTo(folder / "first"), MakeShot(memory, 3, false));
  const auto second = writer.Submit(OrderTo(folder / "second"), MakeShot(memory, 3, false));
  const bool troubled = WaitForTrouble(writer, true);
  const auto trouble = writer.trouble();
  setrlimit(RLIMIT_FSIZE, &before);
  ASSERT_TRUE(troubled);
  EXPECT_EQ(trouble->out, folder / "first");
  EXPECT_NE(trouble->error.message.find("File too large"), std::string::npos)
      << trouble->error.ToString();
  EXPECT_EQ(memory.lent(), 6u);
  EXPECT_TRUE(writer.Wait(first)) << "once there is space";
  EXPECT_TRUE(writer.Wait(second));
  EXPECT_FALSE(writer.trouble());
  EXPECT_EQ(ReadFrameSet(folder / "first")->frames.size(), 3u);
  EXPECT_EQ(ReadFrameSet(folder / "second")->frames.size(), 3u);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()), 2)
      << "nothing half-written stays";
}

TEST(FrameSetWriter, ASetThatIsGivenUpFreesItsMemory) {
  const test::TemporaryFolder folder;
  FrameMemory memory(6, kWidth * kHeight);
  FrameSetWriter writer(1);
  const auto first = writer.Submit(OrderTo(folder / "none" / "first"), MakeShot(memory, 3, false));
  const auto second = writer.Submit(OrderTo(folder / "second"), MakeShot(memory, 3, false));
  ASSERT_TRUE(WaitForTrouble(writer, true));
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(writer.Wait(first, stop.get_token()).error().code, ErrorCode::kCancelled);
  writer.Abandon(first);
  EXPECT_FALSE(writer.Wait(first));
  EXPECT_TRUE(writer.Wait(second));
  EXPECT_EQ(memory.lent(), 0u);
}

TEST(FrameSetWriter, GivingUpALaterSetLeavesTheFirstAndTheOthersInPlace) {
  const test::TemporaryFolder folder;
  FrameMemory memory(12, kWidth * kHeight);
  FrameSetWriter writer(1);
  std::vector<FrameSetWriter::Ticket> tickets = {
      writer.Submit(OrderTo(folder / "none" / "first"), MakeShot(memory, 3, false))};
  for (const char* name : {"second", "third", "fourth"}) {
    tickets.push_back(writer.Submit(OrderTo(folder / name), MakeShot(memory, 3, false)));
  }
  ASSERT_TRUE(WaitForTrouble(writer, true));
  writer.Abandon(tickets[1]);
  EXPECT_FALSE(writer.Wait(tickets[1]));
  std::filesystem::create_directory(folder / "none");
  for (const size_t kept : {0, 2, 3}) {
    const auto written = writer.Wait(tickets[kept]);
    EXPECT_TRUE(written) << written.error().ToString();
  }
  EXPECT_EQ(memory.lent(), 0u);
}

}  // namespace
}  // namespace rotunda::rig
