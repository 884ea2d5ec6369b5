#include "daemon/drift.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <random>

#include "daemon/store_calibrations.h"
#include "daemon/store_captures.h"
#include "daemon/store_events.h"
#include "daemon/store_reconstructions.h"
#include "sfm/pose_description.h"
#include "sfm/rig_alignment.h"
#include "tests/support/daemon_state.h"

namespace rotunda::daemon {
namespace {

using test::DaemonState;

constexpr int kColumns = 10, kRows = 3;
constexpr double kRadius_m = 2.0;
// What TC-SfM reaches on the simulated rig is better.
constexpr double kPosition_mm = 0.5, kRotation_deg = 0.02;

/// Cameras c00r0, c00r1, ... on a cylinder, looking at its axis.
Calibration RingCalibration() {
  Calibration calibration;
  calibration.created_at = "2026-01-01T00:00:00Z";
  for (int c = 0; c < kColumns; ++c) {
    for (int r = 0; r < kRows; ++r) {
      char name[16];
      std::snprintf(name, sizeof(name), "c%02dr%d", c, r);
      const double azimuth = 2 * kPi * c / kColumns;
      const Eigen::Vector3d center(kRadius_m * std::cos(azimuth), kRadius_m * std::sin(azimuth),
                                   0.4 + 0.7 * r);
      Eigen::Matrix3d rotation;  // rows: x right, y down, z forward, in the rig frame
      rotation.row(2) = -Eigen::Vector3d(std::cos(azimuth), std::sin(azimuth), 0);
      rotation.row(1) = -Eigen::Vector3d::UnitZ();
      rotation.row(0) = rotation.row(1).cross(rotation.row(2));
      CalibratedCamera& camera = calibration.cameras.emplace_back();
      camera.camera = name;
      camera.intrinsics = {CameraModel::kPinhole, 1200, 1600, {1600, 1600, 600, 800}};
      camera.cam_from_rig.rotation = rotation;
      camera.cam_from_rig.translation = -rotation * center;
      camera.sigma = PoseSigma{0.01, 0.2, 0.5};
    }
  }
  return calibration;
}

FrameSet SetOf(const Calibration& calibration, const std::string& id) {
  FrameSet set;
  set.id = id;
  for (const CalibratedCamera& camera : calibration.cameras) {
    set.frames.emplace_back().camera = camera.camera;
  }
  return set;
}

/// The rig in a reconstruction: in a frame and scale of its own, with noise, one camera elsewhere,
/// and one without a pose.
struct Shake {
  std::string moved_camera;
  Eigen::Vector3d moved_m = Eigen::Vector3d::Zero();
  uint32_t seed = 1;
  double turned_deg = 0;  // the moved camera, about its axis of sight
  std::string lost_camera = "";
};
sfm::Reconstruction Reconstruct(const Calibration& calibration, const Shake& shake) {
  std::mt19937 random(shake.seed);
  std::normal_distribution<double> normal;
  const auto noise = [&](double sigma) {
    return Eigen::Vector3d(sigma * Eigen::Vector3d(normal(random), normal(random), normal(random)) /
                           std::sqrt(3.0));
  };
  const Sim3 model_from_rig{
      3.7, Eigen::Quaterniond(Eigen::AngleAxisd(1.0, Eigen::Vector3d(1, 2, 3).normalized())),
      Eigen::Vector3d(1, -2, 0.5)};
  sfm::Reconstruction reconstruction;
  for (const CalibratedCamera& camera : calibration.cameras) {
    Eigen::Vector3d center = camera.cam_from_rig.OriginInSource() + noise(1e-3 * kPosition_mm);
    Eigen::Vector3d turn = noise(RadFromDeg(kRotation_deg));
    if (camera.camera == shake.moved_camera) {
      center += shake.moved_m;
      turn.z() += RadFromDeg(shake.turned_deg);
    }
    if (camera.camera == shake.lost_camera) {
      reconstruction.cam_from_model.emplace_back();
      continue;
    }
    Rigid3 pose;
    pose.rotation =
        Eigen::AngleAxisd(turn.norm(), turn.normalized()) * camera.cam_from_rig.rotation;
    pose.translation = -(pose.rotation * center);
    reconstruction.cam_from_model.emplace_back(TransformPose(model_from_rig, pose));
  }
  return reconstruction;
}

/// poses.json as the pipeline would write it for pictures that are sure.
PoseSet PosesOf(const Calibration& calibration, const std::string& capture, const Shake& shake) {
  const sfm::Reconstruction model = Reconstruct(calibration, shake);
  const FrameSet set = SetOf(calibration, capture);
  sfm::PoseCovariances covariances;
  covariances.images.resize(set.frames.size());
  const auto alignment = sfm::AlignToCalibration(model, set, calibration, covariances, shake.seed);
  if (!alignment) throw std::runtime_error(alignment.error().ToString());
  PoseSet poses;
  poses.frameset = capture;
  poses.method = "tc-sfm";
  poses.summary.registered = poses.summary.of = set.frames.size();
  poses.summary.verdict = poses.summary.verdict_of_pictures = "sure";
  poses.summary.verdict_reason = "synthetic";
  for (size_t i = 0; i < set.frames.size(); ++i) {
    CameraPose& pose = poses.cameras.emplace_back();
    pose.camera = set.frames[i].camera;
    pose.registered = model.cam_from_model[i].has_value();
    if (!pose.registered) {
      pose.reason = "3 inliers, expected 30";
      continue;
    }
    pose.intrinsics = calibration.cameras[i].intrinsics;
    pose.cam_from_rig = TransformPose(alignment->rig_from_model, *model.cam_from_model[i]);
    pose.sigma = PoseSigma{kRotation_deg, kPosition_mm, std::nullopt};
  }
  sfm::AddCalibrationFigures(*alignment, calibration, poses);
  return poses;
}

/// A store with a calibration in force, and captures with poses.
class DriftTest : public ::testing::Test {
 protected:
  DriftTest() : calibration_(RingCalibration()) {
    calibration_.id = "ring";
    test::WriteCalibrationFolder(store().CalibrationFolder("ring"), calibration_);
    EXPECT_TRUE(RecordCalibration(store(), "ring").ok());
    EXPECT_TRUE(ActivateCalibration(store(), "ring").ok());
  }
  Store& store() { return state_.store(); }

