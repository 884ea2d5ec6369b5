#include "sfm/core/pose_set.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "sfm/core/file_io.h"
#include "tests/support/process.h"

namespace rotunda {
namespace {

using nlohmann::json;

PoseSet MakePoses() {
  PoseSet poses;
  poses.frameset = "shot-1";
  poses.method = "plain";
  poses.options = {{"pairs", "exhaustive"}};
  poses.metric = true;
  poses.aligned_to = "cal-7";
  CameraPose camera;
  camera.camera = "a";
  camera.registered = true;
  camera.intrinsics = {CameraModel::kPinhole, 1200, 1600, {1840, 1841, 600, 800}};
  camera.cam_from_rig = {Eigen::Quaterniond(Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitZ())),
                         {0.1, 0.2, 0.3}};
  camera.sigma = PoseSigma{0.01, 0.5, 0.2};
  camera.side = "front";
  camera.segments = {3, 1, 4294967295};
  camera.observations = 812;
  camera.rms_px = 0.61;
  camera.vs_calibration = VsCalibration{0.02, 0.7, false};
  poses.cameras.push_back(camera);
  CameraPose lost;
  lost.camera = "b";
  lost.reason = "12 inliers, expected 30";
  poses.cameras.push_back(lost);
  poses.segments = {{7, 2, true, "back", 120, 9, {4, 7}}};
  poses.summary.registered = 1;
  poses.summary.of = 2;
  poses.summary.rms_px = 0.61;
  poses.summary.mean_reprojection_px = 0.5;
  poses.summary.points = 300;
  poses.summary.mean_rotation_deg = 0.02;
  poses.summary.mean_position_mm = 0.7;
  poses.summary.ambiguous_communities = 1;
  return poses;
}

TEST(PoseSet, ReadsWhatItWrites) {
  const PoseSet poses = MakePoses();
  const auto read = PoseSetFromJson(PoseSetToJson(poses), "text");
  ASSERT_TRUE(read.ok()) << read.error().ToString();
  EXPECT_EQ(PoseSetToJson(*read), PoseSetToJson(poses));
  const CameraPose& camera = read->cameras[0];
  EXPECT_EQ(camera.segments, poses.cameras[0].segments);
  EXPECT_EQ(camera.intrinsics.params, poses.cameras[0].intrinsics.params);
  EXPECT_TRUE(camera.cam_from_rig.translation == poses.cameras[0].cam_from_rig.translation);
  EXPECT_EQ(camera.sigma->focal_px, 0.2);
  EXPECT_FALSE(camera.vs_calibration->moved);
  EXPECT_FALSE(read->cameras[1].registered);
  EXPECT_EQ(read->cameras[1].reason, "12 inliers, expected 30");
  EXPECT_TRUE(read->metric);
  EXPECT_EQ(read->aligned_to, "cal-7");
  EXPECT_EQ(read->segments[0].side, "back");
  EXPECT_EQ(read->segments[0].look_alikes, (std::vector<uint32_t>{4, 7}));
  EXPECT_EQ(read->summary.models, 1u);
}

TEST(PoseSet, KeepsWhosePlaceASwappedCameraHas) {
  PoseSet poses = MakePoses();
  EXPECT_EQ(PoseSetToJson(poses).find("swapped_with"), std::string::npos);
  poses.cameras[0].vs_calibration->swapped_with = "b";
  const std::string text = PoseSetToJson(poses);
  EXPECT_EQ(json::parse(text)["cameras"][0]["vs_calibration"]["swapped_with"], "b");
  const auto read = PoseSetFromJson(text, "text");
  ASSERT_TRUE(read.ok()) << read.error().ToString();
  EXPECT_EQ(read->cameras[0].vs_calibration->swapped_with, "b");
  EXPECT_EQ(PoseSetToJson(*read), text);
}

TEST(PoseSet, KeepsThatACameraIsOnTheWrongSide) {
  PoseSet poses = MakePoses();
  EXPECT_EQ(PoseSetToJson(poses).find("wrong_side"), std::string::npos);
  poses.cameras[0].vs_calibration->wrong_side = true;
  const std::string text = PoseSetToJson(poses);
  const auto read = PoseSetFromJson(text, "text");
  ASSERT_TRUE(read.ok()) << read.error().ToString();
  EXPECT_TRUE(read->cameras[0].vs_calibration->wrong_side);
  EXPECT_EQ(PoseSetToJson(*read), text);
}

TEST(PoseSet, KeepsThatACameraIsFarOff) {
  PoseSet poses = MakePoses();
  EXPECT_EQ(PoseSetToJson(poses).find("far_off"), std::string::npos);
  poses.cameras[0].vs_calibration->far_off = true;
  const std::string text = PoseSetToJson(poses);
  const auto read = PoseSetFromJson(text, "text");
  ASSERT_TRUE(read.ok()) << read.error().ToString();
  EXPECT_TRUE(read->cameras[0].vs_calibration->far_off);
  EXPECT_EQ(PoseSetToJson(*read), text);
}

TEST(PoseSet, KeepsWhatWasFoundOfACamera) {
  PoseSet poses = MakePoses();
  EXPECT_EQ(PoseSetToJson(poses).find("evidence"), std::string::npos);
  poses.cameras[0].evidence = PoseEvidence{41.5, OtherPose{179.5, 230.25, -228.5}, true, true};
  const std::string text = PoseSetToJson(poses);
  const json evidence = json::parse(text)["cameras"][0]["evidence"];
  EXPECT_EQ(evidence["certainty"], 41.5);
  EXPECT_EQ(evidence["other_pose"],
            (json{{"rotation_deg", 179.5}, {"against", 230.25}, {"in_favour", -228.5}}));
  EXPECT_EQ(evidence["doubtful"], true);
  EXPECT_EQ(evidence["late"], true);
  const auto read = PoseSetFromJson(text, "text");
  ASSERT_TRUE(read.ok()) << read.error().ToString();
  EXPECT_EQ(PoseSetToJson(*read), text);
  poses.cameras[0].evidence = PoseEvidence{};
  const json nothing = json::parse(PoseSetToJson(poses))["cameras"][0]["evidence"];
  EXPECT_EQ(nothing, (json{{"doubtful", false}, {"late", false}})) << "nothing to tell apart";
}

TEST(PoseSet, KeepsWhatThePicturesSaidBesideTheVerdict) {
  PoseSet poses = MakePoses();
  poses.summary.view_graph_margin = 0.75;
  EXPECT_EQ(PoseSetToJson(poses).find("verdict_of_pictures"), std::string::npos);
  poses.summary.verdict = "unsure";
  poses.summary.verdict_of_pictures = "sure";
  const std::string text = PoseSetToJson(poses);
  const auto read = PoseSetFromJson(text, "text");
  ASSERT_TRUE(read.ok()) << read.error().ToString();
  EXPECT_EQ(read->summary.verdict, "unsure");
  EXPECT_EQ(read->summary.verdict_of_pictures, "sure");
  EXPECT_EQ(read->summary.view_graph_margin, 0.75);
  json wrong = json::parse(text);
  wrong["summary"]["verdict_of_pictures"] = "perhaps";
  EXPECT_FALSE(PoseSetFromJson(wrong.dump(), "text").ok());
}

TEST(PoseSet, NamesCalibratedCamerasWithoutAFrame) {
  Calibration calibration;
  for (const char* name : {"z", "a", "c"}) calibration.cameras.emplace_back().camera = name;
  EXPECT_EQ(CamerasWithoutFrame(calibration, MakePoses().cameras),
            (std::vector<std::string>{"z", "c"}));
}

TEST(PoseSet, GivesTheCentreInMillimetres) {
  const json text = json::parse(PoseSetToJson(MakePoses()));
  const Eigen::Vector3d centre = MakePoses().cameras[0].cam_from_rig.OriginInSource();
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_DOUBLE_EQ(text["cameras"][0]["position_mm"][axis], 1000 * centre[axis]);
  }
}

