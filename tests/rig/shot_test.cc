#include "rig/shot.h"

#include <gtest/gtest.h>

namespace rotunda::rig {
namespace {

Shot ShotOf(const std::vector<int64_t>& exposed_ns) {
  Shot shot;
  for (const int64_t time_ns : exposed_ns) {
    CameraShot& camera = shot.cameras.emplace_back();
    camera.camera = "c" + std::to_string(shot.cameras.size() - 1);
    camera.verdict = Verdict::kOk;
    camera.exposed_ns = time_ns;
  }
  return shot;
}

TEST(JudgeSkew, ComparesWithTheMedianAndNamesTheWorst) {
  Shot shot = ShotOf({1'000'000, 1'010'000, 3'500'000, 990'000, 1'000'000});
  JudgeSkew(1000, shot);
  EXPECT_STREQ(VerdictName(shot.cameras[2].verdict), "skewed");
  EXPECT_EQ(shot.cameras[2].reason, "2500.0 us after the others, allowed are 1000.0 us");
  EXPECT_EQ(shot.OkCount(), 4u);
  EXPECT_DOUBLE_EQ(shot.skew.max_us, 2500);
  EXPECT_DOUBLE_EQ(shot.skew.median_us, 10);
  EXPECT_EQ(shot.skew.worst, "c2");
  EXPECT_DOUBLE_EQ(*shot.cameras[3].skew_us, -10);
}

TEST(JudgeSkew, BlamesNobodyForWhatItsClockDoesNotTell) {
  Shot shot = ShotOf({0, 0, 1'200'000});
  shot.cameras[2].clock_uncertainty_us = 300;
  JudgeSkew(1000, shot);
  EXPECT_EQ(shot.OkCount(), 3u);
  shot = ShotOf({0, 0, 0});
  for (CameraShot& camera : shot.cameras) camera.exposed_ns.reset();
  JudgeSkew(1000, shot);
  EXPECT_FALSE(shot.cameras[0].skew_us);
  EXPECT_EQ(shot.skew.worst, "");
  EXPECT_FALSE(shot.skew.known());
}

TEST(JudgeSkew, KeepsAnEarlierVerdict) {
  Shot shot = ShotOf({0, 0, 9'000'000});
  shot.cameras[2].verdict = Verdict::kLate;
  JudgeSkew(1000, shot);
  EXPECT_STREQ(VerdictName(shot.cameras[2].verdict), "late");
}

TEST(FrameIdCheck, TakesIdsThatRestartAndIdsThatCountOn) {
  FrameIdCheck ids;
  ids.Begin(7);
  EXPECT_TRUE(ids.Accept(8));
  EXPECT_FALSE(ids.Accept(8)) << "the frame of an earlier pulse";
  EXPECT_FALSE(ids.Accept(10)) << "one was not seen";
  ids.Miss();
  EXPECT_TRUE(ids.Accept(10)) << "and it is known which";
  EXPECT_TRUE(ids.Accept(1));
  EXPECT_TRUE(ids.Accept(2));
  EXPECT_FALSE(ids.Accept(40)) << "it skipped";
  ids.Miss();
  EXPECT_TRUE(ids.Accept(41)) << "and counts on from there";
  ids.Miss();
  EXPECT_FALSE(ids.Accept(41)) << "the frame of an earlier pulse";
  ids.Miss();
  EXPECT_FALSE(ids.Accept(41));
  ids.Begin(65535);
  EXPECT_TRUE(ids.Accept(1)) << "16 bits go round without 0";
}

TEST(Shot, SaysWhoIsNotOkAndWhy) {
  Shot shot = ShotOf({0, 0, 0});
  EXPECT_EQ(shot.Summary(), "3/3 ok");
  shot.cameras[1].verdict = Verdict::kMissing;
  shot.cameras[1].reason = "trigger cable?";
  shot.cameras[2].verdict = Verdict::kLate;
  EXPECT_EQ(shot.Summary(), "1/3 ok; c1 missing (trigger cable?); c2 late");
  EXPECT_EQ(shot.Tally(), "1/3 ok");
  EXPECT_FALSE(shot.complete());
}

void Refuse(CameraShot& camera, Verdict verdict, const char* reason) {
  camera.verdict = verdict;
  camera.reason = reason;
}

TEST(Shot, SaysAReasonThatSeveralCamerasShareOnce) {
  Shot shot = ShotOf(std::vector<int64_t>(10, 0));
  for (const size_t i : {1, 3, 4}) Refuse(shot.cameras[i], Verdict::kMissing, "cable?");
  Refuse(shot.cameras[2], Verdict::kMissing, "another");
  EXPECT_EQ(shot.Summary(), "6/10 ok; 3 missing (cable?): c1, c3, c4; c2 missing (another)");
  for (CameraShot& camera : shot.cameras) Refuse(camera, Verdict::kDisconnected, "no power?");
  shot.cameras[0].verdict = Verdict::kOk;
  EXPECT_EQ(shot.Summary(),
            "1/10 ok; 9 disconnected (no power?): c1, c2, c3, c4, c5, c6 and 3 more");
  Refuse(shot.cameras[0], Verdict::kDisconnected, "no power?");
  EXPECT_EQ(shot.Summary(), "0/10 ok, no camera gave a picture; all disconnected (no power?)");
}

TEST(Shot, TellsTheRangeOfMeasuredFiguresThatDiffer) {
  Shot shot = ShotOf(std::vector<int64_t>(7, 0));
  Refuse(shot.cameras[0], Verdict::kLate, "came 1004 ms after the pulse, allowed are 500");
  Refuse(shot.cameras[1], Verdict::kLate, "came 904 ms after the pulse, allowed are 500");
  Refuse(shot.cameras[2], Verdict::kLate, "came 931 ms after the pulse, allowed are 500");
  Refuse(shot.cameras[3], Verdict::kSkewed, "2500.0 us after the others, allowed are 1000.0 us");
  Refuse(shot.cameras[4], Verdict::kSkewed, "2500.5 us after the others, allowed are 1000.0 us");
  Refuse(shot.cameras[5], Verdict::kSkewed, "2500.5 us before the others, allowed are 1000.0 us");
  EXPECT_EQ(shot.Summary(),
            "1/7 ok; "
            "3 late (came 904 to 1004 ms after the pulse, allowed are 500): c0, c1, c2; "
            "2 skewed (2500.0 to 2500.5 us after the others, allowed are 1000.0 us): c3, c4; "
            "c5 skewed (2500.5 us before the others, allowed are 1000.0 us)");
}

TEST(Shot, MakesNoRangeOfSerialNumbers) {
  Shot shot = ShotOf({0, 0, 0});
  Refuse(shot.cameras[0], Verdict::kDisconnected, "serial 77 was not found");
  Refuse(shot.cameras[1], Verdict::kDisconnected, "serial 78 was not found");
  EXPECT_EQ(shot.Summary(),
            "1/3 ok; c0 disconnected (serial 77 was not found); "
            "c1 disconnected (serial 78 was not found)");
}

TEST(Shot, APictureThatIsNotGoodIsAPicture) {
  Shot shot = ShotOf({0, 0});
  for (CameraShot& camera : shot.cameras) Refuse(camera, Verdict::kLate, "slow");
  EXPECT_EQ(shot.Summary(), "0/2 ok, no camera gave a picture; all late (slow)");
  shot.cameras[1].arrival_ms = 2100;
  EXPECT_EQ(shot.Summary(), "0/2 ok; all late (slow)");
}

TEST(Shot, SuspectsTheTriggerLineWhenNobodyWhoWaitedSawThePulse) {
  const auto suspects = [](const Shot& shot) {
    return shot.Summary().find("is the trigger cable connected?") != std::string::npos;
  };
  Shot shot = ShotOf({0, 0, 0});
  for (CameraShot& camera : shot.cameras) Refuse(camera, Verdict::kMissing, "its cable?");
  EXPECT_TRUE(suspects(shot)) << shot.Summary();
  EXPECT_EQ(shot.Summary().find("its cable?"), std::string::npos);
  shot.cameras[0].verdict = Verdict::kDisconnected;
  EXPECT_TRUE(suspects(shot)) << shot.Summary();
  shot.cameras[0].verdict = Verdict::kIncomplete;
  EXPECT_FALSE(suspects(shot)) << "it had seen the pulse";
  shot.cameras[0].verdict = Verdict::kInterrupted;
  EXPECT_FALSE(suspects(shot)) << "it may still have sent a frame";
  shot.cameras[0].verdict = Verdict::kNoClock;
  EXPECT_TRUE(suspects(shot)) << "it was not used: " << shot.Summary();
  shot.cameras[0].arrival_ms = 200;
  EXPECT_FALSE(suspects(shot)) << "it had seen the pulse";
  shot.cameras[0].verdict = shot.cameras[1].verdict = Verdict::kDisconnected;
  EXPECT_FALSE(suspects(shot)) << "one alone: its own cable";
}

}  // namespace
}  // namespace rotunda::rig