  void Capture(int number) {
    char time[40];
    std::snprintf(time, sizeof(time), "2026-01-01T10:%02d:00.000Z", number);
    const std::string id = Name(number);
    test::WriteTinyFrameSet(store().CaptureFolder(id), time);
    ASSERT_TRUE(RecordCapture(store(), id, std::nullopt).ok());
  }
  ReconstructionRecord Record(int number, const PoseSet& poses, const std::string& suffix = "-r1",
                              std::chrono::seconds age = {}) {
    const std::string id = Name(number) + suffix;
    const auto folder = store().ReconstructionFolder(id);
    std::filesystem::create_directories(folder);
    const auto file = folder / "poses.json";
    EXPECT_TRUE(WriteNewFile(file, PoseSetToJson(poses)));
    std::filesystem::last_write_time(file, std::filesystem::last_write_time(file) - age);
    const auto record = RecordReconstruction(store(), id);
    EXPECT_TRUE(record.ok()) << record.error().ToString();
    return *record;
  }
  static std::string Name(int number) { return "x" + std::to_string(number); }
  std::vector<EventRecord> EventsOf(const std::string& kind) {
    std::vector<EventRecord> chosen;
    const auto events = ListEvents(store(), 0, 10000);
    for (const EventRecord& event : *events) {
      if (event.kind == kind) chosen.push_back(event);
    }
    return chosen;
  }
  std::vector<std::string> UnregisteredCameras() {
    std::vector<std::string> names;
    const auto cameras = UnregisteredNow(store());
    for (const UnregisteredCamera& camera : *cameras) names.push_back(camera.latest.camera);
    return names;
  }
  std::vector<std::string> MovedCameras() {
    std::vector<std::string> moved;
    const auto drifts = DriftNow(store());
    for (const CameraDrift& drift : *drifts) {
      if (drift.moved) moved.push_back(drift.latest.camera);
    }
    return moved;
  }

