#include "daemon/retention.h"

#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <future>
#include <optional>

#include "daemon/slow_look.h"
#include "daemon/store_captures.h"
#include "daemon/store_events.h"
#include "daemon/store_reconstructions.h"
#include "daemon/store_sql.h"
#include "sfm/core/pose_set.h"
#include "tests/support/daemon_state.h"
#include "tests/support/small_disk.h"

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;
using test::DaemonState;

constexpr int kCaptures = 8;

/// Captures x0 (2025-12-01) to x7 (2025-12-08), a reconstruction of each; now is 2026-01-01.
class RetentionTest : public ::testing::Test {
 protected:
  RetentionTest() {
    for (int i = 0; i < kCaptures; ++i) {
      const std::string id = Name(i), made = id + "-r1";
      test::WriteTinyFrameSet(store().CaptureFolder(id),
                              "2025-12-0" + std::to_string(i + 1) + "T12:00:00.000Z");
      EXPECT_TRUE(RecordCapture(store(), id, std::nullopt).ok());
      PoseSet poses;
      poses.frameset = id;
      fs::create_directories(store().ReconstructionFolder(made));
      EXPECT_TRUE(
          WriteNewFile(store().ReconstructionFolder(made) / "poses.json", PoseSetToJson(poses)));
      EXPECT_TRUE(RecordReconstruction(store(), made).ok());
    }
  }
  Store& store() { return state_.store(); }
  static std::string Name(int i) { return "x" + std::to_string(i); }

  /// "x3 x4" of the captures that are there, by row and by folder.
  std::string Left() {
    std::string left;
    for (int i = 0; i < kCaptures; ++i) {
      const std::string id = Name(i);
      const bool has_row = FindCapture(store(), id).ok();
      EXPECT_EQ(fs::exists(store().CaptureFolder(id) / "frames/c0.png"), has_row) << id;
      EXPECT_EQ(FindReconstruction(store(), id + "-r1").ok(), has_row) << id;
      EXPECT_EQ(fs::exists(store().ReconstructionFolder(id + "-r1")), has_row) << id;
      if (has_row) left += (left.empty() ? "" : " ") + id;
    }
    return left;
  }

  DaemonState state_;
};

TEST_F(RetentionTest, WithoutARuleNothingEverGoes) {
  EXPECT_TRUE(ApplyRetention(store(), {})->empty());
  EXPECT_EQ(Left(), "x0 x1 x2 x3 x4 x5 x6 x7");
}

TEST_F(RetentionTest, TheNewestStay) {
  EXPECT_EQ(ApplyRetention(store(), {3, std::nullopt})->size(), 5u);
  EXPECT_EQ(Left(), "x5 x6 x7");
  EXPECT_TRUE(ApplyRetention(store(), {3, std::nullopt})->empty()) << "a second time";
  EXPECT_EQ(state_.Reopen().recovery().adopted.size(), 0u);
  EXPECT_TRUE(store().recovery().gone.empty());
  EXPECT_EQ(Left(), "x5 x6 x7");
}

TEST_F(RetentionTest, WhatIsYoungStays) {
  EXPECT_EQ(ApplyRetention(store(), {std::nullopt, 3})->size(), 4u);
  EXPECT_EQ(Left(), "x4 x5 x6 x7");
}

TEST_F(RetentionTest, AClockThatIsYearsAheadTakesNoMoreThanOneThatIsRight) {
  state_.clock().Advance(std::chrono::hours(24 * 3650));
  EXPECT_EQ(ApplyRetention(store(), {std::nullopt, 3})->size(), 4u);
  EXPECT_EQ(Left(), "x4 x5 x6 x7");
}

TEST_F(RetentionTest, WithTwoRulesBothMustNameIt) {
  EXPECT_EQ(ApplyRetention(store(), {6, 3})->size(), 2u);
  EXPECT_EQ(Left(), "x2 x3 x4 x5 x6 x7");
}

TEST_F(RetentionTest, WhatAJobNeedsStaysUntilItHasEnded) {
  ASSERT_TRUE(AddJob(store(), {JobKind::kReconstruction, "{\"capture\":\"x1\"}", ""}).ok());
  ASSERT_TRUE(AddJob(store(), {JobKind::kCalibration, "{\"captures\":[\"x0\",\"x2\"]}", ""}).ok());
  EXPECT_EQ(ApplyRetention(store(), {3, std::nullopt})->size(), 2u);
  EXPECT_EQ(Left(), "x0 x1 x2 x5 x6 x7");
  for (const int64_t number : {1, 2}) ASSERT_TRUE(RequestCancel(store(), number).ok());
  EXPECT_EQ(ApplyRetention(store(), {3, std::nullopt})->size(), 3u);
  EXPECT_EQ(Left(), "x5 x6 x7");
}

TEST_F(RetentionTest, AStopLeavesTheRestForTheNextTime) {
  std::stop_source stop;
  // At the first that goes.
  const auto subscription =
      state_.hub().Subscribe([&stop](const EventRecord&) { stop.request_stop(); });
  EXPECT_EQ(*ApplyRetention(store(), {3, std::nullopt}, stop.get_token()),
            std::vector<std::string>{"x0"});
  EXPECT_EQ(Left(), "x1 x2 x3 x4 x5 x6 x7");
  EXPECT_EQ(ApplyRetention(store(), {3, std::nullopt})->size(), 4u);
}

