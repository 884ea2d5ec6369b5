#include "rig/frame_set_writer.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>
#include <xxhash.h>

#include <chrono>
#include <csignal>
#include <cstring>
#include <memory>
#include <nlohmann/json.hpp>
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
  EXPECT_EQ(writer.signs_of_life(), 2u) << "a picture each";
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
  for (const char* unknown : {"arrival_ms", "skew_us", "clock_uncertainty_us", "interrupted"}) {
    EXPECT_EQ(shot.find(unknown), std::string::npos) << shot;
  }
  EXPECT_FALSE(set->trigger.contains("max_skew_camera")) << "no exposure's time is known";
  EXPECT_FALSE(set->trigger.contains("max_skew_us"));
}

TEST(FrameSetWriter, SaysWhatWasMeasuredAndThatTheShotWasInterrupted) {
  const test::TemporaryFolder folder;
  FrameMemory memory(2, kWidth * kHeight);
  Shot shot = MakeShot(memory, 2, true);
  shot.interrupted = true;
  shot.cameras[0].arrival_ms = 3004.5;
  shot.cameras[0].skew_us = -2.5;
  shot.skew = {2.5, 2.5, "c0"};
  shot.cameras[1].verdict = Verdict::kInterrupted;
  FrameSetWriter writer(1);
  ASSERT_TRUE(writer.Wait(writer.Submit(OrderTo(folder / "set"), std::move(shot))));
  const auto told = nlohmann::json::parse(ReadFile(folder / "set/shot.json").value());
  EXPECT_EQ(told["interrupted"], true);
  EXPECT_EQ(told["cameras"][0]["arrival_ms"], 3004.5);
  EXPECT_EQ(told["cameras"][0]["skew_us"], -2.5);
  EXPECT_EQ(told["cameras"][1]["verdict"], "interrupted");
  const auto set = ReadFrameSet(folder / "set");
  ASSERT_TRUE(set) << set.error().ToString();
  EXPECT_EQ(set->trigger.at("max_skew_camera"), TriggerValue("c0"));
  EXPECT_EQ(set->frames[1].status, "interrupted");
}

/// Waits for the writer to be in trouble, or not any more.
bool WaitForTrouble(const FrameSetWriter& writer, bool wanted) {
  for (int i = 0; i < 1000; ++i) {
    if (writer.trouble().has_value() == wanted) return true;
    std::this_thread::sleep_for(10ms);
  }
  return false;
}

/// While it lives no file may be longer than 1000 bytes: write() fails as on a full disk, without
/// needing one.
class NoRoom {
 public:
  NoRoom() {
    std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before_);
    rlimit small = before_;
    small.rlim_cur = 1000;
    setrlimit(RLIMIT_FSIZE, &small);
  }
  ~NoRoom() { setrlimit(RLIMIT_FSIZE, &before_); }
  NoRoom(const NoRoom&) = delete;
  NoRoom& operator=(const NoRoom&) = delete;

 private:
  rlimit before_{};
};

TEST(FrameSetWriter, AFullDiskLosesNothing) {
  const test::TemporaryFolder folder;
  FrameMemory memory(6, kWidth * kHeight);
  FrameSetWriter writer(2);
  auto full = std::make_unique<NoRoom>();
  const auto first = writer.Submit(OrderTo(folder / "first"), MakeShot(memory, 3, false));
  const auto second = writer.Submit(OrderTo(folder / "second"), MakeShot(memory, 3, false));
  const bool troubled = WaitForTrouble(writer, true);
  const auto trouble = writer.trouble();
  const uint64_t signs = writer.signs_of_life();
  while (troubled && writer.signs_of_life() == signs) std::this_thread::sleep_for(10ms);
  full.reset();
  ASSERT_TRUE(troubled);
  EXPECT_EQ(trouble->out, folder / "first");
  EXPECT_TRUE(trouble->tried_again);
  EXPECT_TRUE(trouble->error.context.starts_with((folder / "first/frames").string()))
      << "the place that was asked for: " << trouble->error.context;
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
  auto full = std::make_unique<NoRoom>();
  const auto first = writer.Submit(OrderTo(folder / "first"), MakeShot(memory, 3, false));
  const auto second = writer.Submit(OrderTo(folder / "second"), MakeShot(memory, 3, false));
  const bool troubled = WaitForTrouble(writer, true);
  std::stop_source stop;
  stop.request_stop();
  const ErrorCode waited = writer.Wait(first, stop.get_token()).error().code;
  writer.Abandon(first);
  const bool written = writer.Wait(first).ok();
  full.reset();
  ASSERT_TRUE(troubled);
  EXPECT_EQ(waited, ErrorCode::kCancelled);
  EXPECT_FALSE(written);
  EXPECT_TRUE(writer.Wait(second));
  EXPECT_EQ(memory.lent(), 0u);
}