  DaemonState state_;
  Calibration calibration_;
};

TEST_F(DriftTest, ACameraThatMovedBy20mmAtTheFifthCaptureIsNamedAtTheSixth) {
  for (int number = 1; number <= 10; ++number) {
    Shake shake;
    shake.seed = static_cast<uint32_t>(number);
    if (number >= 5) {
      shake.moved_camera = "c03r1";
      shake.moved_m = {0.012, 0, 0.016};
    }
    Capture(number);
    const auto record = Record(number, PosesOf(calibration_, Name(number), shake));
    EXPECT_TRUE(record.used_for_drift);
    const auto expected =
        number < 6 ? std::vector<std::string>() : std::vector<std::string>{"c03r1"};
    EXPECT_EQ(MovedCameras(), expected) << "after capture " << number;
  }
  const auto events = EventsOf("camera_moved");
  ASSERT_EQ(events.size(), 1u);
  EXPECT_EQ(events[0].about, "c03r1");
  EXPECT_NE(events[0].data.find("\"capture\":\"x6\""), std::string::npos) << events[0].data;

  const auto drifts = DriftNow(store());
  ASSERT_EQ(drifts->size(), static_cast<size_t>(kColumns * kRows));
  for (const CameraDrift& drift : *drifts) {
    EXPECT_EQ(drift.captures, 10u);
    EXPECT_NEAR(*drift.latest.position_sigma_mm, std::hypot(0.2, kPosition_mm), 1e-9);
    EXPECT_NEAR(*drift.latest.rotation_sigma_deg, std::hypot(0.01, kRotation_deg), 1e-9);
    const bool is_moved = drift.latest.camera == "c03r1";
    EXPECT_EQ(drift.beyond, is_moved ? 6u : 0u);
    EXPECT_NEAR(drift.latest.position_mm, is_moved ? 20 : 0, 5 * kPosition_mm);
  }
  const auto history = DriftHistory(store(), "c03r1", {4, ""});
  ASSERT_EQ(history->items.size(), 4u);
  EXPECT_EQ(history->items[0].capture, "x10");
  const auto older = DriftHistory(store(), "c03r1", {50, history->next});
  ASSERT_EQ(older->items.size(), 6u);
  EXPECT_TRUE(older->items[1].beyond_limit) << older->items[1].capture;
  EXPECT_FALSE(older->items[2].beyond_limit) << older->items[2].capture;
}

TEST_F(DriftTest, ACameraThatIsPutBackOrCalibratedAnewIsNotNamedAnyMore) {
  const Shake moved{"c01r0", {0, 0.01, 0}, 3};
  for (int number = 1; number <= 2; ++number) {
    Capture(number);
    Record(number, PosesOf(calibration_, Name(number), moved));
  }
  EXPECT_EQ(MovedCameras(), std::vector<std::string>{"c01r0"});
  Capture(3);
  Record(3, PosesOf(calibration_, "x3", {}));
  EXPECT_TRUE(MovedCameras().empty());
  ASSERT_EQ(EventsOf("camera_back").size(), 1u);
  EXPECT_EQ(EventsOf("camera_back")[0].about, "c01r0");

  for (int number = 4; number <= 5; ++number) {
    Capture(number);
    Record(number, PosesOf(calibration_, Name(number), moved));
  }
  EXPECT_EQ(MovedCameras(), std::vector<std::string>{"c01r0"});
  test::WriteCalibrationFolder(store().CalibrationFolder("anew"), calibration_);
  ASSERT_TRUE(RecordCalibration(store(), "anew").ok());
  ASSERT_TRUE(ActivateCalibration(store(), "anew").ok());
  EXPECT_TRUE(DriftNow(store())->empty());
}

TEST_F(DriftTest, FoldedAndUnsureResultsAreMarkedAndNeverUsed) {
  const Shake moved{"c01r0", {0, 0.5, 0}, 3};
  PoseSet unsure = PosesOf(calibration_, "x1", moved);
  unsure.summary.verdict = unsure.summary.verdict_of_pictures = "unsure";
  PoseSet folded = PosesOf(calibration_, "x2", moved);
  folded.summary.verdict = folded.summary.verdict_of_pictures = "folded";
  folded.summary.folded = true;
  PoseSet plain = PosesOf(calibration_, "x3", moved);
  plain.summary.verdict.clear();
  plain.summary.verdict_of_pictures.clear();
  plain.summary.verdict_reason.clear();
  PoseSet adrift = PosesOf(calibration_, "x4", moved);
  adrift.metric = false;
  adrift.aligned_to.reset();
  int number = 0;
  for (const PoseSet* poses : {&unsure, &folded, &plain, &adrift}) {
    Capture(++number);
    const auto record = Record(number, *poses);
    EXPECT_FALSE(record.used_for_drift) << number;
    EXPECT_EQ(record.verdict, poses->summary.verdict);
    EXPECT_EQ(FindCapture(store(), Name(number))->verdict, poses->summary.verdict);
  }
  EXPECT_TRUE(DriftNow(store())->empty());
  EXPECT_TRUE(EventsOf("camera_moved").empty());
}

/// The calibration has helped to place the cameras: to compare them with it would be circular.
TEST_F(DriftTest, PosesThatHadTheCalibrationAsPriorSayNothingOfDrift) {
  const Shake moved{"c01r0", {0, 0.02, 0}, 3, 0, "c04r2"};
  for (int number = 1; number <= 3; ++number) {
    PoseSet poses = PosesOf(calibration_, Name(number), moved);
    poses.summary.verdict = "sure";
    poses.summary.verdict_of_pictures.clear();
    poses.options["prior"] = "calibration";
    Capture(number);
    const auto record = Record(number, poses);
    EXPECT_FALSE(record.used_for_drift);
    EXPECT_EQ(record.prior, "calibration");
    EXPECT_EQ(record.verdict, "sure");
  }
  EXPECT_TRUE(DriftNow(store())->empty());
  EXPECT_TRUE(UnregisteredCameras().empty());
  EXPECT_TRUE(EventsOf("camera_moved").empty());

  // What a capture's own pictures said of it stays.
  Record(1, PosesOf(calibration_, "x1", moved), "-r2");
  PoseSet again = PosesOf(calibration_, "x1", {});
  again.options["prior"] = "calibration";
  Record(1, again, "-r3");
  const auto drift = DriftHistory(store(), "c01r0", {50, ""});
  ASSERT_EQ(drift->items.size(), 1u);
  EXPECT_EQ(drift->items[0].reconstruction, "x1-r2");
}

/// As when a full disk kept its row out, and a start adopts its folder after another was made.
TEST_F(DriftTest, AnOlderReconstructionThatIsRecordedLaterDoesNotReplaceWhatTheNewestSaid) {
  const Shake moved{"c01r0", {0, 0.5, 0}, 3};
  Capture(1);
  Record(1, PosesOf(calibration_, "x1", {}), "-r2");
  Record(1, PosesOf(calibration_, "x1", moved), "-r1", std::chrono::years(5));
  EXPECT_EQ(FindCapture(store(), "x1")->reconstruction, "x1-r2");
  const auto drift = DriftHistory(store(), "c01r0", {50, ""});
  ASSERT_EQ(drift->items.size(), 1u);
  EXPECT_EQ(drift->items[0].reconstruction, "x1-r2");
  EXPECT_TRUE(EventsOf("camera_moved").empty());
}

/// Nothing but the ring that the preset rig asks for shows some folds.
TEST_F(DriftTest, OnlyPosesOfThePresetRigSpeakOfDrift) {
  const Shake moved{"c01r0", {0, 0.02, 0}, 3, 0, "c04r2"};
  int number = 0;
  for (const char* preset : {"internet", "literal"}) {
    for (int repeat = 0; repeat < 2; ++repeat) {
      PoseSet poses = PosesOf(calibration_, Name(++number), moved);
      poses.options["preset"] = preset;
      Capture(number);
      EXPECT_FALSE(Record(number, poses).used_for_drift) << preset;
    }
  }
  EXPECT_TRUE(DriftNow(store())->empty());
  EXPECT_TRUE(UnregisteredCameras().empty());
  EXPECT_TRUE(EventsOf("camera_moved").empty());
  for (int repeat = 0; repeat < 2; ++repeat) {
    PoseSet poses = PosesOf(calibration_, Name(++number), moved);
    poses.options["preset"] = "rig";
    Capture(number);
    EXPECT_TRUE(Record(number, poses).used_for_drift);
  }
  EXPECT_EQ(MovedCameras(), std::vector<std::string>{"c01r0"});
}

TEST_F(DriftTest, ACameraThatWasKnockedFarIsNamedAndTheOthersStayWatched) {
  const Shake moved{"c02r1", {0.4, 0.5, 0}, 3}, turned{"c07r0", {0, 0, 0}, 4, 15.0};
  int number = 0;
  for (const Shake& shake : {moved, turned}) {
    for (int repeat = 0; repeat < 2; ++repeat) {
      Capture(++number);
      const auto record = Record(number, PosesOf(calibration_, Name(number), shake));
      EXPECT_EQ(record.verdict, "unsure") << shake.moved_camera;
      EXPECT_TRUE(record.used_for_drift) << shake.moved_camera;
    }
    EXPECT_EQ(MovedCameras(), std::vector<std::string>{shake.moved_camera});
  }
  EXPECT_EQ(EventsOf("camera_moved").size(), 2u);
  const auto drifts = DriftNow(store());
  for (const CameraDrift& drift : *drifts) {
    EXPECT_EQ(drift.captures, 4u) << drift.latest.camera;
    EXPECT_EQ(drift.latest.beyond_limit, drift.latest.camera == "c07r0") << drift.latest.camera;
  }
}

TEST_F(DriftTest, ARigThatStandsElsewhereAsAWholeNamesNoCamera) {
  PoseSet poses = PosesOf(calibration_, "x1", {});
  for (size_t i = 0; i < poses.cameras.size() / 2; ++i) {
    poses.cameras[i].vs_calibration->far_off = true;
  }
  EXPECT_FALSE(MaySpeakOfDrift(poses));
  poses.cameras[0].vs_calibration->far_off = false;
  EXPECT_TRUE(MaySpeakOfDrift(poses));
  for (size_t i = 0; i < poses.cameras.size() / 2; ++i) {
    poses.cameras[i].vs_calibration->sigmas = sfm::kMovedSigmas + 0.1;
  }
  EXPECT_FALSE(MaySpeakOfDrift(poses));
}

TEST_F(DriftTest, ACameraWithoutAPoseInTwoCapturesIsNamedUntilItHasOne) {
  const Shake lost{"", {0, 0, 0}, 5, 0, "c04r2"};
  Capture(1);
  Record(1, PosesOf(calibration_, "x1", lost), "-r1");
  Record(1, PosesOf(calibration_, "x1", lost), "-r2");
  EXPECT_TRUE(UnregisteredCameras().empty()) << "one capture, not two";
  Capture(2);
  PoseSet unsure = PosesOf(calibration_, "x2", lost);
  unsure.summary.verdict = unsure.summary.verdict_of_pictures = "unsure";
  Record(2, unsure);
  EXPECT_TRUE(UnregisteredCameras().empty()) << "what is not sure says nothing";
  Capture(3);
  Record(3, PosesOf(calibration_, "x3", lost));
  EXPECT_EQ(UnregisteredCameras(), std::vector<std::string>{"c04r2"});
  const auto cameras = UnregisteredNow(store());
  EXPECT_EQ(cameras->at(0).captures, 2u);
  EXPECT_EQ(cameras->at(0).latest.capture, "x3");
  EXPECT_EQ(cameras->at(0).latest.reason, "3 inliers, expected 30");
  ASSERT_EQ(EventsOf("camera_unregistered").size(), 1u);
  EXPECT_EQ(EventsOf("camera_unregistered")[0].about, "c04r2");

  Capture(4);
  Record(4, PosesOf(calibration_, "x4", {}));
  EXPECT_TRUE(UnregisteredCameras().empty());
  ASSERT_EQ(EventsOf("camera_registered").size(), 1u);
  EXPECT_EQ(EventsOf("camera_registered")[0].about, "c04r2");
  Record(1, PosesOf(calibration_, "x1", lost), "-r3");
  Record(3, PosesOf(calibration_, "x3", lost), "-r2");
  EXPECT_TRUE(UnregisteredCameras().empty()) << "a newer capture has its pose";
}

TEST_F(DriftTest, ACaptureThatIsReconstructedTwiceCountsOnce) {
  Capture(1);
  const PoseSet moved = PosesOf(calibration_, "x1", {"c01r0", {0, 0.02, 0}, 3});
  Record(1, moved, "-r1");
  Record(1, moved, "-r2");
  EXPECT_TRUE(MovedCameras().empty()) << "one capture, not two";
  const auto drifts = DriftNow(store());
  for (const CameraDrift& drift : *drifts) EXPECT_EQ(drift.captures, 1u);
  EXPECT_EQ(ListReconstructions(store(), "x1")->size(), 2u);
  EXPECT_EQ(FindCapture(store(), "x1")->reconstruction, "x1-r2");
}

TEST_F(DriftTest, TheHistoryIsPagedAlsoWhereACaptureWasComparedTwice) {
  Calibration other = calibration_;
  other.id = "other";
  std::vector<std::string> expected;
  for (int number = 1; number <= 3; ++number) {
    Capture(number);
    Record(number, PosesOf(calibration_, Name(number), {}), "-r1");
    Record(number, PosesOf(other, Name(number), {}), "-r2");
    expected.insert(expected.begin(), {Name(number) + "-r1", Name(number) + "-r2"});
  }
  for (const size_t limit : {1, 2, 5}) {
    std::vector<std::string> seen;
    std::string after;
    do {
      const auto page = DriftHistory(store(), "c00r0", {limit, after});
      ASSERT_TRUE(page.ok()) << page.error().ToString();
      for (const DriftRecord& drift : page->items) seen.push_back(drift.reconstruction);
      after = page->next;
    } while (!after.empty());
    EXPECT_EQ(seen, expected) << limit << " at a time";
  }
  EXPECT_EQ(DriftHistory(store(), "c00r0", {1, "unknown"}).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(DriftHistory(store(), "nobody", {1, "x1-r1"}).error().code, ErrorCode::kNotFound);
}

TEST_F(DriftTest, ALaterResultThatIsNotSureDoesNotHideOneThatIs) {
  Capture(1);
  PoseSet poses = PosesOf(calibration_, "x1", {});
  poses.summary.verdict = "unsure";
  Record(1, poses, "-r1");
  EXPECT_EQ(FindCapture(store(), "x1")->reconstruction, "x1-r1") << "better than none";
  poses.summary.verdict = "sure";
  Record(1, poses, "-r2");
  poses.summary.verdict.clear();  // as the plain method's
  Record(1, poses, "-r3");
  const auto capture = FindCapture(store(), "x1");
  EXPECT_EQ(capture->reconstruction, "x1-r2");
  EXPECT_EQ(capture->verdict, "sure");
  EXPECT_EQ(ListCaptures(store(), {})->items[0].reconstruction, "x1-r2");
}

TEST_F(DriftTest, AResultThatDoesNotSpeakOfTheRigStandsBackForOneThatDoes) {
  int number = 0;
  for (const char* option : {"prior", "preset"}) {
    const bool is_prior = std::string(option) == "prior";
    Capture(++number);
    PoseSet rig = PosesOf(calibration_, Name(number), {});
    rig.options["preset"] = "rig";
    PoseSet other = rig;
    other.options[option] = is_prior ? "calibration" : "internet";
    const auto speaker = [&] { return FindCapture(store(), Name(number))->reconstruction; };
    const auto speaker_of_the_rig = [&] {
      return ListCaptures(store(), {}, Speakers::kOfTheRig)->items[0].reconstruction;
    };
    const auto made = Record(number, other, "-r1");
    EXPECT_EQ(made.preset, is_prior ? "rig" : "internet");
    EXPECT_EQ(made.prior, is_prior ? "calibration" : "none");
    EXPECT_EQ(speaker(), Name(number) + "-r1");
    EXPECT_EQ(speaker_of_the_rig(), std::nullopt) << option;
    rig.summary.verdict = rig.summary.verdict_of_pictures = "unsure";
    Record(number, rig, "-r2");
    EXPECT_EQ(speaker(), Name(number) + "-r1") << "sure of something else, or not sure";
    EXPECT_EQ(speaker_of_the_rig(), Name(number) + "-r2") << option;
    rig.summary.verdict = rig.summary.verdict_of_pictures = "sure";
    Record(number, rig, "-r3");
    Record(number, other, "-r4");
    EXPECT_EQ(speaker(), Name(number) + "-r3")
        << "sure of the rig, though " << option << " is newer";
    EXPECT_EQ(ListCaptures(store(), {})->items[0].reconstruction, Name(number) + "-r3");
  }
}

/// The plain method has no preset; nor has a result of before there was a choice.
TEST_F(DriftTest, AResultWithoutAPresetSpeaksOfTheRig) {
  Capture(1);
  PoseSet poses = PosesOf(calibration_, "x1", {});
  const auto made = Record(1, poses, "-r1");
  EXPECT_EQ(made.preset, "");
  EXPECT_TRUE(made.used_for_drift);
  poses.options["preset"] = "internet";
  Record(1, poses, "-r2");
  EXPECT_EQ(FindCapture(store(), "x1")->reconstruction, "x1-r1");
}

TEST(DriftLimitsTest, NeedBothSignificanceAndSize) {
  Calibration calibration;
  PoseSet poses;
  poses.metric = true;
  poses.aligned_to = "any";
  poses.summary.verdict = "sure";
  const auto add = [&](const char* name, VsCalibration change) {
    CameraPose& pose = poses.cameras.emplace_back();
    pose.camera = name;
    pose.registered = true;
    pose.vs_calibration = change;
  };
  add("far, not significant", {0.0, 9.0, false, std::nullopt});
  add("far", {0.0, 2.6, true, std::nullopt});
  add("near", {0.06, 2.4, true, std::nullopt});
  add("swapped", {0.0, 0.1, false, "far"});
  add("turned", {0.08, 0.1, true, std::nullopt});
  const std::vector<DriftRecord> drift = DriftOf(poses, calibration, {});
  ASSERT_EQ(drift.size(), 5u);
  EXPECT_FALSE(drift[0].beyond_limit);
  EXPECT_TRUE(drift[1].beyond_limit);
  EXPECT_FALSE(drift[2].beyond_limit);
  EXPECT_TRUE(drift[3].beyond_limit);
  EXPECT_EQ(drift[3].swapped_with, "far");
  EXPECT_TRUE(drift[4].beyond_limit);
  EXPECT_FALSE(drift[0].position_sigma_mm.has_value());
}

}  // namespace
}  // namespace rotunda::daemon