TEST(PoseSet, InventsNothingForALostCamera) {
  PoseSet poses = MakePoses();
  EXPECT_EQ(json::parse(PoseSetToJson(poses))["cameras"][1],
            json({{"camera", "b"}, {"registered", false}, {"reason", "12 inliers, expected 30"}}));
  poses.cameras[1].intrinsics = poses.cameras[0].intrinsics;
  const auto read = PoseSetFromJson(PoseSetToJson(poses), "text");
  ASSERT_TRUE(read.ok()) << read.error().ToString();
  EXPECT_EQ(read->cameras[1].intrinsics.params, poses.cameras[0].intrinsics.params);
}

TEST(PoseSet, LeavesOutWhatIsNotKnown) {
  PoseSet poses = MakePoses();
  poses.metric = false;
  poses.aligned_to.reset();
  poses.summary.mean_rotation_deg.reset();
  poses.summary.mean_position_mm.reset();
  poses.cameras[0].sigma.reset();
  poses.cameras[0].vs_calibration.reset();
  poses.cameras[0].side.clear();
  poses.segments[0].side.clear();
  const std::string text = PoseSetToJson(poses);
  for (const char* key :
       {"\"aligned_to\"", "\"mean_rotation_deg\"", "\"sigma\"", "\"vs_calibration\"", "\"side\""}) {
    EXPECT_EQ(text.find(key), std::string::npos) << key;
  }
  const auto read = PoseSetFromJson(text, "text");
  ASSERT_TRUE(read.ok()) << read.error().ToString();
  EXPECT_EQ(PoseSetToJson(*read), text);
}