TEST_F(RetentionTest, ACrashInBetweenIsMadeGood) {
  // Rows are gone, folders are not.
  ASSERT_TRUE(store()
                  .Write([](Database& database, auto&) {
                    return database.Execute("DELETE FROM captures WHERE id = 'x0'");
                  })
                  .ok());
  // The capture is out of sight but still on the disk.
  ASSERT_TRUE(ApplyRetention(store(), {7, std::nullopt})->empty());
  fs::create_directories(state_.folder() / "captures/.x9.tmp-removed/frames");
  state_.Reopen();
  EXPECT_EQ(store().recovery().adopted,
            (std::vector<std::string>{"captures/x0", "reconstructions/x0-r1"}));
  EXPECT_FALSE(fs::exists(state_.folder() / "captures/.x9.tmp-removed"));
  EXPECT_EQ(ApplyRetention(store(), {7, std::nullopt})->size(), 1u);
  EXPECT_EQ(Left(), "x1 x2 x3 x4 x5 x6 x7");
}

TEST_F(RetentionTest, RefusesRulesThatWouldTakeEverything) {
  EXPECT_EQ(ApplyRetention(store(), {0, std::nullopt}).error().code, ErrorCode::kInvalidArgument);
  EXPECT_EQ(ApplyRetention(store(), {std::nullopt, 0}).error().code, ErrorCode::kInvalidArgument);
  EXPECT_EQ(ApplyRetention(store(), {std::nullopt, -5}).error().code, ErrorCode::kInvalidArgument);
  EXPECT_EQ(Left(), "x0 x1 x2 x3 x4 x5 x6 x7");
}

TEST(DiskReserve, IsRefusedWithWhatToDo) {
  DaemonState state;
  EXPECT_TRUE(CheckDiskReserve(state.store(), 0).ok());
  const Status full = CheckDiskReserve(state.store(), uint64_t{1} << 60);
  ASSERT_FALSE(full.ok());
  EXPECT_EQ(full.error().code, ErrorCode::kIo);
  EXPECT_NE(full.error().message.find("1.15 EB are kept in reserve; make room"), std::string::npos)
      << full.error().message;
  EXPECT_TRUE(IsBelowReserve(full.error()));
  const fs::path captures = state.folder() / "captures";
  fs::remove(captures);
  const Status gone = CheckDiskReserve(state.store(), 0);
  ASSERT_FALSE(gone.ok());
  EXPECT_FALSE(IsBelowReserve(gone.error()));
  EXPECT_EQ(gone.error().context, captures);
}

TEST(DiskReserve, IsThatOfTheDiskThatALinkLeadsTo) {
  constexpr uint64_t kDisk_bytes = 1 << 20;
  const test::SmallDisk disk(kDisk_bytes);
  if (!disk.mounted()) GTEST_SKIP() << "a small disk can be mounted by root only";
  DaemonState state;
  const fs::path captures = state.folder() / "captures";
  fs::remove(captures);
  fs::create_directory_symlink(disk.path(), captures);
  const auto room = state.store().LeastRoom();
  ASSERT_TRUE(room.ok()) << room.error().ToString();
  EXPECT_EQ(room->folder, captures);
  EXPECT_LE(room->free_bytes, kDisk_bytes);
  EXPECT_TRUE(CheckDiskReserve(state.store(), room->free_bytes).ok());
  const Status full = CheckDiskReserve(state.store(), room->free_bytes + 1);
  ASSERT_FALSE(full.ok());
  EXPECT_EQ(full.error().context, captures);
}

TEST(SlowLook, OneThatHangsHoldsUpNobodyElse) {
  using namespace std::chrono_literals;
  for (const auto patience : {0ms, 1000000ms}) {
    SlowLook<int> look(1, patience);
    EXPECT_EQ(look.Look([](int last) { return last + 1; }), 2);
    std::promise<void> begun, answer;
    auto hanging = std::async(std::launch::async, [&] {
      return look.Look([&](int) {
        begun.set_value();
        answer.get_future().wait();
        return 7;
      });
    });
    begun.get_future().wait();
    const auto meanwhile = look.Look([](int) { return 99; });
    EXPECT_EQ(meanwhile, patience == 0ms ? std::nullopt : std::optional(2));
    answer.set_value();
    EXPECT_EQ(hanging.get(), 7);
    EXPECT_EQ(look.Look([](int last) { return last; }), 7);
  }
}

TEST(Retention, MakesRoomOnADiskThatIsFull) {
  constexpr uint64_t kDisk_bytes = 8'000'000;
  const test::SmallDisk disk(kDisk_bytes);
  if (!disk.mounted()) GTEST_SKIP() << "a small disk can be mounted by root only";
  EventHub hub;
  test::SteppingClock clock;
  const auto open = [&] {
    auto store = Store::Open({disk.path(), clock.Source(), {}, {}}, hub);
    EXPECT_TRUE(store) << store.error().ToString();
    return std::move(*store);
  };
  {
    const auto store = open();
    for (const char* day : {"1", "2", "3"}) {
      const std::string id = std::string("x") + day;
      test::WriteTinyFrameSet(store->CaptureFolder(id),
                              "2025-12-0" + std::string(day) + "T12:00:00.000Z");
      EXPECT_TRUE(RecordCapture(*store, id, std::nullopt).ok());
    }
  }
  const auto store = open();  // whose log of writes is empty again
  std::ofstream filler(disk.path() / "filler", std::ios::binary);
  const std::string page(4096, 'x');
  while (filler.write(page.data(), static_cast<std::streamsize>(page.size())).flush()) {
  }
  const auto gone = ApplyRetention(*store, {.keep_count = 1, .keep_days = {}});
  ASSERT_TRUE(gone) << gone.error().ToString();
  EXPECT_EQ(*gone, (std::vector<std::string>{"x1", "x2"}));
  EXPECT_FALSE(fs::exists(store->CaptureFolder("x1")));
  EXPECT_TRUE(FindCapture(*store, "x3").ok());
}

}  // namespace
}  // namespace rotunda::daemon
