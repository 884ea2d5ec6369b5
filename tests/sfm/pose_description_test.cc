#include "sfm/pose_description.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

using test::MakeSyntheticWorld;
using test::SyntheticWorld;
using test::TrueReconstruction;

FrameSet FramesOf(const SyntheticWorld& world) {
  FrameSet set;
  set.id = "shot-7";
  for (size_t i = 0; i < world.cam_from_world.size(); ++i) {
    set.frames.emplace_back().camera = "c" + std::to_string(100 + i);
  }
  return set;
}

TEST(DescribePoses, SaysOfEveryCameraWhereItIsOrWhyItIsNotThere) {
  const SyntheticWorld world = MakeSyntheticWorld({});
  const size_t images = world.cam_from_world.size();
  IncrementalResult models;
  models.models.resize(2);
  Reconstruction& model = models.models[0] = TrueReconstruction(world);
  const ImageId refused(3), in_the_other(5);
  for (const ImageId image : {refused, in_the_other}) model.cam_from_model[image.index()].reset();
  models.unregistered = {{refused, "12 inliers, expected 30"}};

  const PoseSet poses = DescribePoses(FramesOf(world), models, model, world.features);
  EXPECT_EQ(poses.frameset, "shot-7");
  EXPECT_EQ(poses.summary.of, images);
  EXPECT_EQ(poses.summary.registered, images - 2);
  EXPECT_EQ(poses.summary.models, 2u);
  EXPECT_EQ(poses.summary.points, model.points.size());
  EXPECT_FALSE(poses.summary.folded.has_value());
  EXPECT_EQ(poses.summary.verdict, "");
  // 0.5 px an axis for keypoints of the smallest scale.
  EXPECT_GT(poses.summary.rms_px, 0.5);
  EXPECT_LT(poses.summary.rms_px, 2.0);
  ASSERT_EQ(poses.cameras.size(), images);
  for (size_t i = 0; i < images; ++i) {
    const CameraPose& camera = poses.cameras[i];
    EXPECT_EQ(camera.camera, "c" + std::to_string(100 + i));
    EXPECT_EQ(camera.registered, model.Registered(ImageId(i)));
    EXPECT_EQ(camera.intrinsics.params, world.intrinsics.of(ImageId(i)).params);
    if (!camera.registered) continue;
    EXPECT_EQ(camera.reason, "");
    EXPECT_EQ(camera.cam_from_rig.Matrix(), world.cam_from_world[i].Matrix());
    size_t observations = 0;
    for (const Point3& point : model.points) {
      for (const Observation& seen : point.observations) observations += seen.image == ImageId(i);
    }
    EXPECT_EQ(camera.observations, observations) << i;
  }
  EXPECT_EQ(poses.cameras[refused.index()].reason, "12 inliers, expected 30");
  EXPECT_NE(poses.cameras[in_the_other.index()].reason.find("another piece"), std::string::npos);
}

TEST(DescribePoses, ALensThatWasOnlyGuessedIsNotGivenForACameraThatIsNotThere) {
  const SyntheticWorld world = MakeSyntheticWorld({});
  IncrementalResult models;
  Reconstruction model = TrueReconstruction(world);
  model.intrinsics.known = false;
  model.cam_from_model[3].reset();
  const PoseSet poses = DescribePoses(FramesOf(world), models, model, world.features);
  EXPECT_TRUE(poses.cameras[3].intrinsics.params.empty());
  EXPECT_FALSE(poses.cameras[4].intrinsics.params.empty());
}

/// A camera 1.7 m from the rig's axis.
CameraPose CameraAt(double azimuth_deg) {
  CameraPose camera;
  camera.camera = std::to_string(azimuth_deg);
  camera.registered = true;
  const double azimuth = RadFromDeg(azimuth_deg);
  const Eigen::Vector3d center(1.7 * std::cos(azimuth), 1.7 * std::sin(azimuth), 1.2);
  camera.cam_from_rig.rotation =
      Eigen::AngleAxisd(0.3 * azimuth_deg, Eigen::Vector3d(1, 2, 3).normalized());
  camera.cam_from_rig.translation = -(camera.cam_from_rig.rotation * center);
  return camera;
}

void Differ(std::optional<VsCalibration>& vs, double rotation_deg, double position_mm) {
  vs.emplace();
  vs->rotation_deg = rotation_deg;
  vs->position_mm = position_mm;
}

constexpr double kFar_mm = 400, kNear_mm = 20;