TEST(PoseSet, ReadsFiles) {
  const test::TemporaryFolder folder;
  ASSERT_TRUE(WriteFileAtomically(folder / "poses.json", PoseSetToJson(MakePoses())).ok());
  EXPECT_TRUE(ReadPoseSet(folder / "poses.json").ok());
  EXPECT_EQ(ReadPoseSet(folder / "none.json").error().code, ErrorCode::kNotFound);
}

struct BadField {
  const char* pointer;
  json value;
  const char* error;
};

TEST(PoseSet, NamesTheFieldWhatWasFoundAndWhatWasExpected) {
  const std::vector<BadField> table = {
      {"/format", "rotunda-calibration/1",
       "format: expected \"rotunda-poses/1\", found \"rotunda-calibration/1\""},
      {"/scale", "feet", "scale: expected \"metric\" or \"arbitrary\", found \"feet\""},
      {"/cameras/0/registered", "yes",
       "cameras[0].registered: expected true or false, found \"yes\""},
      {"/cameras/0/segments/1", 4294967296,
       "cameras[0].segments[1]: expected an integer from 0 to 4294967295, found 4294967296"},
      {"/cameras/0/side", "top",
       "cameras[0].side: expected \"front\", \"back\", \"left\" or \"right\", found \"top\""},
      {"/cameras/0/vs_calibration/swapped_with", "",
       "cameras[0].vs_calibration.swapped_with: expected a camera's name, found \"\""},
      {"/cameras/0/vs_calibration",
       {{"rotation_deg", 1}, {"position_mm", 2}, {"moved", true}, {"wrong_side", true}},
       "cameras[0].vs_calibration.moved: expected false for a camera on the wrong side, found "
       "true"},
      {"/cameras/1/camera", "a", "cameras[1].camera: camera \"a\" is already cameras[0]"},
      {"/cameras/1/reason", nullptr, "cameras[1].reason: expected a string, found null"},
      {"/segments/0/tracks", -1, "segments[0].tracks: expected an integer >= 0, found -1"},
      {"/summary/folded", 0, "summary.folded: expected true or false, found 0"},
      {"/options/pairs", 1, "options.pairs: expected a string, found 1"},
  };
  for (const BadField& bad : table) {
    json text = json::parse(PoseSetToJson(MakePoses()));
    text[json::json_pointer(bad.pointer)] = bad.value;
    const auto read = PoseSetFromJson(text.dump(), "poses.json");
    ASSERT_FALSE(read.ok()) << bad.error;
    EXPECT_EQ(read.error().ToString(), std::string("poses.json: ") + bad.error);
  }
}

}  // namespace
}  // namespace rotunda