TEST(FrameSetWriter, GivingUpALaterSetLeavesTheFirstAndTheOthersInPlace) {
  const test::TemporaryFolder folder;
  FrameMemory memory(12, kWidth * kHeight);
  FrameSetWriter writer(1);
  auto full = std::make_unique<NoRoom>();
  std::vector<FrameSetWriter::Ticket> tickets;
  for (const char* name : {"first", "second", "third", "fourth"}) {
    tickets.push_back(writer.Submit(OrderTo(folder / name), MakeShot(memory, 3, false)));
  }
  const bool troubled = WaitForTrouble(writer, true);
  writer.Abandon(tickets[1]);
  const bool written = writer.Wait(tickets[1]).ok();
  full.reset();
  ASSERT_TRUE(troubled);
  EXPECT_FALSE(written);
  for (const size_t kept : {0, 2, 3}) {
    const auto set = writer.Wait(tickets[kept]);
    EXPECT_TRUE(set) << set.error().ToString();
  }
  EXPECT_EQ(memory.lent(), 0u);
}

/// Root may write anywhere: while this lives, nobody is root.
class NotRoot {
 public:
  NotRoot() : was_root_(::geteuid() == 0) {
    if (was_root_) {
      EXPECT_EQ(::seteuid(65534), 0);
    }
  }
  ~NotRoot() {
    if (was_root_) {
      EXPECT_EQ(::seteuid(0), 0);
    }
  }
  NotRoot(const NotRoot&) = delete;
  NotRoot& operator=(const NotRoot&) = delete;

 private:
  const bool was_root_;
};

/// Where no set can be written however often it is tried.
struct BadPlace {
  const char* name;
  const char* says;
};
const BadPlace kBadPlaces[] = {
    {"none/set", "No such file or directory"},  // ENOENT
    {"file/set", "Not a directory"},            // ENOTDIR
    {"closed/set", "Permission denied"},        // EACCES
    {"taken", "exists and is not empty"},
};

TEST(FrameSetWriter, WhatNeverPassesIsToldAtOnceKeptAndDoesNotHoldOthersUp) {
  const test::TemporaryFolder folder;
  fs::create_directories(folder / "closed");
  fs::create_directories(folder / "taken" / "thing");
  ASSERT_TRUE(WriteNewFile(folder / "file", "no folder"));
  fs::permissions(folder / "closed", fs::perms::owner_read | fs::perms::owner_exec);
  fs::permissions(folder.path(), fs::perms::all);
  const NotRoot not_root;
  FrameMemory memory(3 * (std::size(kBadPlaces) + 1), kWidth * kHeight);
  FrameSetWriter writer(1);
  std::vector<FrameSetWriter::Ticket> tickets;
  for (const BadPlace& place : kBadPlaces) {
    tickets.push_back(writer.Submit(OrderTo(folder / place.name), MakeShot(memory, 3, false)));
  }
  const auto good = writer.Submit(OrderTo(folder / "good"), MakeShot(memory, 3, false));
  EXPECT_TRUE(writer.Wait(good));
  for (size_t i = 0; i < tickets.size(); ++i) {
    const auto refused = writer.Wait(tickets[i]);
    ASSERT_FALSE(refused) << kBadPlaces[i].name;
    EXPECT_NE(refused.error().message.find(kBadPlaces[i].says), std::string::npos)
        << refused.error().ToString();
    EXPECT_EQ(memory.lent(), 3 * (tickets.size() - i)) << "the frames are still there";
    EXPECT_FALSE(writer.trouble()->tried_again);
    ASSERT_TRUE(writer.Redirect(tickets[i], folder / ("moved" + std::to_string(i))));
    const auto written = writer.Wait(tickets[i]);
    EXPECT_TRUE(written) << written.error().ToString();
  }
  EXPECT_EQ(memory.lent(), 0u);
  EXPECT_FALSE(writer.trouble());
  EXPECT_FALSE(writer.Redirect(good, folder / "again"));
}

TEST(FrameSetWriter, ASetThatWasSetAsideCanBeGivenUp) {
  const test::TemporaryFolder folder;
  FrameMemory memory(3, kWidth * kHeight);
  FrameSetWriter writer(1);
  const auto ticket = writer.Submit(OrderTo(folder / "none" / "set"), MakeShot(memory, 3, false));
  EXPECT_FALSE(writer.Wait(ticket));
  EXPECT_EQ(writer.pending(), 1u);
  writer.Abandon(ticket);
  EXPECT_EQ(writer.pending(), 0u);
  EXPECT_EQ(memory.lent(), 0u);
}

}  // namespace
}  // namespace rotunda::rig