/// Cameras around the subject, and how far each is off the calibration.
struct Aligned {
  explicit Aligned(const std::vector<double>& azimuths_deg) {
    alignment.far_mm = kFar_mm;
    for (const double azimuth_deg : azimuths_deg) {
      poses.cameras.push_back(CameraAt(azimuth_deg));
      Differ(alignment.vs_calibration.emplace_back(), 0.1, 2.0);
    }
  }
  void Add() {
    Calibration calibration;
    calibration.id = "cal-7";
    AddCalibrationFigures(alignment, calibration, poses);
  }

  PoseSet poses;
  RigAlignment alignment;
};

TEST(AddCalibrationFigures, SidesAreQuartersAroundTheAxis) {
  Aligned aligned({0, 44, -44, 46, 90, 134, 136, 180, -136, -134, -90, -46});
  aligned.poses.cameras.push_back({});  // not registered
  aligned.alignment.vs_calibration.push_back(std::nullopt);
  aligned.Add();
  std::vector<std::string> sides;
  for (const CameraPose& camera : aligned.poses.cameras) sides.push_back(camera.side);
  EXPECT_EQ(sides,
            (std::vector<std::string>{"front", "front", "front", "left", "left", "left", "back",
                                      "back", "back", "right", "right", "right", ""}));
  EXPECT_TRUE(aligned.poses.metric);
  EXPECT_EQ(aligned.poses.aligned_to, "cal-7");
}

TEST(AddCalibrationFigures, MovedCamerasCountInTheMeansAndSwappedOnesDoNot) {
  Aligned aligned({0, 90, 180, 270});
  Differ(aligned.alignment.vs_calibration[1], 0.5, 8.0);
  aligned.alignment.vs_calibration[1]->moved = true;
  Differ(aligned.alignment.vs_calibration[2], 170.0, 3000.0);
  aligned.alignment.vs_calibration[2]->swapped_with = "c3";
  aligned.poses.cameras[3].registered = false;
  aligned.Add();
  const std::vector<CameraPose>& cameras = aligned.poses.cameras;
  EXPECT_FALSE(cameras[0].vs_calibration->moved);
  EXPECT_TRUE(cameras[1].vs_calibration->moved);
  EXPECT_EQ(cameras[2].vs_calibration->swapped_with, "c3");
  EXPECT_FALSE(cameras[3].vs_calibration.has_value());
  const PoseSummary& summary = aligned.poses.summary;
  EXPECT_NEAR(*summary.mean_rotation_deg, (0.1 + 0.5) / 2, 1e-12);
  EXPECT_NEAR(*summary.mean_position_mm, (2.0 + 8.0) / 2, 1e-12);
  EXPECT_EQ(summary.folded, false) << "half a turn of a swapped camera is no fold";
}

TEST(AddCalibrationFigures, NothingRegisteredHasNoMeans) {
  Aligned aligned({0});
  aligned.poses.cameras[0].registered = false;
  aligned.Add();
  EXPECT_FALSE(aligned.poses.summary.mean_rotation_deg.has_value());
  EXPECT_FALSE(aligned.poses.summary.mean_position_mm.has_value());
}

struct Off {
  size_t cameras = 0;
  double rotation_deg = 0;
  double position_mm = 0;
};
/// Eight cameras, the first of them off by so much, and what AddVerdict said of the pictures.
Aligned Judged(const std::string& verdict, const Off& off) {
  Aligned aligned({0, 45, 90, 135, 180, 225, 270, 315});
  for (size_t i = 0; i < off.cameras; ++i) {
    Differ(aligned.alignment.vs_calibration[i], off.rotation_deg, off.position_mm);
    aligned.alignment.vs_calibration[i]->moved = true;
  }
  PoseSummary& summary = aligned.poses.summary;
  summary.verdict = summary.verdict_of_pictures = verdict;
  summary.verdict_reason = "of the pictures";
  if (!verdict.empty()) summary.margin = 37;
  if (verdict == "sure") summary.folded = false;
  if (verdict == "folded") summary.folded = true;
  aligned.Add();
  return aligned;
}

