#include "rig/sim/simulate.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <opencv2/aruco.hpp>
#include <opencv2/aruco/charuco.hpp>
#include <opencv2/imgproc.hpp>

#include "rig/sim/board_object.h"
#include "sfm/core/file_io.h"
#include "sfm/core/frame_set.h"

namespace rotunda::sim {
namespace {

namespace fs = std::filesystem;

fs::path Fresh(const std::string& name) {
  const fs::path folder = fs::path(testing::TempDir()) / name;
  fs::remove_all(folder);
  return folder;
}

SimulateOptions SmallCuboid() {
  SimulateOptions options;
  options.target = Target::kCuboid;
  options.cameras = 5;
  options.picture_scale = 0.25;
  options.seed = 3;
  return options;
}

std::string AllBytes(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  std::string bytes;
  for (const fs::path& file : files) {
    bytes += fs::relative(file, folder).string() + "\n" + ReadFile(file).value();
  }
  return bytes;
}

TEST(SimulateFrameSet, SameBytesOnOneAndOnThreeThreads) {
  SimulateOptions options;
  options.cameras = 4;
  options.picture_scale = 0.1;
  options.seed = 5;
  std::string bytes[2];
  for (int i = 0; i < 2; ++i) {
    ThreadPool threads(i == 0 ? 1 : 3);
    RunContext context{threads};
    const fs::path out = Fresh("threads" + std::to_string(i));
    const Status status = SimulateFrameSet({}, options, out, context);
    ASSERT_TRUE(status) << status.error().ToString();
    bytes[i] = AllBytes(out);
  }
  EXPECT_GT(bytes[0].size(), 20000u);
  EXPECT_EQ(bytes[0], bytes[1]);
}

TEST(SimulateFrameSet, ReadsBackAsAFrameSetWithTruth) {
  ThreadPool threads(2);
  RunContext context{threads};
  const fs::path out = Fresh("readback");
  ASSERT_TRUE(SimulateFrameSet({}, SmallCuboid(), out, context));
  const auto set = ReadFrameSet(out);
  ASSERT_TRUE(set) << set.error().ToString();
  const auto truth = ReadCalibration(out / "truth.json");
  ASSERT_TRUE(truth) << truth.error().ToString();
  ASSERT_EQ(set->frames.size(), 5u);
  for (size_t i = 0; i < set->frames.size(); ++i) {
    EXPECT_EQ(set->frames[i].camera, truth->cameras[i].camera);
    const auto picture = ReadPicture(set->PicturePath(ImageId(i)));
    ASSERT_TRUE(picture);
    EXPECT_EQ(picture->width, truth->cameras[i].intrinsics.width_px);
    EXPECT_EQ(picture->height, truth->cameras[i].intrinsics.height_px);
  }
  EXPECT_EQ(truth->source, CalibrationSource::kTruth);
  EXPECT_EQ(set->id, "simulated-3-placement-0");
  EXPECT_EQ(truth->id, "simulated-3");
  EXPECT_EQ(set->trigger.at("source"), TriggerValue("simulated"));
}

TEST(SimulateFrameSet, AMovedCameraIsNotWhereItsCalibrationHasIt) {
  ThreadPool threads(2);
  RunContext context{threads};
  SimulateOptions options = SmallCuboid();
  const fs::path before = Fresh("before"), after = Fresh("after");
  ASSERT_TRUE(SimulateFrameSet({}, options, before, context));
  const auto was = ReadCalibration(before / "truth.json");
  ASSERT_TRUE(was);
  const double turn_deg = 15;
  options.moved = {{was->cameras[2].camera, 20},
                   {was->cameras[0].camera, -5},
                   {was->cameras[1].camera, 0, turn_deg}};
  ASSERT_TRUE(SimulateFrameSet({}, options, after, context));
  const auto is = ReadCalibration(after / "truth.json");
  ASSERT_TRUE(is);
  for (size_t i = 0; i < was->cameras.size(); ++i) {
    const Rigid3& old = was->cameras[i].cam_from_rig;
    const Rigid3& now = is->cameras[i].cam_from_rig;
    const Eigen::Vector3d moved_m = now.OriginInSource() - old.OriginInSource();
    const Eigen::Vector3d right = old.rotation.conjugate() * Eigen::Vector3d::UnitX();
    const double expected_m = i == 2 ? 0.020 : i == 0 ? -0.005 : 0;
    EXPECT_LT((moved_m - expected_m * right).norm(), 1e-12) << i;
    const bool is_turned = i == 1;
    EXPECT_NEAR(RotationAngle_rad(now.rotation, old.rotation), is_turned ? RadFromDeg(turn_deg) : 0,
                1e-12)
        << i;
    // What was in the middle is left of it now.
    const Eigen::Vector3d seen = now * (old.Inverse() * Eigen::Vector3d(0, 0, 1));
    EXPECT_NEAR(seen.x(), is_turned ? -std::sin(RadFromDeg(turn_deg)) : -expected_m, 1e-12);
    const std::string file = "frames/" + was->cameras[i].camera + ".png";
    EXPECT_EQ(*ReadFile(before / file) == *ReadFile(after / file), expected_m == 0 && !is_turned)
        << i;
  }
  EXPECT_EQ(*ReadFile(before / "calibration.json"), *ReadFile(after / "calibration.json"));
  options.moved = {{"c99r9", 20}};
  const Status refused = SimulateFrameSet({}, options, Fresh("none"), context);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kInvalidArgument);
  EXPECT_NE(refused.error().message.find("c99r9"), std::string::npos);
}

TEST(SimulateFrameSet, RefusesBadOptionsAndLeavesNothing) {
  ThreadPool threads(1);
  RunContext context{threads};
  const fs::path out = Fresh("refused");
  SimulateOptions options;
  options.cameras = 91;
  Status status = SimulateFrameSet({}, options, out, context);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().ToString(), "number of cameras is 91, expected 2 to 90 (the rig's)");
  options.cameras = 3;
  options.height_m = 3;
  status = SimulateFrameSet({}, options, out, context);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().ToString(), "height of the body is 3, expected 0.8 to 2.2 m");
  options.height_m = 1.7;
  options.picture_scale = 0;
  status = SimulateFrameSet({}, options, out, context);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().ToString(),
            "scale of the pictures is 0, expected more than 0.05, at most 2");
  options.picture_scale = 1;
  options.texture = GarmentTexture::kOwn;
  status = SimulateFrameSet({}, options, out, context);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().context, "texture");
  EXPECT_FALSE(fs::exists(out));
}

