#include "rig/rig_calibration.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "rig/calibration_checks.h"
#include "rig/calibration_comparison.h"
#include "rig/calibration_doubts.h"
#include "rig/calibration_report.h"
#include "rig/calibration_result.h"
#include "sfm/core/evaluate.h"
#include "tests/support/projected_corners.h"

// Calibrations of simulated rigs from projected corners, against truth. The full size (90 cameras,
// 12 shots, 5 seeds) is the benchmark's: tests/bench/calibration.cc.

namespace rotunda::rig {
namespace {

using test::ProjectCorners;
using test::ProjectedOptions;
using test::ProjectedRig;

ProjectedOptions SmallRig(uint64_t seed) {
  ProjectedOptions options;
  options.cameras = 30;
  options.shots = 6;
  options.rig_seed = options.noise_seed = seed;
  return options;
}

Result<RigCalibration> Calibrate(const ProjectedRig& world,
                                 const RigCalibrationOptions& options = {}, int threads = 0) {
  ThreadPool pool(threads);
  RunContext context{pool};
  return CalibrateRig(world.board, world.sightings, options, context);
}

Calibration AsFile(const ProjectedRig& world, const RigCalibration& result) {
  return ToCalibration(world.board, world.sightings, result, nullptr);
}

TEST(RigCalibration, FindsCamerasTargetAndTheirUncertainty) {
  double rotation = 0, position = 0;
  constexpr int kSeeds = 3;
  for (uint64_t seed = 1; seed <= kSeeds; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const ProjectedRig world = ProjectCorners(SmallRig(seed));
    const auto result = Calibrate(world);
    ASSERT_TRUE(result.ok()) << result.error().ToString();
    const auto errors = EvaluateCalibration(AsFile(world, *result), world.truth);
    ASSERT_TRUE(errors.ok());
    EXPECT_EQ(errors->registered, 30u);
    // Half the shots of the full rig: its 0.005 deg and 0.15 mm times the root of two.
    EXPECT_LT(errors->mean_rotation_deg, 0.0085);
    EXPECT_LT(errors->mean_position_mm, 0.21);
    EXPECT_LT(test::BoardError_mm(world.board, result->model.faces, world.truth.board), 0.05);
    EXPECT_NEAR(result->noise, 1.0, 0.03) << "the corners' sigmas are true";
    EXPECT_TRUE(result->dropped.empty());
    for (const CalibratedCamera& camera : AsFile(world, *result).cameras) {
      const double true_px = world.truth.Find(camera.camera)->intrinsics.MeanFocal_px();
      EXPECT_LT(std::abs(camera.intrinsics.MeanFocal_px() - true_px), 5 * *camera.sigma->focal_px)
          << camera.camera;
    }
    rotation += std::pow(*errors->rotation_error_over_sigma, 2) / kSeeds;
    position += std::pow(*errors->position_error_over_sigma, 2) / kSeeds;
  }
  EXPECT_GT(rotation, 0.7);
  EXPECT_LT(rotation, 1.5);
  EXPECT_GT(position, 0.7);
  EXPECT_LT(position, 1.5);
}

TEST(RigCalibration, WrongCornersAreTakenOutAndGoodOnesKept) {
  ProjectedOptions options = SmallRig(4);
  options.wrong_share = 0.03;
  const ProjectedRig world = ProjectCorners(options);
  const auto result = Calibrate(world);
  ASSERT_TRUE(result.ok()) << result.error().ToString();
  const double kept = static_cast<double>(CornerCount(result->kept)) /
                      static_cast<double>(CornerCount(result->found));
  EXPECT_NEAR(kept, 0.97, 0.003);
  EXPECT_NEAR(result->noise, 1.0, 0.03);
}

TEST(RigCalibration, OneShotIsEnoughWithKnownLensesAndTarget) {
  const ProjectedRig world = ProjectCorners(SmallRig(5));
  const auto before = Calibrate(world);
  ASSERT_TRUE(before.ok());
  const Calibration earlier = AsFile(world, *before);
  ProjectedOptions daily = SmallRig(5);
  daily.shots = 1;
  daily.first_placement = 40;
  daily.noise_seed = 77;
  ProjectedRig today = ProjectCorners(daily);
  today.board.rig_frame.shot = "the first calibration's";  // the frame comes from that one
  RigCalibrationOptions options;
  options.intrinsics_from = options.frame_from = &earlier;
  options.model = LensModel::kOpencv5;  // of no effect on lenses that are kept
  const auto result = Calibrate(today, options);
  ASSERT_TRUE(result.ok()) << result.error().ToString();
  const Calibration found = AsFile(today, *result);
  const auto errors = EvaluateCalibration(found, today.truth);
  ASSERT_TRUE(errors.ok());
  EXPECT_EQ(errors->registered, 30u);
  EXPECT_LT(errors->mean_rotation_deg, 0.01 * std::sqrt(2));
  EXPECT_LT(errors->mean_position_mm, 0.3);
  // The lenses' own uncertainty is in the sigmas.
  EXPECT_LT(*errors->rotation_error_over_sigma, 1.3);
  EXPECT_LT(*errors->position_error_over_sigma, 1.3);
  // In the earlier frame without any alignment.
  for (const CalibratedCamera& camera : found.cameras) {
    const Eigen::Vector3d then = earlier.Find(camera.camera)->cam_from_rig.OriginInSource();
    EXPECT_LT((camera.cam_from_rig.OriginInSource() - then).norm(), 2e-3) << camera.camera;
    EXPECT_EQ(camera.intrinsics.params, earlier.Find(camera.camera)->intrinsics.params);
  }
}

TEST(RigCalibration, TheSameBytesOnAnyNumberOfThreads) {
  ProjectedOptions options = SmallRig(6);
  options.cameras = 8;
  options.shots = 5;
  const ProjectedRig world = ProjectCorners(options);
  std::vector<std::string> texts;
  for (const int threads : {1, 4}) {
    const auto result = Calibrate(world, {}, threads);
    ASSERT_TRUE(result.ok());
    ThreadPool pool(threads);
    RunContext context{pool};
    const auto validation = CrossValidate(world.board, *result, {}, context);
    ASSERT_TRUE(validation.ok());
    const Calibration file = ToCalibration(world.board, world.sightings, *result, &*validation);
    const auto checks = CheckCameras(world.board, world.sightings, *result, {});
    texts.push_back(CalibrationToJson(file) + BuildCalibrationReport({world.board,
                                                                      world.sightings,
                                                                      *result,
                                                                      file,
                                                                      checks,
                                                                      *validation,
                                                                      std::nullopt,
                                                                      {"<note>"}}));
    EXPECT_EQ(texts.back().find("<note>"), std::string::npos) << "text is not markup";
    const auto again = CalibrationFromJson(CalibrationToJson(file), "written");
    ASSERT_TRUE(again.ok()) << again.error().ToString();
    EXPECT_EQ(CalibrationToJson(*again), CalibrationToJson(file));
  }
  EXPECT_EQ(texts[0], texts[1]);
}

TEST(RigCalibration, HeldOutCornersAndHalvesAgreeWithTheNoise) {
  const ProjectedRig world = ProjectCorners(SmallRig(7));
  const auto result = Calibrate(world);
  ASSERT_TRUE(result.ok());
  ThreadPool pool(0);
  RunContext context{pool};
  const auto validation = CrossValidate(world.board, *result, {}, context);
  ASSERT_TRUE(validation.ok()) << validation.error().ToString();
  const double rms_px = AsFile(world, *result).residuals->rms_px;
  EXPECT_GT(*validation->held_out_rms_px, rms_px);
  EXPECT_LT(*validation->held_out_rms_px, 1.1 * rms_px);
  EXPECT_GT(*validation->held_out_p95_px, *validation->held_out_rms_px);
  ASSERT_TRUE(validation->rotation_ratio && validation->position_ratio);
  EXPECT_GT(*validation->rotation_ratio, 0.6);
  EXPECT_LT(*validation->rotation_ratio, 1.5);
  EXPECT_GT(*validation->position_ratio, 0.6);
  EXPECT_LT(*validation->position_ratio, 1.5);

  const CrossValidation nothing_held_out;
  const auto file = ToCalibration(world.board, world.sightings, *result, &nothing_held_out);
  EXPECT_FALSE(file.residuals->held_out_rms_px.has_value());
  EXPECT_FALSE(file.residuals->held_out_p95_px.has_value());
}

TEST(RigCalibration, FacesOfUnknownPlaceAreFoundFromThePictures) {
  for (const bool wrong_drawing : {false, true}) {
    SCOPED_TRACE(wrong_drawing ? "wrong drawing" : "no drawing");
    ProjectedRig world = ProjectCorners(SmallRig(8));
    for (BoardFace& face : world.board.faces) {
      if (wrong_drawing) {  // printed upside down, all of them
        const Rigid3 turned = {Eigen::Quaterniond(0, 0, 0, 1), 2 * FaceMiddle(face)};
        face.board_from_face = face.board_from_face * turned;
      } else {
        face.board_from_face = Rigid3{};
      }
    }
    if (!wrong_drawing) {
      world.board.face_position_sigma_m = world.board.face_rotation_sigma_rad = INFINITY;
    }
    const auto result = Calibrate(world);
    ASSERT_TRUE(result.ok()) << result.error().ToString();
    EXPECT_EQ(result->drawing_refused, wrong_drawing);
    EXPECT_LT(test::BoardError_mm(world.board, result->model.faces, world.truth.board), 0.05);
    const auto errors = EvaluateCalibration(AsFile(world, *result), world.truth);
    ASSERT_TRUE(errors.ok());
    EXPECT_EQ(errors->registered, 30u);
    EXPECT_LT(errors->mean_position_mm, 0.25);
  }
}

// Mean inputs: the right result, or what is wrong is named.

/// What camera `c` of the world sees in shot `s` when it really is `camera`, the board at
/// `rig_from_board`.
void Replace(ProjectedRig& world, size_t s, size_t c, const CalibratedCamera& camera,
             const Rigid3& rig_from_board) {
  world.sightings.sightings[s][c].detection =
      test::ProjectView(world, camera, rig_from_board, ProjectedOptions{}, 1000 * s + c);
}

TEST(RigCalibration, ACameraUpsideDownIsCalibratedLikeTheOthers) {
  Calibration truth = ProjectCorners(SmallRig(9)).truth;
  CalibratedCamera& camera = truth.cameras[4];
  const Eigen::Quaterniond half_turn(0, 0, 0, 1);
  camera.cam_from_rig = Rigid3{half_turn, Eigen::Vector3d::Zero()} * camera.cam_from_rig;
  const ProjectedRig world = ProjectCorners(SmallRig(9), truth);
  const auto result = Calibrate(world);
  ASSERT_TRUE(result.ok());
  const auto errors = EvaluateCalibration(AsFile(world, *result), world.truth);
  ASSERT_TRUE(errors.ok());
  EXPECT_EQ(errors->registered, 30u);
  EXPECT_LT(errors->max_rotation_deg, 0.06);
}

TEST(RigCalibration, AShotInWhichTheBoardMovedIsLeftOutByName) {
  ProjectedRig world = ProjectCorners(SmallRig(10));
  Rigid3 later = world.rig_from_board[2];
  later.translation += Eigen::Vector3d(0.003, -0.002, 0);  // while half of the cameras took it
  for (size_t c = 0; c < world.truth.cameras.size(); c += 2) {
    Replace(world, 2, c, world.truth.cameras[c], later);
  }
  const auto result = Calibrate(world);
  ASSERT_TRUE(result.ok()) << result.error().ToString();
  EXPECT_NE(result->shot_problem[2].find("moved"), std::string::npos) << result->shot_problem[2];
  for (const size_t s : {0, 1, 3, 4, 5}) EXPECT_TRUE(result->shot_problem[s].empty()) << s;
  const auto errors = EvaluateCalibration(AsFile(world, *result), world.truth);
  ASSERT_TRUE(errors.ok());
  EXPECT_LT(errors->mean_position_mm, 0.25);
}

TEST(RigCalibration, AShotOfAnotherRigIsLeftOutByName) {
  ProjectedOptions options = SmallRig(1);
  options.cameras = 8;
  options.shots = 3;
  ProjectedRig world = ProjectCorners(options);
  options.rig_seed = 2;
  world.sightings.sightings[2] = ProjectCorners(options).sightings.sightings[2];
  const auto result = Calibrate(world);
  ASSERT_TRUE(result.ok()) << result.error().ToString();
  EXPECT_EQ(result->shot_problem[0] + result->shot_problem[1], "");
  EXPECT_EQ(result->shot_problem[2].find("it does not agree with the other shots"), 0u)
      << result->shot_problem[2];
  const auto errors = EvaluateCalibration(AsFile(world, *result), world.truth);
  ASSERT_TRUE(errors.ok());
  EXPECT_EQ(errors->registered, 8u);
  EXPECT_LT(errors->mean_position_mm, 1.0);
}

TEST(RigCalibration, TheFrameIsWhereTheBoardFileSaysAndSaysWhenItCannotBe) {
  ProjectedRig world = ProjectCorners(SmallRig(14));
  world.board.rig_frame = {world.sightings.shots[1].id, {0.1, -0.2, 0.05}, RadFromDeg(30)};
  const auto result = Calibrate(world);
  ASSERT_TRUE(result.ok()) << result.error().ToString();
  EXPECT_EQ(result->frame_problem, "");
  EXPECT_EQ(result->frame, "the target in " + world.sightings.shots[1].id);
  const Rigid3& placed = *result->model.rig_from_board[1];
  EXPECT_LT((placed.translation - Eigen::Vector3d(0.1, -0.2, 0.05)).norm(), 1e-9);
  EXPECT_LT(
      (placed.rotation * Eigen::Vector3d::UnitX() - Eigen::Vector3d(std::cos(kPi / 6), 0.5, 0))
          .norm(),
      1e-9);

  Rigid3 later = world.rig_from_board[1];
  later.translation += Eigen::Vector3d(0.003, -0.002, 0);
  for (size_t c = 0; c < world.truth.cameras.size(); c += 2) {
    Replace(world, 1, c, world.truth.cameras[c], later);
  }
  const auto without = Calibrate(world);
  ASSERT_TRUE(without.ok()) << without.error().ToString();
  EXPECT_EQ(without->frame, "the target in " + world.sightings.shots[0].id);
  EXPECT_NE(without->frame_problem.find(world.sightings.shots[1].id), std::string::npos)
      << without->frame_problem;

  world.board.rig_frame.shot = "yesterday";
  const auto refused = Calibrate(world);
  ASSERT_FALSE(refused.ok());
  EXPECT_NE(refused.error().ToString().find("yesterday"), std::string::npos);
}

TEST(RigCalibration, AnotherRigsCalibrationIsRefusedBeforeAnythingIsSolved) {
  const ProjectedRig world = ProjectCorners(SmallRig(14));
  Calibration other = world.truth;
  for (CalibratedCamera& camera : other.cameras) camera.camera = "x" + camera.camera;
  const Status shared = CheckShared(world.sightings.cameras, other, 1);
  ASSERT_FALSE(shared.ok());
  EXPECT_NE(shared.error().ToString().find("another rig"), std::string::npos);
  RigCalibrationOptions options;
  options.frame_from = &other;
  ThreadPool pool(1);
  bool started = false;
  RunContext context{pool, {}, [&](std::string_view, size_t, size_t) { started = true; }};
  EXPECT_FALSE(CalibrateRig(world.board, world.sightings, options, context).ok());
  EXPECT_FALSE(started);
  EXPECT_TRUE(CheckShared(world.sightings.cameras, world.truth, 30).ok());
}

TEST(RigCalibration, AShotGivenTwiceIsRefused) {
  ProjectedRig world = ProjectCorners(SmallRig(14));
  world.sightings.sightings[4] = world.sightings.sightings[1];
  const auto result = Calibrate(world);
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, ErrorCode::kBadInput);
  EXPECT_NE(result.error().context.find(world.sightings.shots[4].id), std::string::npos);
  EXPECT_NE(result.error().message.find("'" + world.sightings.shots[1].id + "'"), std::string::npos)
      << result.error().message;
}

TEST(RigCalibration, ACameraThatSendsAnOldFrameLosesThatPictureAlone) {
  ProjectedRig world = ProjectCorners(SmallRig(14));
  auto& rows = world.sightings.sightings;
  rows[4][7] = rows[1][7];
  const auto result = Calibrate(world);
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_EQ(result->dropped.size(), 1u);
  EXPECT_EQ(result->dropped[0].shot, 4u);
  EXPECT_EQ(result->dropped[0].camera, 7u);
  EXPECT_NE(
      result->dropped[0].reason.find("same picture as its one in " + world.sightings.shots[1].id),
      std::string::npos)
      << result->dropped[0].reason;
  EXPECT_EQ(AsFile(world, *result).cameras.size(), 30u);

  for (size_t c = 0; c < 15; ++c) rows[4][c] = rows[1][c];
  const auto half = Calibrate(world);
  ASSERT_TRUE(half) << half.error().ToString();
  EXPECT_EQ(half->dropped.size(), 15u);
  rows[4][15] = rows[1][15];
  const auto most = Calibrate(world);
  ASSERT_FALSE(most);
  EXPECT_NE(most.error().message.find("of 16 of 30 cameras"), std::string::npos)
      << most.error().message;
}

TEST(RigCalibration, TwoCamerasSwappedInOneShotAreNamed) {
  ProjectedRig world = ProjectCorners(SmallRig(11));
  auto& row = world.sightings.sightings[3];
  std::swap(row[5].detection, row[17].detection);
  const auto result = Calibrate(world);
  ASSERT_TRUE(result.ok()) << result.error().ToString();
  ASSERT_EQ(result->dropped.size(), 2u);
  for (const DroppedPicture& dropped : result->dropped) {
    EXPECT_EQ(dropped.shot, 3u);
    ASSERT_TRUE(dropped.camera.has_value());
    const size_t other = *dropped.camera == 5 ? 17 : 5;
    EXPECT_NE(dropped.reason.find(world.truth.cameras[other].camera), std::string::npos)
        << dropped.reason;
  }
}

TEST(RigCalibration, CamerasSwappedThroughoutAreNamedAgainstTheEarlierCalibration) {
  const ProjectedRig world = ProjectCorners(SmallRig(12));
  const auto before = Calibrate(world);
  ASSERT_TRUE(before.ok());
  ProjectedRig swapped = world;
  for (auto& row : swapped.sightings.sightings) std::swap(row[5].detection, row[17].detection);
  const auto after = Calibrate(swapped);
  ASSERT_TRUE(after.ok());
  const auto comparison = CompareCalibrations(AsFile(world, *before), AsFile(swapped, *after), {});
  ASSERT_TRUE(comparison.ok());
  for (size_t c = 0; c < comparison->cameras.size(); ++c) {
    const CameraChange& change = comparison->cameras[c];
    EXPECT_EQ(change.moved, c == 5 || c == 17) << change.camera;
    if (!change.moved) continue;
    EXPECT_EQ(change.swapped_with, comparison->cameras[c == 5 ? 17 : 5].camera);
  }
}

TEST(RigCalibration, SerialsThatChangedForbidToKeepTheLenses) {
  ProjectedRig world = ProjectCorners(SmallRig(12));
  const Calibration earlier = world.truth;
  std::swap(world.sightings.cameras[0].serial, world.sightings.cameras[1].serial);
  RigCalibrationOptions options;
  options.intrinsics_from = &earlier;
  const auto result = Calibrate(world, options);
  ASSERT_FALSE(result.ok());
  EXPECT_NE(result.error().ToString().find(world.sightings.cameras[0].camera), std::string::npos);
  EXPECT_NE(result.error().ToString().find("swapped"), std::string::npos);
}

TEST(RigCalibration, ACameraThatSawNothingIsNamedAndOthersAreCalibrated) {
  ProjectedRig world = ProjectCorners(SmallRig(13));
  for (auto& row : world.sightings.sightings) {
    row[7].detection->corners.clear();
    row[7].detection->unusable = "blurred: edges are 9 px wide";
  }
  const auto result = Calibrate(world);
  ASSERT_TRUE(result.ok());
  EXPECT_NE(result->camera_problem[7].find("blurred"), std::string::npos)
      << result->camera_problem[7];
  EXPECT_EQ(AsFile(world, *result).cameras.size(), 29u);
}

TEST(RigCalibration, ABlurredShotIsLeftOutByName) {
  ProjectedRig world = ProjectCorners(SmallRig(13));
  for (BoardSighting& sighting : world.sightings.sightings[2]) {
    sighting.detection->corners.clear();
    sighting.detection->unusable = "blurred: edges are 9 px wide";
  }
  const auto result = Calibrate(world);
  ASSERT_TRUE(result.ok());
  EXPECT_NE(result->shot_problem[2].find("30 x blurred"), std::string::npos)
      << result->shot_problem[2];
  for (const size_t s : {0, 1, 3, 4, 5}) EXPECT_TRUE(result->shot_problem[s].empty()) << s;
  EXPECT_EQ(AsFile(world, *result).cameras.size(), 30u);
}

TEST(RigCalibration, ACameraThatReadsTooLittleIsToldHowMuch) {
  ProjectedRig world = ProjectCorners(SmallRig(13));
  for (auto& row : world.sightings.sightings) {
    row[7].detection->corners.resize(5);
    row[7].detection->markers_found = 2;
  }
  RigCalibrationOptions kept;
  kept.intrinsics_from = &world.truth;
  for (const RigCalibrationOptions& options : {RigCalibrationOptions(), kept}) {
    const auto result = Calibrate(world, options);
    ASSERT_TRUE(result.ok()) << result.error().ToString();
    const std::string& problem = result->camera_problem[7];
    EXPECT_EQ(problem.find("no picture shows 8 corners of one face"), 0u) << problem;
    EXPECT_NE(problem.find("2 of the board's markers were read and 5 corners"), std::string::npos)
        << problem;
    EXPECT_EQ(AsFile(world, *result).cameras.size(), 29u);
  }
}

TEST(RigCalibration, ACameraWithoutAKeptLensIsLeftOutByName) {
  const ProjectedRig world = ProjectCorners(SmallRig(13));
  Calibration earlier = world.truth;
  earlier.cameras.erase(earlier.cameras.begin() + 7);
  RigCalibrationOptions options;
  options.intrinsics_from = options.frame_from = &earlier;
  const auto result = Calibrate(world, options);
  ASSERT_TRUE(result.ok()) << result.error().ToString();
  for (size_t c = 0; c < 30; ++c) {
    EXPECT_EQ(result->camera_problem[c].find("it is not in the calibration that lenses are kept"),
              c == 7 ? 0u : std::string::npos)
        << c;
  }
  EXPECT_EQ(AsFile(world, *result).cameras.size(), 29u);
}

TEST(RigCalibration, ACameraOutOfFocusIsLessSure) {
  ProjectedRig world = ProjectCorners(SmallRig(15));
  const auto sharp = Calibrate(world);
  ASSERT_TRUE(sharp.ok()) << sharp.error().ToString();
  constexpr double kWorse = 3;
  // The rig's outlier threshold, 4.5 sigmas, is 1.5 of that camera's: a third of its corners is
  // cut, the others scatter 2.0 times as much.
  constexpr double kLessSure = 2.47;
  ProjectedOptions blurred = SmallRig(15);
  blurred.noise_px *= kWorse;
  const ProjectedRig other = ProjectCorners(blurred);
  for (size_t s = 0; s < world.sightings.shots.size(); ++s) {
    auto& corners = world.sightings.sightings[s][7].detection->corners;
    corners = other.sightings.sightings[s][7].detection->corners;
    for (BoardCorner& corner : corners) corner.sigma_px /= kWorse;  // the detector does not know
  }
  const auto result = Calibrate(world);
  ASSERT_TRUE(result.ok()) << result.error().ToString();
  for (size_t c = 0; c < 30; ++c) {
    const double ratio = result->uncertainty.cameras[c]->sigma.position_mm /
                         sharp->uncertainty.cameras[c]->sigma.position_mm;
    EXPECT_NEAR(ratio, c == 7 ? kLessSure : 1, 0.15) << c;
  }
}

/// Takes what camera `c` sees below `most_px`.
void HideBelow(ProjectedRig& world, size_t c, double most_px) {
  for (auto& row : world.sightings.sightings) {
    std::erase_if(row[c].detection->corners,
                  [&](const BoardCorner& corner) { return corner.pixel.y() > most_px; });
  }
}

TEST(RigCalibration, WhereToMoveTheTargetDependsOnHowACameraIsMounted) {
  for (const bool upside_down : {false, true}) {
    Calibration truth = ProjectCorners(SmallRig(14)).truth;
    if (upside_down) {
      const Rigid3 half_turn = {Eigen::Quaterniond(0, 0, 0, 1), Eigen::Vector3d::Zero()};
      truth.cameras[7].cam_from_rig = half_turn * truth.cameras[7].cam_from_rig;
    }
    ProjectedRig world = ProjectCorners(SmallRig(14), truth);
    HideBelow(world, 7, 1000);
    const auto result = Calibrate(world);
    ASSERT_TRUE(result.ok());
    const auto advice = CheckCameras(world.board, world.sightings, *result, {})[7].advice;
    const std::string expected = std::string("no corner in its lower third: ") +
                                 (upside_down ? "raise" : "lower") + " the target";
    EXPECT_TRUE(std::any_of(advice.begin(), advice.end(), [&](const std::string& text) {
      return text.starts_with(expected);
    })) << testing::PrintToString(advice);
  }
}

TEST(RigCalibration, ACameraThatOneShotHoldsBadlyIsNamed) {
  const ProjectedRig world = ProjectCorners(SmallRig(5));
  const auto before = Calibrate(world);
  ASSERT_TRUE(before.ok());
  const Calibration earlier = AsFile(world, *before);
  ProjectedOptions daily = SmallRig(5);
  daily.shots = 1;
  daily.first_placement = 40;
  daily.noise_seed = 77;
  ProjectedRig today = ProjectCorners(daily);
  auto& corners = today.sightings.sightings[0][7].detection->corners;
  ASSERT_GT(corners.size(), 26u);
  corners.resize(26);  // the first rows of one face: 0.05 px in them leave 0.3 px elsewhere
  RigCalibrationOptions options;
  options.intrinsics_from = options.frame_from = &earlier;
  const auto result = Calibrate(today, options);
  ASSERT_TRUE(result.ok()) << result.error().ToString();
  // Whole cameras leave up to 0.16 px.
  const auto checks =
      CheckCameras(today.board, today.sightings, *result, {.max_projection_px = 0.2});
  const auto named = [](const CameraCheck& check) {
    return std::any_of(check.advice.begin(), check.advice.end(), [](const std::string& text) {
      return text.starts_with("a point may appear");
    });
  };
  EXPECT_TRUE(named(checks[7])) << result->uncertainty.cameras[7]->projection_max_px;
  EXPECT_EQ(std::count_if(checks.begin(), checks.end(), named), 1) << "of 30";
}

TEST(RigCalibration, AThirdRadialParameterIsFoundWithItsUncertainty) {
  RigCalibrationOptions options;
  options.model = LensModel::kOpencv5;
  constexpr size_t kK3 = 8;
  double squares = 0, count = 0;
  for (uint64_t seed = 17; seed <= 20; ++seed) {
    const ProjectedRig world = ProjectCorners(SmallRig(seed));  // its true lenses have no k3
    const auto result = Calibrate(world, options);
    ASSERT_TRUE(result.ok()) << result.error().ToString();
    for (const CalibratedCamera& camera : AsFile(world, *result).cameras) {
      ASSERT_EQ(camera.intrinsics.model, CameraModel::kFullOpencv);
      const std::vector<double>& params = camera.intrinsics.params;
      EXPECT_NE(params[kK3], 0.0);
      for (size_t p = kK3 + 1; p < params.size(); ++p) EXPECT_EQ(params[p], 0.0);
      const Eigen::MatrixXd& covariance = *camera.covariance;
      EXPECT_EQ(covariance.bottomRows<3>().norm(), 0.0);
      squares += params[kK3] * params[kK3] / covariance(kPoseSize + kK3, kPoseSize + kK3);
      count += 1;
    }
  }
  // Of 120 squared normal deviates: 1 +- 0.13.
  std::printf("(k3 / sigma)^2: mean %.2f of %.0f cameras\n", squares / count, count);
  EXPECT_GT(squares / count, 0.6);
  EXPECT_LT(squares / count, 1.5);
}

TEST(RigCalibration, NoBoardInAnyPictureIsRefused) {
  ProjectedRig world = ProjectCorners(SmallRig(15));
  for (auto& row : world.sightings.sightings) {
    for (BoardSighting& sighting : row) sighting.detection->corners.clear();
  }
  const auto result = Calibrate(world);
  ASSERT_FALSE(result.ok());
  EXPECT_NE(result.error().message.find("shows the board"), std::string::npos);
}

TEST(RigCalibration, AHiddenFaceLeavesItsPlaceToTheDrawing) {
  ProjectedRig world = ProjectCorners(SmallRig(16));
  for (auto& row : world.sightings.sightings) {
    for (BoardSighting& sighting : row) {
      std::erase_if(sighting.detection->corners,
                    [](const BoardCorner& corner) { return corner.face == 4; });
    }
  }
  const auto result = Calibrate(world);
  ASSERT_TRUE(result.ok()) << result.error().ToString();
  EXPECT_FALSE(result->uncertainty.faces[4].has_value());
  EXPECT_EQ(AsFile(world, *result).board.size(), 4u);
  EXPECT_EQ(AsFile(world, *result).cameras.size(), 30u);
}

// Solved, and to be doubted: said so, and only then.

ProjectedOptions FewCameras(uint64_t seed) {
  ProjectedOptions options = SmallRig(seed);
  options.cameras = 12;
  options.shots = 5;
  return options;
}

/// The halves' differences included.
struct Checked {
  Calibration file;
  std::vector<CameraCheck> checks;
};

Checked Check(const ProjectedRig& world, const RigCalibration& result) {
  ThreadPool pool(0);
  RunContext context{pool};
  const auto validation = CrossValidate(world.board, result, {}, context);
  EXPECT_TRUE(validation.ok());
  return {ToCalibration(world.board, world.sightings, result, &*validation),
          CheckCameras(world.board, world.sightings, result, {})};
}

ProjectedRig OneShotLater(uint64_t rig_seed) {
  ProjectedOptions daily = FewCameras(rig_seed);
  daily.shots = 1;
  daily.first_placement = 40;
  daily.noise_seed = 77;
  return ProjectCorners(daily);
}

bool AnyStartsWith(const std::vector<std::string>& texts, const std::string& begin) {
  return std::any_of(texts.begin(), texts.end(),
                     [&](const std::string& text) { return text.starts_with(begin); });
}

TEST(CalibrationDoubts, NoneOfGoodCalibrations) {
  for (const double wrong_share : {0.003, 0.03}) {
    ProjectedOptions options = FewCameras(21);
    options.wrong_share = wrong_share;
    const ProjectedRig world = ProjectCorners(options);
    const auto result = Calibrate(world);
    ASSERT_TRUE(result.ok());
    const Checked whole = Check(world, *result);
    EXPECT_EQ(DoubtsOnFit(whole.file, whole.checks, nullptr, {}), std::vector<std::string>());
    EXPECT_EQ(DoubtOnBoard(world.board, world.sightings, &*result, {}), "");
    const ProjectedRig today = OneShotLater(21);
    RigCalibrationOptions kept;
    kept.intrinsics_from = kept.frame_from = &whole.file;
    const auto later = Calibrate(today, kept);
    ASSERT_TRUE(later.ok());
    const Checked daily = Check(today, *later);
    EXPECT_EQ(DoubtsOnFit(daily.file, daily.checks, &whole.file, {}), std::vector<std::string>());
    EXPECT_EQ(DoubtOnBoard(today.board, today.sightings, &*later, {}), "");
  }
}

TEST(CalibrationDoubts, LensesOfAnotherRigAreNamedAsTheReason) {
  const ProjectedRig world = ProjectCorners(FewCameras(5));
  const auto before = Calibrate(world);
  ASSERT_TRUE(before.ok());
  const Calibration earlier = AsFile(world, *before);
  const ProjectedRig other = OneShotLater(6);
  RigCalibrationOptions options;
  options.intrinsics_from = options.frame_from = &earlier;
  const auto result = Calibrate(other, options);
  ASSERT_TRUE(result.ok()) << result.error().ToString();
  const Checked daily = Check(other, *result);
  const auto doubts = DoubtsOnFit(daily.file, daily.checks, &earlier, {});
  std::printf("noise %.2f, before %.2f\n", result->noise, earlier.residuals->noise);
  ASSERT_TRUE(AnyStartsWith(doubts, "the corners scatter")) << testing::PrintToString(doubts);
  EXPECT_NE(doubts[0].find("its lenses are not those of these pictures"), std::string::npos)
      << doubts[0];
}

TEST(CalibrationDoubts, ManyCornersLostAreTold) {
  ProjectedOptions options = FewCameras(22);
  options.wrong_share = 0.15;
  const ProjectedRig world = ProjectCorners(options);
  const auto result = Calibrate(world);
  ASSERT_TRUE(result.ok()) << result.error().ToString();
  const Checked whole = Check(world, *result);
  const auto doubts = DoubtsOnFit(whole.file, whole.checks, nullptr, {});
  ASSERT_TRUE(AnyStartsWith(doubts, "15 % of the corners do not fit"))
      << testing::PrintToString(doubts);
  Checked turned = whole;
  std::reverse(turned.file.cameras.begin(), turned.file.cameras.end());
  EXPECT_EQ(DoubtsOnFit(turned.file, turned.checks, nullptr, {}), doubts)
      << "cameras are told by name, not by place";
}

TEST(CalibrationDoubts, ACameraThatLosesManyCornersIsNamedAlone) {
  ProjectedRig world = ProjectCorners(FewCameras(22));
  size_t count = 0;
  for (auto& row : world.sightings.sightings) {
    for (BoardCorner& corner : row[7].detection->corners) {
      if (++count % 3 == 0) corner.pixel.x() += 4;
    }
  }
  const auto result = Calibrate(world);
  ASSERT_TRUE(result.ok()) << result.error().ToString();
  const Checked whole = Check(world, *result);
  EXPECT_EQ(DoubtsOnFit(whole.file, whole.checks, nullptr, {}), std::vector<std::string>());
  for (size_t c = 0; c < whole.checks.size(); ++c) {
    EXPECT_EQ(AnyStartsWith(whole.checks[c].advice, "more than 25 % of its corners"), c == 7) << c;
  }
}

TEST(CalibrationDoubts, AShotLeftOutIsNoLossOfCorners) {
  ProjectedRig world = ProjectCorners(FewCameras(10));
  Rigid3 later = world.rig_from_board[2];
  later.translation += Eigen::Vector3d(0.003, -0.002, 0);
  for (size_t c = 0; c < world.truth.cameras.size(); c += 2) {
    Replace(world, 2, c, world.truth.cameras[c], later);
  }
  const auto result = Calibrate(world);
  ASSERT_TRUE(result.ok());
  const Checked whole = Check(world, *result);
  EXPECT_EQ(DoubtsOnFit(whole.file, whole.checks, nullptr, {}), std::vector<std::string>());
}

TEST(CalibrationDoubts, HalvesAndResidualsHaveLimits) {
  const ProjectedRig world = ProjectCorners(FewCameras(23));
  const auto result = Calibrate(world);
  ASSERT_TRUE(result.ok());
  Checked whole = Check(world, *result);
  const auto doubts = [&] { return DoubtsOnFit(whole.file, whole.checks, nullptr, {}); };
  CalibrationResiduals& residuals = *whole.file.residuals;
  residuals.half_split_position_ratio = 2.3;
  ASSERT_EQ(doubts().size(), 1u);
  EXPECT_NE(doubts()[0].find("differ by 2.3 times"), std::string::npos) << doubts()[0];
  whole.file.cameras.resize(3);  // of so few, chance makes it that large
  EXPECT_TRUE(doubts().empty());
  residuals.half_split_position_ratio = residuals.half_split_rotation_ratio = std::nullopt;
  residuals.rms_px = 1.2;
  ASSERT_EQ(doubts().size(), 1u);
  EXPECT_NE(doubts()[0].find("no better than 1.20 px"), std::string::npos) << doubts()[0];
}

TEST(CalibrationDoubts, ADrawingThatThePicturesContradictIsTheBoardFiles) {
  // Squares of another size, the faces' places as they were.
  ProjectedRig world = ProjectCorners(FewCameras(24));
  for (BoardFace& face : world.board.faces) face.square_m *= 61.0 / 60;
  const auto squares = Calibrate(world);
  ASSERT_TRUE(squares.ok()) << squares.error().ToString();
  const std::string doubt = DoubtOnBoard(world.board, world.sightings, &*squares, {});
  EXPECT_NE(doubt.find("do not stand as it draws them"), std::string::npos) << doubt;
  EXPECT_NE(doubt.find("square_mm"), std::string::npos) << doubt;

  ProjectedRig turned = ProjectCorners(FewCameras(8));
  for (BoardFace& face : turned.board.faces) {
    const Rigid3 half_turn = {Eigen::Quaterniond(0, 0, 0, 1), 2 * FaceMiddle(face)};
    face.board_from_face = face.board_from_face * half_turn;
  }
  const auto refused = Calibrate(turned);
  ASSERT_TRUE(refused.ok());
  ASSERT_TRUE(refused->drawing_refused);
  EXPECT_NE(DoubtOnBoard(turned.board, turned.sightings, &*refused, {}), "");
}

TEST(CalibrationDoubts, ShotsOfTwoRigsAreNotTheBoardFilesFault) {
  ProjectedOptions options = FewCameras(1);
  options.cameras = 8;
  options.shots = 2;
  ProjectedRig world = ProjectCorners(options);
  options.rig_seed = 2;
  world.sightings.sightings[1] = ProjectCorners(options).sightings.sightings[1];
  const auto result = Calibrate(world);
  ASSERT_TRUE(result.ok()) << result.error().ToString();
  EXPECT_EQ(DoubtOnBoard(world.board, world.sightings, &*result, {}), "");
  const Checked whole = Check(world, *result);
  const auto doubts = DoubtsOnFit(whole.file, whole.checks, nullptr, {});
  ASSERT_TRUE(AnyStartsWith(doubts, "the corners fit no better than"));
  EXPECT_NE(doubts[0].find("are all shots of one rig"), std::string::npos) << doubts[0];
}

TEST(CalibrationDoubts, MisplacedMarkersOfMostCamerasAreTheBoardFilesOfFewTheCameras) {
  const auto doubt = [](size_t cameras, size_t shots, Rejection kind, int of = 30) {
    ProjectedOptions options = SmallRig(25);
    options.cameras = of;
    ProjectedRig world = ProjectCorners(options);
    for (size_t s = 0; s < shots; ++s) {
      for (size_t c = 0; c < cameras; ++c) {
        world.sightings.sightings[s][c].detection->rejected.push_back(
            {"APRILTAG_36h11", 5, {100, 100}, kind, "for this test"});
      }
    }
    for (auto& row : world.sightings.sightings) {
      for (BoardSighting& sighting : row) sighting.detection->markers_found = 40;
    }
    return DoubtOnBoard(world.board, world.sightings, nullptr, {});
  };
  EXPECT_NE(doubt(16, 2, Rejection::kMisplaced).find("16 of 30 cameras"), std::string::npos);
  EXPECT_EQ(doubt(15, 6, Rejection::kMisplaced), "") << "half of the cameras";
  EXPECT_EQ(doubt(30, 1, Rejection::kMisplaced), "") << "one shot of six";
  EXPECT_EQ(doubt(30, 6, Rejection::kOnNoFace), "") << "another print stands there";
  EXPECT_NE(doubt(3, 6, Rejection::kMisplaced, 3), "");
  EXPECT_EQ(doubt(2, 6, Rejection::kMisplaced, 2), "") << "two may be wrong themselves";
}

TEST(RigCalibration, PicturesOfAnotherSizeForbidToKeepTheLenses) {
  const ProjectedRig world = ProjectCorners(SmallRig(12));
  std::vector<SightedCamera> cameras = world.sightings.cameras;
  EXPECT_TRUE(CheckKeptLenses(cameras, world.truth).ok());
  cameras[3].width_px = 600;
  cameras[3].height_px = 800;
  const Status kept = CheckKeptLenses(cameras, world.truth);
  ASSERT_FALSE(kept.ok());
  EXPECT_EQ(kept.error().context, cameras[3].camera);
  EXPECT_NE(kept.error().message.find("600x800 pixels, expected 1200x1600"), std::string::npos)
      << kept.error().message;
}

}  // namespace
}  // namespace rotunda::rig