TEST(AddCalibrationFigures, CamerasOnTheWrongSideMakeItFoldedUnlessThePicturesAreSure) {
  for (const char* verdict : {"", "unsure"}) {
    const PoseSet poses = Judged(verdict, {3, 170.0, 3000.0}).poses;
    EXPECT_EQ(poses.summary.verdict, "folded") << verdict;
    EXPECT_EQ(poses.summary.folded, true) << verdict;
    EXPECT_FALSE(poses.summary.margin.has_value()) << "it spoke for the other verdict";
    EXPECT_EQ(poses.summary.verdict_reason.rfind("3 cameras on the wrong side", 0), 0u)
        << poses.summary.verdict_reason;
    for (size_t i = 0; i < poses.cameras.size(); ++i) {
      EXPECT_EQ(poses.cameras[i].vs_calibration->wrong_side, i < 3) << i;
      EXPECT_FALSE(poses.cameras[i].vs_calibration->moved) << i;
    }
  }
}

TEST(AddCalibrationFigures, WhatIsFarOffMakesItUnsureAndNothingBetter) {
  const Off few_far{2, 170.0, 3000.0}, turned{4, 40.0, kNear_mm}, shifted{4, 1.0, kFar_mm + 1};
  for (const Off& off : {few_far, turned, shifted, Off{4, 170.0, 3000.0}}) {
    for (const char* verdict : {"", "sure"}) {
      if (verdict == std::string() && off.cameras == 4 && off.rotation_deg > 100) continue;
      const PoseSet poses = Judged(verdict, off).poses;
      EXPECT_EQ(poses.summary.verdict, "unsure") << verdict;
      EXPECT_NE(poses.summary.verdict_reason.find(" cameras far from where"), std::string::npos);
      EXPECT_FALSE(poses.summary.folded.has_value()) << "nothing tells";
      EXPECT_TRUE(poses.cameras[0].vs_calibration->moved);
      EXPECT_FALSE(poses.cameras[0].vs_calibration->wrong_side);
      EXPECT_EQ(poses.summary.verdict_of_pictures, verdict);
      for (size_t i = 0; i < poses.cameras.size(); ++i) {
        EXPECT_EQ(poses.cameras[i].vs_calibration->far_off, i < off.cameras) << i;
      }
    }
  }
  const PoseSummary unsure = Judged("unsure", turned).poses.summary;
  EXPECT_EQ(unsure.verdict, "unsure");
  EXPECT_EQ(unsure.verdict_reason, "of the pictures");
  EXPECT_FALSE(unsure.folded.has_value());
}

TEST(AddCalibrationFigures, WithoutAMajorityInPlaceNoCameraIsNamed) {
  const PoseSet poses = Judged("unsure", {5, 170.0, 3000.0}).poses;
  EXPECT_EQ(poses.summary.verdict, "folded");
  EXPECT_NE(poses.summary.verdict_reason.find("not even half"), std::string::npos);
  for (const CameraPose& camera : poses.cameras) {
    EXPECT_FALSE(camera.vs_calibration->wrong_side || camera.vs_calibration->moved);
  }
}

TEST(AddCalibrationFigures, ACalibrationThatHalfOfTheCamerasContradictIsNotTheirs) {
  for (const size_t off : {3, 4}) {
    Aligned aligned({0, 45, 90, 135, 180, 225, 270, 315});
    for (size_t i = 0; i < off; ++i) {
      aligned.alignment.vs_calibration[i]->sigmas = kMovedSigmas + 0.1;
    }
    aligned.poses.summary.verdict = "sure";
    aligned.poses.summary.folded = false;
    aligned.Add();
    EXPECT_EQ(aligned.poses.summary.verdict, off == 4 ? "unsure" : "sure");
    EXPECT_EQ(aligned.poses.summary.folded, false) << "all are near their places";
    EXPECT_EQ(aligned.poses.summary.verdict_reason.find("another rig's") != std::string::npos,
              off == 4);
  }
}

TEST(AddCalibrationFigures, OfAModelThatThePicturesFoldedNoCameraHasMoved) {
  const PoseSet poses = Judged("folded", {1, 0.5, kNear_mm}).poses;
  EXPECT_EQ(poses.summary.verdict, "folded");
  EXPECT_EQ(poses.summary.verdict_reason, "of the pictures");
  EXPECT_EQ(poses.summary.folded, true);
  EXPECT_FALSE(poses.cameras[0].vs_calibration->moved);
}