TEST(SimulateFrameSet, StoppingLeavesNothing) {
  ThreadPool threads(1);
  std::stop_source stop;
  RunContext context{threads};
  context.stop = stop.get_token();
  context.progress = [&](std::string_view stage, size_t done, size_t) {
    if (stage == "pictures" && done == 2) stop.request_stop();
  };
  const fs::path parent = Fresh("stopped");
  fs::create_directory(parent);
  const Status status = SimulateFrameSet({}, SmallCuboid(), parent / "set", context);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, ErrorCode::kCancelled);
  EXPECT_TRUE(fs::is_empty(parent));
}

cv::Mat GrayOf(const Picture& picture) {
  cv::Mat gray(picture.height, picture.width, CV_8UC1);
  for (int y = 0; y < picture.height; ++y) {
    for (int x = 0; x < picture.width; ++x) gray.at<uint8_t>(y, x) = picture.at(x, y)[1];
  }
  return gray;
}

/// Full-size pictures of the cuboid by cameras of DrawRig, without noise that matters.
class CuboidPictures : public testing::Test {
 protected:
  CuboidPictures() {
    options_.target = Target::kCuboid;
    options_.placement = 4;
    options_.background = Background::kPlain;
    rig_.sensor.full_well_e = 1e6;
    rig_.sensor.read_noise_e = 0;
    truth_ = DrawRig(rig_, 17, 4, 1.0);
    world_ = BuildWorld(rig_, options_, context_).value();
    scene_ = std::make_unique<RayScene>(RayScene::Build(world_, false).value());
  }
  cv::Mat Render(const CalibratedCamera& camera) {
    return GrayOf(RenderPicture(world_, *scene_, camera, rig_.sensor, options_));
  }

  ThreadPool threads_{2};
  RunContext context_{threads_};
  RigOptions rig_;
  SimulateOptions options_;
  Calibration truth_;
  World world_;
  std::unique_ptr<RayScene> scene_;
};

TEST_F(CuboidPictures, ChessboardCornersLieWhereTheTruthProjectsThem) {
  const Rigid3 rig_from_board = BoardPlacement(options_.placement);
  const std::vector<CalibratedFace> faces = BoardOf(options_);
  for (const CalibratedCamera& camera : truth_.cameras) {
    const cv::Mat gray = Render(camera);
    std::vector<cv::Point2f> predicted;
    for (size_t f = 0; f < faces.size(); ++f) {
      const rig::BoardFace& face = options_.board.faces[f];
      const Eigen::Vector3d outward =
          rig_from_board.rotation * faces[f].board_from_face.rotation * -Eigen::Vector3d::UnitZ();
      for (int i = 0; i < face.CornerCount(); ++i) {
        const Eigen::Vector3d corner =
            rig_from_board * rig::PointOnBoard(face, faces[f], face.CornerInFace(i));
        const Eigen::Vector3d view = (camera.cam_from_rig.OriginInSource() - corner).normalized();
        if (view.dot(outward) < 0.5) continue;  // well visible ones
        const auto at = camera.intrinsics.Project(camera.cam_from_rig * corner);
        if (!at || at->x() < 40 || at->y() < 40 || at->x() > 1160 || at->y() > 1560) continue;
        // OpenCV's pixel centres lie on integers.
        predicted.emplace_back(static_cast<float>(at->x() - 0.5),
                               static_cast<float>(at->y() - 0.5));
      }
    }
    ASSERT_GT(predicted.size(), 60u);
    std::vector<cv::Point2f> found = predicted;
    cv::cornerSubPix(gray, found, {5, 5}, {-1, -1},
                     {cv::TermCriteria::EPS + cv::TermCriteria::COUNT, 50, 1e-4});
    cv::Point2f mean(0, 0);
    double squares = 0;
    for (size_t i = 0; i < found.size(); ++i) {
      mean += (found[i] - predicted[i]) / static_cast<float>(found.size());
      squares += (found[i] - predicted[i]).dot(found[i] - predicted[i]);
    }
    EXPECT_LT(cv::norm(mean), 0.02) << camera.camera;
    EXPECT_LT(std::sqrt(squares / static_cast<double>(found.size())), 0.10) << camera.camera;
  }
}