TEST(AddCalibrationFigures, CamerasThatAreMerelyMovedChangeNoVerdict) {
  for (const char* verdict : {"", "sure", "unsure"}) {
    const PoseSet poses = Judged(verdict, {4, kFoldedRotation_deg - 0.1, kFar_mm - 1}).poses;
    EXPECT_EQ(poses.summary.verdict, verdict);
    EXPECT_EQ(poses.summary.verdict_reason, "of the pictures");
    EXPECT_EQ(poses.summary.folded, false) << "the calibration tells";
    EXPECT_TRUE(poses.cameras[0].vs_calibration->moved);
    EXPECT_FALSE(poses.cameras[0].vs_calibration->far_off);
  }
}

TEST(AddVerdict, TheMarginIsTheEvidenceIfAnythingLooksAlike) {
  TcSfmResult result;
  result.verdict = Verdict::kSure;
  result.reason = "nothing looks alike";
  result.evidence = std::numeric_limits<double>::infinity();
  PoseSet poses;
  AddVerdict(result, poses);
  EXPECT_EQ(poses.summary.verdict, "sure");
  EXPECT_EQ(poses.summary.verdict_of_pictures, "sure");
  EXPECT_EQ(poses.summary.verdict_reason, "nothing looks alike");
  EXPECT_FALSE(poses.summary.margin.has_value());
  EXPECT_FALSE(poses.summary.view_graph_margin.has_value());
  EXPECT_EQ(poses.summary.folded, false);
  result.view_graph_margin = 0.75;
  result.verdict = Verdict::kUnsure;
  PoseSet unsure;
  AddVerdict(result, unsure);
  EXPECT_FALSE(unsure.summary.folded.has_value()) << "nothing tells";
  result.verdict = Verdict::kFolded;
  result.evidence = -3.5;
  AddVerdict(result, poses);
  EXPECT_EQ(poses.summary.verdict, "folded");
  EXPECT_EQ(poses.summary.margin, -3.5);
  EXPECT_EQ(poses.summary.view_graph_margin, 0.75);
  EXPECT_EQ(poses.summary.folded, true);
}

TEST(AddEvidence, OfEveryRegisteredCamera) {
  PoseSet poses;
  poses.cameras.resize(3);
  poses.cameras[0].registered = poses.cameras[2].registered = true;
  TcSfmResult result;
  result.certainty = {std::numeric_limits<double>::infinity(), 5, 12.5};
  result.alternatives = {{ImageId(2), {}, kPi, 7.5, -6.5}};
  result.doubtful = {ImageId(2)};
  result.late = {ImageId(0)};
  AddEvidence(result, poses);
  EXPECT_FALSE(poses.cameras[1].evidence);
  ASSERT_TRUE(poses.cameras[0].evidence && poses.cameras[2].evidence);
  const PoseEvidence &first = *poses.cameras[0].evidence, &last = *poses.cameras[2].evidence;
  EXPECT_FALSE(first.certainty);
  EXPECT_FALSE(first.other_pose);
  EXPECT_FALSE(first.doubtful);
  EXPECT_TRUE(first.late);
  EXPECT_EQ(last.certainty, 12.5);
  ASSERT_TRUE(last.other_pose);
  EXPECT_DOUBLE_EQ(last.other_pose->rotation_deg, 180);
  EXPECT_EQ(last.other_pose->against, 7.5);
  EXPECT_EQ(last.other_pose->in_favour, -6.5);
  EXPECT_TRUE(last.doubtful);
  EXPECT_FALSE(last.late);
}

/// Cameras that look at an upright subject, in a frame of no meaning.
Reconstruction Around(const std::vector<double>& azimuths_deg) {
  const Rigid3 world_from_model{
      Eigen::Quaterniond(Eigen::AngleAxisd(2.5, Eigen::Vector3d(1, -2, 0.5).normalized())),
      Eigen::Vector3d(3, -4, 5)};
  Reconstruction model;
  for (const double azimuth_deg : azimuths_deg) {
    const double azimuth = RadFromDeg(azimuth_deg);
    const Eigen::Vector3d out(std::cos(azimuth), std::sin(azimuth), 0);
    Eigen::Matrix3d cam_from_world;
    cam_from_world << out.cross(Eigen::Vector3d::UnitZ()).transpose() * -1,
        Eigen::RowVector3d(0, 0, -1), -out.transpose();
    const Eigen::Quaterniond rotation(cam_from_world);
    model.cam_from_model.push_back(Rigid3{rotation, -(rotation * (1.7 * out))} * world_from_model);
  }
  return model;
}