TEST_F(CuboidPictures, OpenCvReadsTheTagsOfTheRightFaces) {
  const Rigid3 rig_from_board = BoardPlacement(options_.placement);
  const std::vector<CalibratedFace> faces = BoardOf(options_);
  const auto dictionary = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11);
  const CalibratedCamera& camera = truth_.cameras[1];
  std::vector<int> ids;
  std::vector<std::vector<cv::Point2f>> corners;
  cv::aruco::detectMarkers(Render(camera), dictionary, corners, ids);
  ASSERT_GT(ids.size(), 30u);
  // OpenCV's own board of each face says where a tag with this id is.
  for (size_t f = 0; f < faces.size(); ++f) {
    const rig::BoardFace& face = options_.board.faces[f];
    const auto board =
        cv::aruco::CharucoBoard::create(face.columns, face.rows, static_cast<float>(face.square_m),
                                        static_cast<float>(face.marker_m), dictionary);
    for (size_t i = 0; i < ids.size(); ++i) {
      if (!face.HasMarker(ids[i])) continue;
      for (int k = 0; k < 4; ++k) {
        const cv::Point3f& p = board->objPoints[ids[i] - face.first_id][k];
        const Eigen::Vector3d corner =
            rig_from_board * rig::PointOnBoard(face, faces[f], Eigen::Vector3d(p.x, p.y, 0));
        const Eigen::Vector2d at = *camera.intrinsics.Project(camera.cam_from_rig * corner);
        EXPECT_LT((at - Eigen::Vector2d(corners[i][k].x + 0.5, corners[i][k].y + 0.5)).norm(), 2.0)
            << "id " << ids[i];
      }
    }
  }
}

TEST(DrawBoard, StaysWithinItsErrorsAndIsTheSameForOneSeed) {
  const rig::Board board = rig::CuboidBoard({});
  constexpr BoardErrors kErrors;
  double farthest_mm = 0;
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const std::vector<CalibratedFace> faces = DrawBoard(board, 1, seed);
    const std::vector<CalibratedFace> again = DrawBoard(board, 1, seed);
    for (size_t f = 0; f < faces.size(); ++f) {
      EXPECT_EQ(faces[f].board_from_face.translation, again[f].board_from_face.translation);
      const rig::BoardFace& face = board.faces[f];
      const Eigen::Vector3d middle(0.5 * face.Width_m(), 0.5 * face.Height_m(), 0);
      const double off_mm =
          1e3 * (faces[f].board_from_face * middle - face.board_from_face * middle).norm();
      farthest_mm = std::max(farthest_mm, off_mm);
      EXPECT_LE(off_mm, kErrors.position_mm);
      EXPECT_LE(DegFromRad(RotationAngle_rad(faces[f].board_from_face.rotation,
                                             face.board_from_face.rotation)),
                kErrors.rotation_deg * (1 + 1e-9));
      EXPECT_NEAR(std::abs(faces[f].bow_m.sum()), 1e-3 * kErrors.bow_mm, 1e-12);
    }
  }
  EXPECT_GT(farthest_mm, 0.8 * kErrors.position_mm);
  EXPECT_EQ(DrawBoard(board, 0, 3)[2].bow_m.norm(), 0);
}

TEST(SimulatePlacements, SameRigAndTargetInEveryShot) {
  ThreadPool threads(2);
  RunContext context{threads};
  const fs::path out = Fresh("placements");
  SimulateOptions options = SmallCuboid();
  options.cameras = 2;
  options.picture_scale = 0.1;
  ASSERT_TRUE(SimulatePlacements({}, options, 2, out, context));
  const auto first = ReadFile(out / "placement_00" / "truth.json");
  const auto second = ReadFile(out / "placement_01" / "truth.json");
  ASSERT_TRUE(first && second);
  EXPECT_EQ(*first, *second);
  const auto truth = ReadCalibration(out / "placement_01" / "truth.json");
  ASSERT_TRUE(truth) << truth.error().ToString();
  EXPECT_EQ(truth->board.size(), 5u);
  EXPECT_NE(ReadFrameSet(out / "placement_00")->id, ReadFrameSet(out / "placement_01")->id);
  EXPECT_EQ(ReadFrameSet(out / "placement_00")->captured_at, "2000-01-01T00:00:00Z");
  EXPECT_EQ(ReadFrameSet(out / "placement_01")->captured_at, "2000-01-01T00:01:00Z");
  EXPECT_TRUE(ReadCalibration(out / "placement_01" / "calibration.json")->board.empty());
}

}  // namespace
}  // namespace rotunda::sim