TEST(AddSides, AreQuartersFromTheCameraInTheMiddleOfTheFront) {
  Reconstruction model = Around({50, 94, 6, 96, 140, 184, 186, 230, -86, -84, -40, 4, 0});
  model.cam_from_model.back().reset();
  PoseSet poses;
  poses.cameras.resize(model.cam_from_model.size());
  ASSERT_TRUE(AddSides(model, ImageId(0), poses));
  std::vector<std::string> sides;
  for (const CameraPose& camera : poses.cameras) sides.push_back(camera.side);
  EXPECT_EQ(sides,
            (std::vector<std::string>{"front", "front", "front", "left", "left", "left", "back",
                                      "back", "back", "right", "right", "right", ""}));
}

TEST(AddSides, NeedsTheFrontAndCamerasAroundTheSubject) {
  PoseSet poses;
  poses.cameras.resize(3);
  Reconstruction model = Around({0, 120, 240});
  model.cam_from_model[1].reset();
  EXPECT_FALSE(AddSides(model, ImageId(1), poses));
  EXPECT_FALSE(AddSides(Around({10, 10, 10}), ImageId(0), poses));
  for (const CameraPose& camera : poses.cameras) EXPECT_EQ(camera.side, "");
}

TEST(AddSegments, HaveTheSideOfMostOfTheirCameras) {
  PoseSet poses;
  for (const char* side : {"front", "front", "left", "back", ""}) {
    poses.cameras.emplace_back().side = side;
  }
  Segments segments;
  const auto add = [&](bool ambiguous, size_t tracks, const std::vector<size_t>& images) {
    Segment& segment = segments.segments.emplace_back();
    segment.ambiguous = ambiguous;
    segment.tracks = tracks;
    for (const size_t image : images) segment.images.push_back(ImageId(image));
  };
  add(true, 70, {0, 1, 2});
  add(true, 9, {});  // no camera is related to it
  add(false, 40, {4});
  add(true, 50, {2, 3});
  segments.segments[0].look_alikes = {3, 1, 0};
  AddSegments(segments, poses);

  ASSERT_EQ(poses.segments.size(), 3u);
  std::vector<uint32_t> ids;
  for (const SegmentSummary& segment : poses.segments) ids.push_back(segment.id);
  EXPECT_EQ(ids, (std::vector<uint32_t>{0, 2, 3}));
  EXPECT_EQ(poses.segments[0].side, "front");
  EXPECT_EQ(poses.segments[0].tracks, 70u);
  EXPECT_EQ(poses.segments[0].cameras, 3u);
  EXPECT_TRUE(poses.segments[0].ambiguous);
  EXPECT_EQ(poses.segments[0].look_alikes, (std::vector<uint32_t>{3, 0}))
      << "only segments that are given";
  EXPECT_EQ(poses.segments[1].side, "") << "its camera's side is not known";
  EXPECT_FALSE(poses.segments[1].ambiguous);
  EXPECT_EQ(poses.segments[2].side, "back") << "one each: the first by name";
  EXPECT_EQ(poses.summary.ambiguous_communities, 2u);
  EXPECT_EQ(poses.cameras[2].segments, (std::vector<uint32_t>{0, 3}));
  EXPECT_EQ(poses.cameras[4].segments, (std::vector<uint32_t>{2}));
}

TEST(AddSigmas, OfRegisteredCamerasAndTheirLenses) {
  PoseSet poses;
  poses.cameras.resize(3);
  Intrinsics intrinsics;
  intrinsics.lens_of_image = {1, 0, 0};
  PoseCovariances covariances;
  covariances.images = {PoseCovariance(4.0 * PoseCovariance::Identity()), std::nullopt,
                        PoseCovariance(PoseCovariance::Identity())};
  covariances.focal_sigma_px = {std::nullopt, 0.7};
  AddSigmas(covariances, intrinsics, poses);
  ASSERT_TRUE(poses.cameras[0].sigma && poses.cameras[2].sigma);
  EXPECT_NEAR(poses.cameras[0].sigma->rotation_deg, DegFromRad(std::sqrt(12.0)), 1e-9);
  EXPECT_NEAR(poses.cameras[0].sigma->position_mm, 1e3 * std::sqrt(12.0), 1e-9);
  EXPECT_EQ(poses.cameras[0].sigma->focal_px, 0.7);
  EXPECT_FALSE(poses.cameras[1].sigma.has_value());
  EXPECT_FALSE(poses.cameras[2].sigma->focal_px.has_value());
}

}  // namespace
}  // namespace rotunda::sfm
